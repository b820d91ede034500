"""OSQP for programmes of one form: min ½ |c|² subject to low ≤ T c ≤ high."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from planner.interrupts import osqp_result
from planner.systems.base import Array

TOLERANCE = 1e-5
"""OSQP's absolute and relative tolerance, on unit rows and c."""

STEP = 1.0
"""OSQP's first step size rho, the same for every programme."""

SOLVED, INFEASIBLE = 1, (3, 4)
"""OSQP's status of a solution within tolerance, and those that say there is none."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What OSQP found.

    Attributes:
        c: The solution; None when there is none.
        infeasible: Whether no point keeps all limits; otherwise, without a solution, it was late.
        iterations: OSQP's iterations.
    """

    c: Array | None
    infeasible: bool
    iterations: int


class Solver:
    """Set up once; rows are updated in place.

    An answer depends on its programme and guess alone, not on those solved before: a replay is the
    same again, and a sample the same whichever others run with it.

    Args:
        mask: Which entries of T can differ from zero, (m, p).
        iterations: After how many an answer is late.

    Attributes:
        solved: How many programmes it has solved.
    """

    def __init__(self, mask: NDArray[np.bool_], iterations: int) -> None:
        columns, rows = np.nonzero(mask.T)
        self._entries, self._length = (rows, columns), np.ones(len(mask))
        self._rested: Array = np.zeros(len(mask))
        self._loaded: Any = None
        self.solved = 0
        self._osqp = osqp.OSQP()
        T = sp.csc_matrix((np.ones(len(rows)), (rows, columns)), mask.shape)
        free = np.full(len(mask), np.inf)
        self._osqp.setup(
            sp.eye(mask.shape[1], format="csc"),
            np.zeros(mask.shape[1]),
            T,
            -free,
            free,
            verbose=False,
            scaling=0,
            rho=STEP,
            adaptive_rho_interval=50,
            check_termination=10,
            eps_abs=TOLERANCE,
            eps_rel=TOLERANCE,
            eps_prim_inf=TOLERANCE,
            max_iter=iterations,
        )

    def __call__(self, T: Array, low: Array, high: Array, guess: Array) -> Outcome:
        """Solve.

        Args:
            T: Rows (m, p); the same object as last time is not read again.
            low: Least values, (m,).
            high: Greatest values, (m,).
            guess: Where to start, (p,).
        """
        if T is not self._loaded:
            length = np.linalg.norm(T, axis=1)
            self._length = np.where(length > 0, length, 1.0)
            self._osqp.update(Ax=(T / self._length[:, None])[self._entries])
            self._loaded = T
        self._osqp.update(l=low / self._length, u=high / self._length)
        self._osqp.warm_start(x=guess, y=self._rested)
        result = osqp_result(self._osqp)
        if result.info.rho_updates:
            self._osqp.update_settings(rho=STEP)
        self.solved += 1
        status, iterations = result.info.status_val, result.info.iter
        if status == SOLVED:
            return Outcome(np.array(result.x), False, iterations)
        return Outcome(None, status in INFEASIBLE, iterations)
