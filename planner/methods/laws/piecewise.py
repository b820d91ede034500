"""The piecewise constant (multirate) law: v₁ constant, v₂ constant on each of m slots.

Monaco and Normand-Cyrot's multirate control, which the paper names beside its polynomials; with
m = N−1 slots z(T) fixes v₂ through the matrix of theory.md §4.
"""

from __future__ import annotations

import time

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import choose_offset, one_way_or_back, travel_of
from planner.methods.laws.law import Ends, even_legs, finish, summary, trajectory_of
from planner.methods.laws.legs import LegMotion, steer
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory
from planner.problem.problem import Problem
from planner.problem.tables.method_options import PiecewiseOptions

NAME = "piecewise"


@one_way_or_back
def plan_piecewise(problem: Problem, options: PiecewiseOptions) -> Plan:
    """Steer with v₁ constant and v₂ constant on each of equally long slots.

    With travel zero there are two legs, out and back, of that number of slots each. In this case,
    and with more slots than needed, v₂ has the least ∫v₂².

    Raises:
        SingularError: If start or goal are not in one branch of the chart, or the path leaves its
            domain (unless `options.allow_singular`), with the times.
        InputError: If there are fewer slots than conditions.
    """
    began = time.perf_counter()
    ends, slots = Ends.of(problem), _slots(problem, options)
    offset, turn = choose_offset(
        ends,
        options,
        NAME,
        lambda offset: trajectory_of(problem, _motion(ends, offset, slots, 0.0)),
    )

    def make(travel: float) -> ChainedTrajectory:
        return trajectory_of(problem, _motion(ends, offset, slots, travel))

    choice = travel_of(problem, make, options)
    motion = _motion(ends, offset, slots, choice.travel)
    notes = {
        **turn,
        "slots": slots,
        "travel_ranges_in_domain": [list(r) for r in choice.ranges],
        **summary(motion),
    }
    return finish(problem, NAME, options, trajectory_of(problem, motion), notes, began)


def _slots(problem: Problem, options: PiecewiseOptions) -> int:
    least = problem.system.size - 1
    if options.slots is not None and options.slots < least:
        raise InputError(
            f"{problem.source}: method.piecewise.slots = {options.slots} is too few to reach"
            f" {least} coordinates; at least {least}"
        )
    return options.slots or least


def _motion(ends: Ends, offset: float, slots: int, travel: float) -> LegMotion:
    legs = even_legs(ends.duration, travel, offset, slots, terms=1)
    try:
        return steer(ends.start, ends.goal(travel), legs)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{ends.problem.source}: travel {travel:g} {ends.problem.system.coordinates[0].unit}"
            " leaves the slots' constants undetermined",
            advice=f"another {ends.problem.travel_key}",
        ) from None
