"""The quadratic programme of one control step.

The unknown is the deviation c from the regulator over the next H periods, vⱼ = −gainⱼ ξⱼ + rootⱼ cⱼ
(the "closed-loop paradigm": J. A. Rossiter, B. Kouvaritakis, M. J. Rice, *A numerically robust
state-space approach to stable-predictive control strategies*, Automatica 34, 1998). The whole cost
to the end of the course is then a constant plus |c|²:

    min ½ |c|²   subject to   low − M ξ ≤ T c ≤ high − M ξ

with rows for corrections, for their changes where input rates are limited, and for state limits.
If c = 0 satisfies all limits, it is the solution; otherwise OSQP computes it. Rows for states are
added only if the solution without them violates one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from planner.errors import solver_answer
from planner.machine.feedback.reference import Reference, Regulator
from planner.support.arrays import Array
from planner.support.interrupts import osqp_result

LIMIT_ROUNDING = 1e-9
"""Excess over a limit that counts as rounding, rad/s or rad."""

STATE_TOLERANCE_RAD = 1e-6
"""Excess over a state limit that OSQP's tolerance may leave, rad."""

KEPT_STEPS = 2000
"""Largest number of programmes kept for later samples, some 50 kB each."""

Rows = tuple[Array, Array, Array, Array]
"""Constraint rows: M (r, n), T (r, 2H), least values (r,) and greatest values (r,)."""


@dataclass(frozen=True, eq=False)
class ControlStep:
    """Constraints low ≤ M ξ + T c ≤ high at one instant: m rows, first the 2H corrections.

    Attributes:
        M: Derivative of the rows by the state ξ, (m, n).
        T: Derivative of the rows by c, (m, 2H).
        low: Least values, (m,).
        high: Greatest values, (m,).
        driven: T without the rows for states.
    """

    M: Array
    T: Array
    low: Array
    high: Array
    driven: Array


@dataclass(frozen=True, eq=False)
class Decision:
    """The result of one control step for S samples.

    Attributes:
        corrections: Corrections of the next H periods, (H, 2, S).
        c: Deviations of the corrections from the regulator, (2H, S): OSQP's next first guess.
        fallback: Whether a sample's corrections are a fallback instead of the optimum, (S,).
    """

    corrections: Array
    c: Array
    fallback: NDArray[np.bool_]


class TrackingProgramme:
    """The quadratic programmes of all control steps of one course.

    Args:
        ref: The course.
        law: The regulator along the course.
        horizon: Number of periods H over which limits are kept.
        iterations: Number of OSQP's iterations after which an answer counts as late.
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
        self._step = lru_cache(KEPT_STEPS)(self._assemble)

    @property
    def solve_count(self) -> int:
        """Number of programmes that OSQP has solved."""
        return self._inner.solve_count + self._whole.solve_count

    def empty_decision(self, count: int) -> Decision:
        """Return the decision of S samples before their first step: no correction."""
        H, fell = self.horizon, np.zeros(count, dtype=bool)
        return Decision(np.zeros((H, 2, count)), np.zeros((2 * H, count)), fell)

    def __call__(self, k: int, state: Array, last: Decision) -> Decision:
        """Compute the corrections of one control step.

        Args:
            k: Number of the instant, 0 … K−1.
            state: ξ, (n, S).
            last: The decision one period ago.
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

    def _assemble(self, k: int) -> ControlStep:
        """Assemble the programme of instant k by propagating the regulator; nothing moves after the
        course's end."""
        ref, law, H = self._ref, self._law, self.horizon
        count, size, n = len(ref.feed), ref.q.shape[1], law.F.shape[-1]
        Z, Y = np.eye(n), np.zeros((n, 2 * H))
        kinds: list[list[Rows]] = [[], [], []]
        for j, i in enumerate(range(k, k + H)):
            if i >= count:  # after the end of the course nothing is limited
                for rows, m in zip(kinds, self._kinds, strict=True):
                    wide = np.full(m, np.inf)
                    rows.append((np.zeros((m, n)), np.zeros((m, 2 * H)), -wide, wide))
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
        every = [rows for kind in kinds for rows in kind]
        M, T, low, high = (np.concatenate(column) for column in zip(*every, strict=True))
        return ControlStep(M, T, low, high, T[: self._driven])

    def _solve(self, step: ControlStep, values: Array, guess: Array) -> tuple[Array | None, bool]:
        """Return the deviation c of one sample (None if late), and whether c is a fallback.

        Input limits are always kept. If the state limits cannot be kept, they are widened to the
        states that the regulator reaches when its corrections are clipped to the input limits.
        """
        low, high, d = step.low - values, step.high - values, self._driven
        first = self._inner(step.driven, low[:d], high[:d], guess)
        if first.c is not None:
            reached = step.T[d:] @ first.c
            slack = STATE_TOLERANCE_RAD
            if np.all((reached >= low[d:] - slack) & (reached <= high[d:] + slack)):
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
        """Return the deviation c that clips each correction of the regulator to the input
        limits."""
        c = np.zeros(step.T.shape[1])
        for j in range(0, len(c), 2):
            columns = slice(j, j + 2)
            now = values[columns] + step.T[columns] @ c
            if np.any(step.T[columns, columns]):
                start = np.clip(now, step.low[columns], step.high[columns])
                c[columns] = np.linalg.solve(step.T[columns, columns], start - now)
        return c


def change_range(ref: Reference, i: int) -> tuple[Array, Array]:
    """Return the least and greatest change of corrections in period i that input rates allow.

    The largest change of the course's inputs from one tick to the next is subtracted.
    """
    ramps = np.zeros((1, 2))
    if ref.timing.ticks > 1:
        ramps = np.diff(ref.feed[i], axis=0) / ref.timing.tick
    least = np.minimum(-ref.rate - ramps.min(axis=0), 0.0)
    most = np.maximum(ref.rate - ramps.max(axis=0), 0.0)
    return ref.timing.period * least, ref.timing.period * most


OSQP_TOLERANCE = 1e-5
"""OSQP's absolute and relative tolerance, on unit rows and c, before polishing, which solves the
active rows exactly. Without polishing the small errors of each step add up until the limits of a
later step cannot be kept: with limited input rates on 18 of 50 machines."""

OSQP_STEP = 1.0
"""OSQP's first step size rho, the same for every programme."""

SOLVED_STATUS, INFEASIBLE_STATUSES = 1, (3, 4)
"""OSQP's status for a solution within tolerance, and its statuses for infeasible programmes."""


@dataclass(frozen=True, eq=False)
class ProgrammeResult:
    """Answer of OSQP to one programme.

    Attributes:
        c: The solution, or None without a solution.
        infeasible: Whether no point keeps all limits. If this is false and c is None, OSQP was too
            late.
    """

    c: Array | None
    infeasible: bool


class Solver:
    """OSQP, set up once for programmes of one shape, whose rows are updated in place.

    An answer depends only on its programme and guess, not on earlier ones. So replays are
    repeatable, and a sample does not depend on the others that run with it.

    Args:
        mask: Entries of T that can differ from zero, (m, p).
        iterations: Number of iterations after which an answer is late.

    Attributes:
        solve_count: Number of programmes solved.
    """

    def __init__(self, mask: NDArray[np.bool_], iterations: int) -> None:
        columns, rows = np.nonzero(mask.T)
        self._entries, self._length = (rows, columns), np.ones(len(mask))
        self._rested: Array = np.zeros(len(mask))
        self._loaded: Any = None
        self.solve_count = 0
        self._shape, self._iterations = mask.shape, iterations
        self._osqp = osqp.OSQP()

    def __call__(self, T: Array, low: Array, high: Array, guess: Array) -> ProgrammeResult:
        """Minimise ½ |c|² subject to low ≤ T c ≤ high.

        Args:
            T: Rows (m, p); not read again if it is the same object as last time.
            low: Least values, (m,).
            high: Greatest values, (m,).
            guess: First guess, (p,).
        """
        result = solver_answer(lambda: self._result(T, low, high, guess), lambda _: None)
        if result is None:
            return ProgrammeResult(None, False)
        if result.info.rho_updates:
            self._osqp.update_settings(rho=OSQP_STEP)
        self.solve_count += 1
        status = result.info.status_val
        if status == SOLVED_STATUS:
            return ProgrammeResult(np.array(result.x), False)
        return ProgrammeResult(None, status in INFEASIBLE_STATUSES)

    def _result(self, T: Array, low: Array, high: Array, guess: Array) -> Any:
        """Return the result of OSQP itself; for the arguments see `__call__`."""
        if self._loaded is None:
            self._set_up()
        if T is not self._loaded:
            length = np.linalg.norm(T, axis=1)
            self._length = np.where(length > 0, length, 1.0)
            self._osqp.update(Ax=(T / self._length[:, None])[self._entries])
            self._loaded = T
        self._osqp.update(l=low / self._length, u=high / self._length)
        self._osqp.warm_start(x=guess, y=self._rested)
        return osqp_result(self._osqp)

    def _set_up(self) -> None:
        """Give OSQP the shape of all programmes, with limits so wide that none is active."""
        unknowns = self._shape[1]
        free = np.full(len(self._length), np.inf)
        self._osqp.setup(
            sp.eye(unknowns, format="csc"),
            np.zeros(unknowns),
            sp.csc_matrix((np.ones(len(self._entries[0])), self._entries), self._shape),
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
            max_iter=self._iterations,
            polishing=True,
        )
