"""The piecewise constant (multirate) law: v₁ constant, v₂ constant on each of m slots.

This is Monaco and Normand-Cyrot's multirate control, which the paper names beside its polynomials.
With m = N−1 slots the goal z(T) determines v₂, by the linear system of theory.md §4.
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
    """Plan with v₁ constant and v₂ constant on each of equally long slots.

    With travel zero the motion has two legs, out and back, each with all slots. In this case, and
    with more slots than needed, the solution with the least ∫v₂² is taken.

    Raises:
        SingularError: If start and goal are not in one branch of the chart, or the path leaves the
            chart's domain (unless `options.allow_singular`) at the times that the error gives;
            or if the travel leaves the coefficients undetermined.
        InputError: If there are fewer slots than coordinates to bring to the goal.
    """
    began = time.perf_counter()
    ends, least = Ends.of(problem), problem.system.size - 1
    slots = options.slots or least
    if slots < least:
        raise InputError(
            f"method.piecewise.slots = {slots} is too few to reach"
            f" {least} coordinates; use at least {least}",
            source=problem.source,
        )

    def motion(reach: float | Array) -> Motion:
        legs = even_legs(ends, reach, slots, terms=1)
        return steer(ends.start, ends.goal_of(reach), legs)

    reach, notes = choose_reach(ends, options, NAME, motion)
    try:
        best = motion(reach)
    except np.linalg.LinAlgError:
        raise SingularError(
            f"travel {reach:g} {problem.system.coordinates[0].unit} does not"
            " determine the constants of the slots",
            source=problem.source,
            advice=f"another {problem.travel_key or 'goal'}",
        ) from None
    notes |= {"slots": slots, **best.summary}
    return finish(problem, NAME, options, ends.trajectory(best), notes, began)
