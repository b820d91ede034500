"""Small changes of the motors' angles, so that the nominal machine stays near the plan's path.

It is the Gauss-Newton method on motions of the nominal machine (J. Nocedal, S. J. Wright, Numerical
Optimization, 2006, p. 254); the changes are linear between knots. The largest errors of the joints
over time have the largest weights; goal and waypoints ("pins") have weights of their own. The
quadratic programmes are bounded by the limits of the inputs and by all that the problem requires of
coordinates at all times. Each step is tried with several lengths at once, as variants of the
commands in one simulation. Finally only the goal is corrected, on the machine with its own time
step and the motors' resolution.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from operator import itemgetter

import numpy as np
import osqp
import scipy.sparse as sp

from planner.errors import solver_answer
from planner.machine.feedback.programme import INFEASIBLE_STATUSES
from planner.machine.feedforward.shaping import CommandShape
from planner.machine.feedforward.variants import SAFE, Runs, Variants
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.interrupts import osqp_result

PROBES_RAD = np.deg2rad([0.3, 0.05])
"""Changes of the correction at one knot for finite differences: a fifteenth of the joints' lost
motion, to see beyond the next few steps; and a smaller change, once the first gains no more."""

CHEAP_WEIGHTS, CHEAP_PRICE, NEAR_DEG = (3.0, 1.0), 0.5, 0.1
"""The first searches, for the least mean square, take pins (goal and waypoints) lightly (penalty
method, Nocedal and Wright, p. 497), since a first step that removes a miss of 9 degrees leads four
joints to a motion 12 degrees off its path where there is one within 6: weight of the pins in the
programmes of each search, relative to the joints' errors; cost of missing a pin by 1 degree,
relative to the largest error; and largest miss that needs no other search. The best goes on."""

POWERS, PIN_WEIGHT, PIN_PRICE = (2, 8, 32), 30.0, 4.0
"""Powers of the norm of the errors in the searches that follow, and weight and cost of the pins
there. The mean square converges from far away; power 32 is near the maximum, by which plans are
judged."""

MOST_ROUNDS, LEAST_GAIN = 8, 0.02
"""Largest number of rounds of each search; and least gain of a round that justifies another round,
as a fraction of the measure."""

RIDGE = 0.05
"""Weight of a correction's change between knots, relative to an equal error of every joint."""

STEPS = (0.01, 0.1, 1.0, 10.0)
"""Levenberg weights tried in a round, as multiples of the weight that the last round left."""

PARTS = (1.0, 0.5, 0.2)
"""Fractions of each computed step that are tried."""

GOOD_DEG = 0.4
"""Largest error of a motion that is good enough, a fifth of the median error that spreads leave.
Also what reaching the goal may cost any motion."""

PIN_TOLERANCE_RAD = np.deg2rad(0.01)
"""Largest miss of a pin (goal or waypoint) that is good enough: a fifth of `PINNED_DEG`."""

NEAR_MARGIN = 0.05
"""Margin below which a requirement bounds the programmes, in the requirement's scale."""

PIN_SLACK_RAD = np.deg2rad(0.03)
"""Largest miss of a pin without a cost."""

FIRST_DAMPING, DAMPINGS = 0.01, (1e-4, 1e3)
"""Levenberg weight at the beginning of a search; and least and largest at that of a round."""

PINNED_DEG = 0.05
"""Largest miss of the goal or a waypoint that the judge allows."""

END_ROUNDS, PIN_GAIN = 10, 0.75
"""Largest number of final rounds; and largest fraction of the miss that a step may leave. Of such
steps a round takes the one that costs the motion least; without any, the one that leaves least."""

SPANS = ((0, 4), (0, 2), (2, 4), (0, 1), (1, 2), (2, 3), (3, 4))
"""Ranges of knots, in quarters, that the final rounds change."""


class Correction:
    """Correction of a plan's commands that keeps the nominal machine near the plan's path.

    Args:
        plan: The plan whose motion is wanted.
        machine: The machine to compensate for.
        shape: The plan's commands without a correction.
        most_deg: Largest error that reaching the goal may cost, degrees: that of the plan as it is.

    Attributes:
        knots: Times of the knots, (m,), s; the correction is zero at the first.
        values: Corrections at the knots, (m, 2), rad.
        rounds: Number of rounds that reduced the errors.
        keeps_all: Whether the corrected motion ends at the goal and breaks no requirement.
    """

    def __init__(
        self, plan: Plan, machine: Machine, shape: CommandShape, most_deg: float = np.inf
    ) -> None:
        self._variants, self._shape, self._most = Variants(plan, machine, shape), shape, most_deg
        self.knots = self._variants.knots
        self.values = np.zeros((len(self.knots), 2))
        self.rounds, self.keeps_all = 0, False

    def _measure(self, runs: Runs, values: Array, power: int, price: float) -> float:
        """Return the objective of the search, degrees: a norm of the errors plus costs of missed
        pins and limits."""
        size = np.abs(runs.errors)
        largest = max(float(size.max()), 1e-9)
        norm = largest * float(np.mean((size / largest) ** power)) ** (1 / power)
        rough = RIDGE * float(np.linalg.norm(np.rad2deg(np.diff(values, axis=0))))
        off = np.maximum(np.abs(runs.pins) - np.rad2deg(PIN_SLACK_RAD), 0.0)
        missed = float(np.linalg.norm(off))
        violation = float(np.max(np.maximum(-runs.margins, 0.0), initial=0.0))
        return float(np.hypot(norm, rough)) + price * missed + 100.0 * violation

    @property
    def commands(self) -> Array:
        """The corrected commands as sent to the motors, (K, 2), rad/s."""
        return self._shape.commands(self.values[:, :, None], self.knots)[:, :, 0]

    def search(self) -> None:
        """Search for the correction, and keep the best one found in `values`.

        Raises:
            TimeUpError: If time is up; the best correction so far is kept.
        """
        start, found = (self._variants.run(self.values[:, :, None])[0], self.values, 0), []
        try:
            for weight in CHEAP_WEIGHTS:
                now, self.values, self.rounds = start
                now = self._run_rounds(now, 2, weight, CHEAP_PRICE)
                cost = self._measure(now, self.values, 2, CHEAP_PRICE)
                found.append((cost, now, self.values, self.rounds))
                if np.max(np.abs(now.pins)) <= NEAR_DEG:
                    break
        finally:
            if found:
                _, now, self.values, self.rounds = min(found, key=itemgetter(0))
        for power in POWERS:
            now = self._run_rounds(now, power, PIN_WEIGHT, PIN_PRICE)
        now = self._pin()
        missed = float(np.max(np.abs(now.pins)))
        self.keeps_all = bool(missed < PINNED_DEG and np.min(now.margins, initial=0.0) >= -SAFE)

    def _run_rounds(self, now: Runs, power: int, pin_weight: float, price: float) -> Runs:
        """Improve the correction in rounds of one search; return the new motion."""
        best, damping = self._measure(now, self.values, power, price), FIRST_DAMPING
        probes = list(PROBES_RAD)
        if not self.rounds:  # even a tiny correction makes a resting motor cross its play
            best = np.inf
        for _ in range(MOST_ROUNDS):
            deadline.check()
            if self._is_good(now):
                break
            slopes = self._variants.slopes(self.values, probes[0])
            weights = [damping * step for step in STEPS]
            steps = zip(weights, self._steps(now, slopes, weights, power, pin_weight), strict=True)
            candidates = [
                (weight, self.values + part * step)
                for weight, step in steps
                if step is not None
                for part in PARTS
            ]
            if not candidates:
                break
            runs = self._variants.run(np.stack([values for _, values in candidates], axis=2))
            tried = enumerate(candidates)
            measures = [self._measure(runs[k], v, power, price) for k, (_, v) in tried]
            k = int(np.argmin(measures))
            gain = best - measures[k]
            if gain > 0:
                damping = float(np.clip(3 * candidates[k][0], *DAMPINGS))
                self.values, now, best = candidates[k][1], runs[k], measures[k]
                self.rounds += 1
            else:
                damping = min(30 * damping, DAMPINGS[1])
            if not gain >= LEAST_GAIN * best:
                probes.pop(0)
                if not probes:
                    break
        return now

    def _is_good(self, runs: Runs) -> bool:
        """Return whether the remaining errors are small compared with those that spreads cause."""
        missed = np.max(np.abs(runs.pins))
        largest = np.max(np.abs(runs.errors))
        is_safe = np.min(runs.margins, initial=0.0) >= 0
        return bool(is_safe and missed <= np.rad2deg(PIN_SLACK_RAD) and largest <= GOOD_DEG)

    def _steps(
        self, now: Runs, slopes: Runs, weights: list[float], power: int, pin_weight: float
    ) -> list[Array | None]:
        """Return the changes of the correction, (m, 2), rad, one for each Levenberg weight; None if
        the programme has no solution."""
        size = np.abs(now.errors)
        weight = np.maximum(size / max(float(size.max()), 1e-9), 0.1) ** (power / 2 - 1)
        weight = weight / np.sqrt(np.sum(weight**2))
        A, e = slopes.errors.T * weight[:, None], now.errors * weight
        pins = pin_weight / np.sqrt(len(now.pins))
        B, b = slopes.pins.T * pins, now.pins * pins
        m = len(self.knots)
        D = np.kron(np.diff(np.eye(m), axis=0)[:, 1:], np.eye(2))
        R, r = RIDGE * D, RIDGE * D @ np.rad2deg(self.values[1:]).ravel()
        H = A.T @ A + B.T @ B + R.T @ R
        g = A.T @ e + B.T @ b + R.T @ r
        near = now.margins < NEAR_MARGIN
        rows = [D, slopes.margins.T[near]]
        low_input, high_input = self._input_room()
        free = np.full(int(near.sum()), np.inf)
        low = np.concatenate([low_input, -now.margins[near]])
        high = np.concatenate([high_input, free])
        bounds, out = sp.csc_matrix(np.concatenate(rows)), []
        for damping in weights:
            P = sp.csc_matrix(np.triu(H + damping * np.eye(len(H))))
            x = solver_answer(partial(_minimum, P, g, bounds, low, high), lambda _: np.empty(0))
            step = np.zeros((m, 2))
            if is_found := x.shape == g.shape and bool(np.all(np.isfinite(x))):
                step[1:] = np.deg2rad(x).reshape(-1, 2)
            out.append(step if is_found else None)
        return out

    def _input_room(self) -> tuple[Array, Array]:
        """Return the least and largest change of the correction between knots, (2(m−1),) each,
        degrees, that keeps the inputs within their limits."""
        shape = self._shape
        u = shape.commands(self.values[:, :, None], self.knots, is_rounded=False)[:, :, 0]
        begins = np.searchsorted(shape.t[:-1], self.knots)
        spans = np.diff(self.knots)[:, None]
        low, high = np.empty((len(spans), 2)), np.empty((len(spans), 2))
        for k, (a, b) in enumerate(pairwise(begins)):
            part = u[a : max(b, a + 1)]
            # Ignore a tick or two at the limit, in which a gearhead crosses its play.
            low[k], high[k] = np.percentile(part, [10, 90], axis=0)
        least = np.minimum(-(shape.limit + low), 0.0) * spans
        most = np.maximum(shape.limit - high, 0.0) * spans
        return np.rad2deg(least).ravel(), np.rad2deg(most).ravel()

    def _pin(self) -> Runs:
        """Correct only the misses of goal and waypoints; return the resulting motion."""
        now = self._variants.run(self.values[:, :, None], is_sent=True)[0]
        self._most = max(self._most, float(np.abs(now.errors).max()) + GOOD_DEG)
        for _ in range(END_ROUNDS):
            missed = float(np.max(np.abs(now.pins)))
            if missed <= np.rad2deg(PIN_TOLERANCE_RAD):
                break
            deadline.check()
            step = self._best_of(self._pin_steps(now), now, PIN_GAIN)
            if not step or (step[0] >= 0 and missed < PINNED_DEG):  # or it costs more than it gains
                break
            _, self.values, now = step
        return now

    def _best_of(self, steps: Array, now: Runs, gain: float) -> tuple[float, Array, Runs] | None:
        """Return the step that costs least among those that reduce the miss enough.

        Args:
            steps: The steps (m, 2, S); fractions of them are tried too.
            now: The present motion.
            gain: Largest fraction of the miss that a step may leave; if every step leaves more, the
                one that leaves least is taken.

        Returns:
            Increase of the cost, degrees, correction and motion; None if no step reduces the miss.
        """
        missed = float(np.max(np.abs(now.pins)))
        trials = self.values[:, :, None] + np.concatenate([p * steps for p in PARTS], axis=2)
        runs = self._variants.run(trials, is_sent=True)
        least, sizes = np.min(runs.margins, axis=1, initial=0.0), np.abs(runs.errors).max(axis=1)
        is_allowed = least >= min(-SAFE, float(np.min(now.margins, initial=0.0)))
        is_allowed &= sizes <= self._most
        misses = np.where(is_allowed, np.abs(runs.pins).max(axis=1), np.inf)
        if np.min(misses) >= missed:
            return None
        enough = max(gain * missed, float(np.min(misses)))
        price = sizes + PIN_PRICE * misses
        k = int(np.argmin(np.where(misses <= enough, price, np.inf)))
        worse = float(price[k] - np.abs(now.errors).max() - PIN_PRICE * missed)
        return worse, trials[:, :, k], runs[k]

    def _pin_steps(self, now: Runs) -> Array:
        """Return the changes that remove the misses and change the motion least, (m, 2, S), rad.

        One step changes all knots, others a half or a quarter of them, each with every probe. The
        variety helps where motors reverse or are at their limits, since one derivative is not
        reliable there.
        """
        m, out = len(self.knots), []
        cuts = np.linspace(0, 2 * (m - 1), 5).astype(int)
        for probe in PROBES_RAD:
            slopes = self._variants.slopes(self.values, probe)
            J, A = slopes.pins.T, slopes.errors.T
            H = A.T @ A / len(A) + 1e-3 * np.eye(J.shape[1])
            for first, last in SPANS:
                part = slice(cuts[first], cuts[last])
                M = np.linalg.solve(H[part, part], J[:, part].T)
                step = np.zeros(2 * m)
                step[2:][part] = -M @ np.linalg.lstsq(J[:, part] @ M, now.pins, rcond=1e-6)[0]
                out.append(np.deg2rad(step.reshape(m, 2)))
        return np.stack(out, axis=2)


def _minimum(P: sp.csc_matrix, g: Array, A: sp.csc_matrix, low: Array, high: Array) -> Array:
    """Return the x (p,) that minimises ½ x P x + g x for low ≤ A x ≤ high; NaN if OSQP finds
    none."""
    solver = osqp.OSQP()
    solver.setup(P, g, A, low, high, verbose=False, eps_abs=1e-5, eps_rel=1e-5, max_iter=4000)
    result = osqp_result(solver)
    is_infeasible = result.info.status_val in INFEASIBLE_STATUSES  # x is then arbitrary
    return np.full(len(g), np.nan) if is_infeasible else np.asarray(result.x, dtype=float)
