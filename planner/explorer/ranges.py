"""Ends of the sliders that depend on the problem."""

from __future__ import annotations

import numpy as np

from planner.chained import chained_form
from planner.explorer.control import rounded
from planner.problem import Problem
from planner.reachability import travel_window


def travel_range(problem: Problem) -> tuple[float, float, float]:
    """Least and greatest travel of the slider, and one between them."""
    window = travel_window(problem)
    given = problem.travel
    if window is not None and not window.empty and np.isfinite(window.high):
        margin = 0.3 * (window.high - window.low)
        low, high = window.low - margin, window.high + margin
        middle = (window.low + window.high) / 2
    else:
        middle = 0.0 if given is None else given
        reach = max(1.0, abs(middle))
        low, high = middle - reach, middle + reach
    if given is not None:
        low, high = min(low, given), max(high, given)
    return rounded(low, 4), rounded(high, 4), middle


def z2_reach(problem: Problem) -> float:
    """A |z₂| beyond what the problem's ends have, for the range of a slider."""
    form = chained_form(problem.system)
    ends = [form.z(np.nan_to_num(q))[1] for q in (problem.start, problem.goal)]
    return rounded(max(1e-3, 2 * float(np.max(np.abs(ends)))), 2)
