"""Answers, before any search, to the question which requirements each method surely satisfies.

A method gives one of three answers for each part of each requirement:

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
from planner.problem.requirements.motion_limits import JointLimit, Z2Margin
from planner.problem.requirements.places import Waypoint
from planner.problem.requirements.requirement import Demand, Part, Requirement
from planner.systems.manipulator import Manipulator

Keeping = Literal["kept", "judged", "never"]

Keeps = Callable[[Problem, Demand, Part], Keeping]
"""Function that gives a method's answer for one part of one demand of a problem."""


def nothing(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Return "judged", for a method that guarantees no demand: each is only checked afterwards."""
    return "judged"


def collocation(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Return "kept", for collocation: each demand is a constraint or bound of its programme."""
    return "kept"


def desensitised(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Return "never" for a waypoint, which desensitised plans cannot aim at, else "kept"."""
    return "never" if isinstance(demand, Waypoint) else "kept"


def in_chart(problem: Problem, demand: Demand) -> Keeping:
    """Return the answer of any method in the chart for a start, goal, waypoint or duration.

    Such a method needs all chained coordinates z at the goal, so its answer for a goal with free
    joints is "never".
    """
    if isinstance(demand, Waypoint):
        return "judged"
    return "never" if demand.at_goal and problem.free else "kept"


def convex(problem: Problem, demand: Demand, part: Part) -> Keeping:
    """Return the answer of the convex method, whose timing keeps all limits on the speed.

    On a one-way path of the arm, θ₂ … θₙ are monotonic and stay between start and goal. The path
    also keeps the margin of z₂, and for two joints the limit of θ₁, which is a limit of z₂ alone.
    """
    if not isinstance(demand, Requirement) or demand.final or demand.speed_power:
        return in_chart(problem, demand)
    system = problem.system
    if isinstance(demand, JointLimit) and isinstance(system, Manipulator):
        return "kept" if part.index > 1 or system.n == 2 else "judged"
    return "kept" if isinstance(demand, Z2Margin) else "judged"


Rates = Callable[[float | None], tuple[Keeping, Keeping]]
"""Function from the travel (None if free) to one answer for u₁ and one for u₂: "kept" if the input
is continuous, "never" if it always jumps, "judged" if it may jump."""


def law(rates: Rates) -> Keeps:
    """Return the function `keeps` of a closed-form law; `rates` says whether its inputs jump.

    The law reaches the goal within the chart if the goal gives every joint. A free duration becomes
    long enough for every limit that depends on the speed. Limits on input rates (du) also depend on
    whether the inputs jump.
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
    """Return whether inputs jump for sinusoids over one period: "kept" for both, as none does."""
    return "kept", "kept"


def one_leg(travel: float | None) -> tuple[Keeping, Keeping]:
    """Return whether inputs jump for constant v₁ and smooth v₂; at travel zero v₁ changes sign."""
    return ("never", "judged") if travel == 0 else ("kept", "kept")


def slots(travel: float | None) -> tuple[Keeping, Keeping]:
    """Return whether inputs jump for v₂ constant on slots: v₂ does, except in straight motions."""
    return one_leg(travel)[0], "judged"


def steps(travel: float | None) -> tuple[Keeping, Keeping]:
    """Return whether inputs jump for constant v, then sinusoids: v₁ once, v₂ after each period."""
    return "kept" if travel == 0 else "judged" if travel is None else "never", "judged"


def answers(problem: Problem, keeps: Keeps) -> dict[str, Keeping]:
    """Return a method's answer for each part of each demand of a problem, by the part's label."""
    return {p.label: keeps(problem, each, p) for each in problem.demands for p in each.parts}


def not_promised(problem: Problem, keeps: Keeps) -> tuple[str, ...]:
    """Return the labels of the parts that a method does not guarantee."""
    return tuple(label for label, answer in answers(problem, keeps).items() if answer != "kept")


def refuse_unkept(problem: Problem, name: str, keeps: Keeps) -> None:
    """Refuse a problem with a demand that a method never satisfies, before any search.

    Raises:
        NoPlanError: If the problem has such a demand.
    """
    parts = [(each, part) for each in problem.demands for part in each.parts]
    never = [(each, part.label) for each, part in parts if keeps(problem, each, part) == "never"]
    if any(each.at_goal for each, _ in never):
        if problem.system.has_user_coordinates:
            every = problem.system.user_coordinates
            names = ", ".join(every[i].name for i in np.flatnonzero(np.isnan(problem.user_goal)))
            raise NoPlanError(
                f"methods in the chart need every coordinate at the goal, and"
                f" [goal] leaves {names} free",
                source=problem.source,
                changes=[BY_COLLOCATION],
            )
        names = ", ".join(problem.system.coordinates[i].name for i in problem.free)
        words = ", which chooses them; then give the end of its plan as goal.theta_deg"
        raise NoPlanError(
            f"methods in the chart need every joint at the goal, and [goal] leaves {names} free",
            source=problem.source,
            changes=[replace(BY_COLLOCATION, words=words)],
        )
    if never:
        labels = ", ".join(dict.fromkeys(label for _, label in never))
        raise NoPlanError(
            f"the method '{name}' does not plan for {labels}",
            source=problem.source,
            changes=[BY_COLLOCATION],
        )
