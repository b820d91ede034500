"""The piecewise constant (multirate) law: v₁ constant, v₂ constant on each of m slots.

Monaco and Normand-Cyrot's multirate control, which the paper names beside its polynomials; with
m = N−1 slots z(T) fixes v₂ through the matrix of theory.md §4.
"""

from __future__ import annotations

import time

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.laws.free_numbers import choose_reach, one_way_or_back
from planner.methods.laws.law import Ends, Motion, finish
from planner.methods.laws.legs import even_legs, steer
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import PiecewiseOptions
from planner.support.arrays import Array

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

    def motion(reach: float | Array) -> Motion:
        legs = even_legs(ends, reach, slots, terms=1)
        return steer(ends.start, ends.goal_of(reach), legs)

    reach, notes = choose_reach(ends, options, NAME, motion)
    try:
        best = motion(reach)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"{problem.source}: travel {reach:g} {problem.system.coordinates[0].unit} leaves the"
            " slots' constants undetermined",
            advice=f"another {problem.travel_key}",
        ) from None
    notes |= {"slots": slots, **best.summary}
    return finish(problem, NAME, options, ends.trajectory(best), notes, began)


def _slots(problem: Problem, options: PiecewiseOptions) -> int:
    least = problem.system.size - 1
    if options.slots is not None and options.slots < least:
        raise InputError(
            f"{problem.source}: method.piecewise.slots = {options.slots} is too few to reach"
            f" {least} coordinates; at least {least}"
        )
    return options.slots or least
