"""Which requirements each method satisfies, and which only verification checks: known in advance.

kept     every motion that the method finds satisfies it
judged   the method ignores it or uses it only to compare a few motions; verification checks it
never    no motion of the method satisfies it, or the method does not start when it is required
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from planner.errors import NoPlanError
from planner.methods.refusal import BY_COLLOCATION
from planner.problem.problem import Problem
from planner.problem.requirements.ends import Goal, TipGoal
from planner.problem.requirements.motion_limits import JointLimit, Z2Margin
from planner.problem.requirements.places import Waypoint
from planner.problem.requirements.requirement import Demand, Part, Requirement
from planner.problem.requirements.user_places import UserGoal
from planner.systems.manipulator import Manipulator

Keeping = Literal["kept", "judged", "never"]

GOALS = Goal | TipGoal | UserGoal
"""Demands that define the end of a motion."""

Keeps = Callable[[Problem, Demand, Part], Keeping]
"""A method's answer for one part of one demand of a problem."""


def nothing(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Say that no demand is guaranteed; each is only checked afterwards."""
    return "judged"


def collocation(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Every demand is a constraint or a bound of the nonlinear programme."""
    return "kept"


def desensitised(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """As collocation, except that the new search around an earlier path ignores the waypoints."""
    return "never" if isinstance(demand, Waypoint) else "kept"


def in_chart(problem: Problem, demand: Demand) -> Keeping:
    """For a method in the chart and a demand that is not a limit: start, goal, waypoint, duration.

    Such a method needs all of z at the goal, since goals with free joints form no simple set in z.
    """
    if isinstance(demand, Waypoint):
        return "judged"
    return "never" if isinstance(demand, GOALS) and problem.free else "kept"


def convex(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """The path keeps limits that are convex in the chart; its timing keeps those on the speed.

    On a one-way path of the arm θ₂ … θₙ are monotonic, so they stay between start and goal. The
    limit of θ₁ is a limit of z₂ alone only for two joints.
    """
    if not isinstance(demand, Requirement) or demand.final or demand.speed_power:
        return in_chart(problem, demand)
    system = problem.system
    if isinstance(demand, JointLimit) and isinstance(system, Manipulator):
        return "kept" if part.index > 1 or system.n == 2 else "judged"
    return "kept" if isinstance(demand, Z2Margin) else "judged"


Rates = Callable[[float | None], tuple[Keeping, Keeping]]
"""Maps the travel (None if free) to one answer each for u₁ and u₂: "kept" if the input is
continuous, "never" if it always jumps."""


def law(rates: Rates) -> Keeps:
    """A closed form reaches the goal within the chart if the goal gives every joint.

    A free duration becomes long enough to satisfy every limit that depends on the speed.
    """

    def keeps(problem: Problem, demand: Demand, part: Part) -> Keeping:
        if not isinstance(demand, Requirement) or demand.final:
            return in_chart(problem, demand)
        slowed = demand.speed_power > 0 and problem.duration is None
        if "du" not in demand.reads:
            return "kept" if slowed else "judged"
        answers = rates(problem.travel)
        ways = {answers[part.index]} if demand.is_direct else set(answers)
        return "never" if "never" in ways else "kept" if slowed and ways == {"kept"} else "judged"

    return keeps


def smooth(travel: float | None) -> tuple[Keeping, Keeping]:
    """Say how sinusoids over one period meet both demands."""
    return "kept", "kept"


def one_leg(travel: float | None) -> tuple[Keeping, Keeping]:
    """For constant v₁ and smooth v₂. With travel zero v₁ changes its sign during the motion."""
    return ("never", "judged") if travel == 0 else ("kept", "kept")


def slots(travel: float | None) -> tuple[Keeping, Keeping]:
    """For v₂ constant on each slot: it jumps between slots, except for straight motions."""
    return one_leg(travel)[0], "judged"


def steps(travel: float | None) -> tuple[Keeping, Keeping]:
    """For constant v, then sinusoids: v₁ jumps from its constant to zero, v₂ between periods."""
    return "kept" if travel == 0 else "judged" if travel is None else "never", "judged"


def answers(problem: Problem, keeps: Keeps) -> dict[str, Keeping]:
    """A method's answer for each part of each demand of a problem, by the part's label."""
    return {p.label: keeps(problem, each, p) for each in problem.demands for p in each.parts}


def not_promised(problem: Problem, keeps: Keeps) -> tuple[str, ...]:
    """Labels of the parts that a method does not guarantee."""
    return tuple(label for label, answer in answers(problem, keeps).items() if answer != "kept")


def refuse_unkept(problem: Problem, name: str, keeps: Keeps) -> None:
    """Refuse, before any search, a problem with a demand that a method never satisfies.

    Raises:
        NoPlanError: If there is one.
    """
    parts = [(each, part) for each in problem.demands for part in each.parts]
    never = [(each, part.label) for each, part in parts if keeps(problem, each, part) == "never"]
    if any(isinstance(each, GOALS) for each, _ in never):
        if problem.system.has_user_coordinates:
            every = problem.system.user_coordinates
            names = ", ".join(every[i].name for i in np.flatnonzero(np.isnan(problem.user_goal)))
            raise NoPlanError(
                f"{problem.source}: methods in the chart need every coordinate at the goal, and"
                f" [goal] leaves {names} free",
                changes=[BY_COLLOCATION],
            )
        names = ", ".join(problem.system.coordinates[i].name for i in problem.free)
        words = ", which chooses them; then give the end of its plan as goal.theta_deg"
        raise NoPlanError(
            f"{problem.source}: methods in the chart need every joint at the goal, and [goal]"
            f" leaves {names} free",
            changes=[replace(BY_COLLOCATION, words=words)],
        )
    if never:
        labels = ", ".join(dict.fromkeys(label for _, label in never))
        raise NoPlanError(
            f"{problem.source}: the method '{name}' does not plan for {labels}",
            changes=[BY_COLLOCATION],
        )
