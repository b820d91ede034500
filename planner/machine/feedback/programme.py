"""The quadratic programme of one control step.

The unknown is the deviation c from the regulator over the next H periods, vⱼ = −gainⱼ ξⱼ + rootⱼ cⱼ
(the "closed-loop paradigm": J. A. Rossiter, B. Kouvaritakis, M. J. Rice, *A numerically robust
state-space approach to stable-predictive control strategies*, Automatica 34, 1998). The whole cost
to the end of the course is then a constant plus |c|²:

    min ½ |c|²   subject to   low − M ξ ≤ T c ≤ high − M ξ

with rows for corrections, for their changes where input rates are limited, and for state limits.
If c = 0 satisfies all limits, it is the solution; otherwise OSQP computes it. Rows of states are
added only if the solution without them violates one; otherwise it is the solution with them too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from planner.machine.feedback.reference import Reference, Regulator
from planner.support.arrays import Array
from planner.support.interrupts import osqp_result

LIMIT_ROUNDING = 1e-9
"""Excess over a limit (rad/s or rad) that counts as rounding."""

STATE_TOLERANCE_RAD = 1e-6
"""Excess over a state limit (rad) that OSQP's tolerance may leave."""

KEPT_STEPS = 2000
"""Programmes that are kept for the next samples, some 50 kB each."""

Rows = tuple[Array, Array, Array, Array]
"""M (r, n), T (r, 2H), least and greatest values (r,)."""


@dataclass(frozen=True, eq=False)
class ControlStep:
    """The programme of one instant; m rows, the first 2H of which are the corrections.

    Attributes:
        M: Rows' values for c = 0 by state, (m, n).
        T: Their change with c, (m, 2H).
        low: Least values, (m,).
        high: Greatest values, (m,).
        driven: T without the rows of states.
    """

    M: Array
    T: Array
    low: Array
    high: Array
    driven: Array


@dataclass(frozen=True, eq=False)
class Decision:
    """What one control step decides for S samples.

    Attributes:
        corrections: Of the next H periods, (H, 2, S).
        c: Their deviations from the regulator, (2H, S): where OSQP starts next time.
        fallback: Where they are cruder than they should be, (S,).
    """

    corrections: Array
    c: Array
    fallback: NDArray[np.bool_]


class TrackingProgramme:
    """All control steps of one course.

    Args:
        ref: The course.
        law: Its regulator.
        horizon: Periods H that limits are looked at.
        iterations: OSQP's iterations after which an answer counts as late.
    """

    def __init__(self, ref: Reference, law: Regulator, horizon: int, iterations: int) -> None:
        self._ref, self._law = ref, law
        self.horizon = min(horizon, len(ref.feed))
        rated = bool(np.any(np.isfinite(ref.rate)))
        self._kinds = [2, 2 if rated else 0, ref.rows.shape[1]]
        lower = np.kron(np.tril(np.ones((self.horizon, self.horizon))), np.ones((1, 2))) > 0
        mask = np.concatenate([np.repeat(lower, kind, axis=0) for kind in self._kinds])
        self._driven = self.horizon * (self._kinds[0] + self._kinds[1])
        self._inner = Solver(mask[: self._driven], iterations)
        self._whole = Solver(mask, iterations)
        self._step = lru_cache(KEPT_STEPS)(self._assembled)

    @property
    def solve_count(self) -> int:
        """How many programmes OSQP has solved."""
        return self._inner.solve_count + self._whole.solve_count

    def empty_decision(self, count: int) -> Decision:
        """What S samples have decided before their first step: nothing."""
        H, fell = self.horizon, np.zeros(count, dtype=bool)
        return Decision(np.zeros((H, 2, count)), np.zeros((2 * H, count)), fell)

    def __call__(self, k: int, state: Array, last: Decision) -> Decision:
        """Decide.

        Args:
            k: The instant, 0 … K−1.
            state: ξ, (n, S).
            last: What was decided one period ago.
        """
        step, size = self._step(k), 2 * self.horizon
        values = step.M @ state
        low, high = step.low[:, None], step.high[:, None]
        bound = np.any((values < low - LIMIT_ROUNDING) | (values > high + LIMIT_ROUNDING), axis=0)
        v, c = values[:size].copy(), np.zeros((size, state.shape[1]))
        fell = np.zeros(state.shape[1], dtype=bool)
        for i in np.nonzero(bound)[0]:
            guess = np.append(last.c[2:, i], [0.0, 0.0])
            solution, fell[i] = self._solve(step, values[:, i], guess)
            if solution is None:
                v[:, i] = np.append(last.corrections[1:, :, i], [0.0, 0.0])
            else:
                c[:, i] = solution
                v[:, i] += step.T[:size] @ solution
        v = np.clip(v, low[:size], high[:size])
        return Decision(v.reshape(self.horizon, 2, -1), c, fell)

    def _assembled(self, k: int) -> ControlStep:
        """Roll the regulator out from instant k; after the course's end nothing moves."""
        ref, law, H = self._ref, self._law, self.horizon
        count, size, n = len(ref.feed), ref.q.shape[1], law.F.shape[-1]
        Z, Y = np.eye(n), np.zeros((n, 2 * H))
        kinds: list[list[Rows]] = [[], [], []]
        for j, i in enumerate(range(k, k + H)):
            if i >= count:
                for rows, wanted in zip(kinds, self._kinds, strict=True):
                    rows.append(_free_rows(wanted, n, 2 * H))
                continue
            M, T = -law.gain[i] @ Z, -law.gain[i] @ Y
            T[:, 2 * j : 2 * j + 2] += law.root[i]
            kinds[0].append((M, T, ref.low[i], ref.high[i]))
            if self._kinds[1]:
                w = slice(size, size + 2)
                kinds[1].append((M - Z[w], T - Y[w], *change_range(ref, i)))
            Z, Y = law.F[i] @ Z + law.G[i] @ M, law.F[i] @ Y + law.G[i] @ T
            C = ref.rows[i]
            kinds[2].append((C @ Z[:size], C @ Y[:size], ref.floor[i], ref.ceiling[i]))
        M, T, low, high = (
            np.concatenate([rows[column] for kind in kinds for rows in kind]) for column in range(4)
        )
        return ControlStep(M, T, low, high, T[: self._driven])

    def _solve(self, step: ControlStep, values: Array, guess: Array) -> tuple[Array | None, bool]:
        """c, and whether it is a fallback; None when there is no answer in time.

        State limits that cannot be kept are widened to what the regulator, clipped to the inputs'
        limits, makes of them: never more, and never at the cost of an input limit.
        """
        low, high, d = step.low - values, step.high - values, self._driven
        first = self._inner(step.driven, low[:d], high[:d], guess)
        if first.c is not None:
            reached = step.T[d:] @ first.c
            if np.all(
                (reached >= low[d:] - STATE_TOLERANCE_RAD)
                & (reached <= high[d:] + STATE_TOLERANCE_RAD)
            ):
                return first.c, False
            guess = first.c
        result = self._whole(step.T, low, high, guess)
        if not result.infeasible:
            return result.c, result.c is None
        clipped = self._clip(step, values)
        reached = step.T[d:] @ clipped
        low[d:], high[d:] = np.minimum(low[d:], reached), np.maximum(high[d:], reached)
        result = self._whole(step.T, low, high, clipped)
        return (clipped if result.c is None else result.c), True

    def _clip(self, step: ControlStep, values: Array) -> Array:
        """The c of the regulator with each correction clipped to its limits in turn."""
        c = np.zeros(step.T.shape[1])
        for j in range(0, len(c), 2):
            columns = slice(j, j + 2)
            now = values[columns] + step.T[columns] @ c
            if np.any(step.T[columns, columns]):
                wanted = np.clip(now, step.low[columns], step.high[columns])
                c[columns] = np.linalg.solve(step.T[columns, columns], wanted - now)
        return c


def change_range(ref: Reference, i: int) -> tuple[Array, Array]:
    """Least and greatest v − w of period i: what the input rates' limit leaves beside the course.

    The course's own change is that of its steepest tick.
    """
    ramps = np.zeros((1, 2))
    if ref.timing.ticks > 1:
        ramps = np.diff(ref.feed[i], axis=0) / ref.timing.tick
    least = np.minimum(-ref.rate - ramps.min(axis=0), 0.0)
    most = np.maximum(ref.rate - ramps.max(axis=0), 0.0)
    return ref.timing.period * least, ref.timing.period * most


def _free_rows(rows: int, n: int, width: int) -> Rows:
    """Rows of a period after the course's end, where nothing moves: free."""
    wide = np.full(rows, np.inf)
    return np.zeros((rows, n)), np.zeros((rows, width)), -wide, wide


OSQP_TOLERANCE = 1e-5
"""OSQP's absolute and relative tolerance, on unit rows and c, before it polishes its answer: from
the active rows it then solves exactly. Left at this tolerance, small errors of each step drive the
arm to where limits of the next cannot be kept: with limited input rates on 18 of 50 machines."""

OSQP_STEP = 1.0
"""OSQP's first step size rho, the same for every programme."""

SOLVED_STATUS, INFEASIBLE_STATUSES = 1, (3, 4)
"""OSQP's status of a solution within tolerance, and those that say there is none."""


@dataclass(frozen=True, eq=False)
class ProgrammeResult:
    """What OSQP found.

    Attributes:
        c: The solution; None when there is none.
        infeasible: Whether no point keeps all limits; otherwise, without a solution, it was late.
    """

    c: Array | None
    infeasible: bool


class Solver:
    """Set up once; rows are updated in place.

    An answer depends on its programme and guess alone, not on those solved before: a replay is the
    same again, and a sample the same whichever others run with it.

    Args:
        mask: Which entries of T can differ from zero, (m, p).
        iterations: After how many an answer is late.

    Attributes:
        solve_count: How many programmes it has solved.
    """

    def __init__(self, mask: NDArray[np.bool_], iterations: int) -> None:
        columns, rows = np.nonzero(mask.T)
        self._entries, self._length = (rows, columns), np.ones(len(mask))
        self._rested: Array = np.zeros(len(mask))
        self._loaded: Any = None
        self.solve_count = 0
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
            rho=OSQP_STEP,
            adaptive_rho_interval=50,
            check_termination=10,
            eps_abs=OSQP_TOLERANCE,
            eps_rel=OSQP_TOLERANCE,
            eps_prim_inf=OSQP_TOLERANCE,
            max_iter=iterations,
            polishing=True,
        )

    def __call__(self, T: Array, low: Array, high: Array, guess: Array) -> ProgrammeResult:
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
            self._osqp.update_settings(rho=OSQP_STEP)
        self.solve_count += 1
        status = result.info.status_val
        if status == SOLVED_STATUS:
            return ProgrammeResult(np.array(result.x), False)
        return ProgrammeResult(None, status in INFEASIBLE_STATUSES)
