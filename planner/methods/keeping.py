"""Which requirements each method keeps, and which it leaves to the judge: known before it searches.

kept     no motion that the method finds breaks it
judged   the method chooses its motion without it, or only compares a few motions by it
never    no motion of the method keeps it, or the method does not begin where it is asked for
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from planner.errors import NoPlanError
from planner.methods.refusal import BY_COLLOCATION
from planner.problem.problem import Problem
from planner.problem.requirements.ends import Goal, TipGoal
from planner.problem.requirements.limits import JointLimit, Z2Margin
from planner.problem.requirements.places import Waypoint
from planner.problem.requirements.requirement import Demand, Part, Requirement
from planner.systems.manipulator import Manipulator

Keeping = Literal["kept", "judged", "never"]

Keeps = Callable[[Problem, Demand, Part], Keeping]
"""What a method answers for a part of what a problem demands."""


def nothing(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Of a method that promises nothing."""
    return "judged"


def collocation(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Each demand is a row or a bound of the programme."""
    return "kept"


def desensitised(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """As collocation; but the path is searched anew about another, which loses the waypoints."""
    return "never" if isinstance(demand, Waypoint) else "kept"


def in_chart(problem: Problem, demand: Demand) -> Keeping:
    """Of a method in the chart, for what is asked of ends and ways: no limit.

    It needs all of z at the goal: what joints that are free may be is no set that is simple in z.
    """
    if isinstance(demand, Waypoint):
        return "judged"
    return "never" if isinstance(demand, Goal | TipGoal) and problem.free else "kept"


def convex(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """The path keeps what is convex in the chart, its timing what depends on the speed.

    On a one-way path of the arm θ₂ … θₙ move one way, and so stay between start and goal. The
    limit of θ₁ is one of z₂ alone for two joints only.
    """
    if not isinstance(demand, Requirement) or demand.final or demand.speed:
        return in_chart(problem, demand)
    system = problem.system
    if isinstance(demand, JointLimit) and isinstance(system, Manipulator):
        return "kept" if part.index > 1 or system.n == 2 else "judged"
    return "kept" if isinstance(demand, Z2Margin) else "judged"


Rates = Callable[[float | None], tuple[Keeping, Keeping]]
"""From the travel, or None where it is free, to whether u₁ and u₂ jump: "kept" where neither does,
"never" where one always does."""


def law(rates: Rates) -> Keeps:
    """A closed form reaches the goal within the chart, if that gives every joint.

    Where the duration is free, it becomes so long that what depends on the speed is kept.
    """

    def keeps(problem: Problem, demand: Demand, part: Part) -> Keeping:
        if not isinstance(demand, Requirement) or demand.final:
            return in_chart(problem, demand)
        slowed = demand.speed > 0 and problem.duration is None
        if "du" not in demand.reads:
            return "kept" if slowed else "judged"
        answers = rates(problem.travel)
        own = {answers[part.index]} if demand.plain else set(answers)
        return "never" if "never" in own else "kept" if slowed and own == {"kept"} else "judged"

    return keeps


def smooth(travel: float | None) -> tuple[Keeping, Keeping]:
    """Of sinusoids over one period."""
    return "kept", "kept"


def one_leg(travel: float | None) -> tuple[Keeping, Keeping]:
    """Of v₁ constant and v₂ smooth. With travel zero v₁ changes its sign on the way."""
    return ("never", "judged") if travel == 0 else ("kept", "kept")


def slots(travel: float | None) -> tuple[Keeping, Keeping]:
    """Of v₂ constant on each slot: it jumps between them, but for motions straight ahead."""
    return one_leg(travel)[0], "judged"


def steps(travel: float | None) -> tuple[Keeping, Keeping]:
    """Of v constant, then sinusoids: v₁ jumps from its constant to zero, v₂ between periods."""
    return "kept" if travel == 0 else "judged" if travel is None else "never", "judged"


def answers(problem: Problem, keeps: Keeps) -> dict[str, Keeping]:
    """What a method makes of each part of what a problem demands, by the part's label."""
    return {p.label: keeps(problem, each, p) for each in problem.demands for p in each.parts}


def not_promised(problem: Problem, keeps: Keeps) -> tuple[str, ...]:
    """Labels of what a method does not promise to keep."""
    return tuple(label for label, answer in answers(problem, keeps).items() if answer != "kept")


def refuse_unkept(problem: Problem, name: str, keeps: Keeps) -> None:
    """Refuse, before any search, a problem with a demand that a method never keeps.

    Raises:
        NoPlanError: If there is one.
    """
    goals = [each for each in problem.demands if isinstance(each, Goal | TipGoal)]
    if any(keeps(problem, each, part) == "never" for each in goals for part in each.parts):
        names = ", ".join(problem.system.coordinates[i].name for i in problem.free)
        words = ", which finds them; then give all, its plan's end, as goal.theta_deg"
        raise NoPlanError(
            f"{problem.source}: methods in the chart need every joint at the goal, and [goal]"
            f" leaves {names} free",
            changes=[replace(BY_COLLOCATION, words=words)],
        )
    never = [label for label, answer in answers(problem, keeps).items() if answer == "never"]
    if never:
        raise NoPlanError(
            f"{problem.source}: the method '{name}' does not plan for {', '.join(never)}",
            changes=[BY_COLLOCATION],
        )
