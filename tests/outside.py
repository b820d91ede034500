"""The motion of a plan by another integrator: DOP853 in time, piece by piece, on u(t) itself."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

import planner
from planner.support.calculus.extremes import sample_times


def integrate(
    plan: planner.Plan, rtol: float = 1e-12, atol: float = 1e-13
) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """The motion, times (m,) to q (m, N), from the problem's start, and times that cover it.

    A tenth of the tolerances takes seven times as long where u itself is rounded to some 1e-11, and
    moves no point by more.
    """
    system = plan.problem.system
    edges, pieces, q = plan.t, [], plan.problem.start
    for a, b in pairwise(edges):
        last = np.nextafter(b, a) if b != edges[-1] else b

        def rates(t: float, q: np.ndarray, last: float = last) -> np.ndarray:
            return system.rates(q, plan.u(min(t, last)))

        solution = solve_ivp(rates, (a, b), q, "DOP853", rtol=rtol, atol=atol, dense_output=True)
        assert solution.success, solution.message
        pieces.append(solution.sol)
        q = solution.y[:, -1]

    def motion(t: np.ndarray) -> np.ndarray:
        t = np.atleast_1d(t)
        which = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(pieces) - 1)
        out = np.empty((len(t), system.size))
        for k in np.unique(which):
            out[which == k] = pieces[k](t[which == k]).T
        return out

    return motion, sample_times(edges)
