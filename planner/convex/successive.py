"""Successive convexification: a local optimum where requirements are not convex in z.

The requirements are linearised about the last path. Their violations enter the objective as an
augmented Lagrangian (Powell–Hestenes–Rockafellar), the step is kept short by a Levenberg–Marquardt
term, and a step counts only if the true merit falls. The band stays exact throughout: every step is
a call of `cut`. Each programme is again a least-distance one, solved by the active set.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.convex.band import Band
from planner.convex.cuts import NO_TOUCH, Best, Programme, Touch, cut
from planner.convex.frame import Frame
from planner.convex.quadratic import Farkas, Optimum, StalledError, solve_quadratic
from planner.convex.sampled import Rows, Sampled
from planner.systems.base import Array

SIGHT = 0.2
"""Requirements further than this fraction of their limit from being broken are not linearised."""

LEAST_DAMPING = 1e-7
"""Least Levenberg–Marquardt weight, on the merit's scale: keeps the programme well posed."""

FLAT = 1e-3
"""Weight of |y|² beside the level or the peak, which alone leave most of the path free."""

KEPT = 2e-6
"""Largest h at the samples that counts as kept."""


@dataclass(frozen=True)
class Aim:
    """What a local optimum minimises.

    Attributes:
        kind: "smooth" for ∫ω², "peak" for max |ω|, "input" for the level t on the input limits.
        scale: A typical value of it, which makes the merit dimensionless.
    """

    kind: str
    scale: float

    def value(self, frame: Frame, y: Array, t: float) -> float:
        """Half the square (of ω in the mean, of the peak, of the level) over the scale's."""
        if self.kind == "input":
            return t**2 / self.scale**2 / 2
        if self.kind == "peak":
            return frame.peak(y) ** 2 / self.scale**2 / 2
        return float(y @ y) / self.scale**2 / 2


@dataclass(frozen=True)
class Local:
    """Where the succession ended.

    Attributes:
        y: Free coefficients.
        t: Level on the input limits (1 unless it was sought).
        worst: Greatest h at the samples.
        kept: Whether that is within tolerance.
        steps: Programmes solved.
        touch: Points of the band's rows it leans on.
        merit: The augmented Lagrangian it ended with.
    """

    y: Array
    t: float
    worst: float
    kept: bool
    steps: int
    touch: Touch
    merit: Merit


@dataclass
class Merit:
    """The augmented Lagrangian: shifts σ (one a requirement and sample) and weight μ."""

    shift: Array
    weight: float

    def penalty(self, h: Array) -> float:
        """What breaking the requirements by h adds."""
        above = np.maximum(h + self.shift, 0.0)
        return float(self.weight * np.sum(above**2 - self.shift**2) / 2)

    def update(self, h: Array) -> None:
        """Take the multipliers from where a minimum was found."""
        self.shift = np.maximum(h + self.shift, 0.0)

    def harden(self, factor: float) -> None:
        """Raise the weight, the multipliers staying what they are."""
        self.weight *= factor
        self.shift = self.shift / factor


class Succession:
    """One run; `go` may be called again after the requirements were sampled anew.

    Args:
        sampled: What is not convex, at samples.
        band: The convex part of the domain.
        aim: What is minimised.
        y: A path inside the chart's domain to start from.
        warm: A local optimum of a neighbour, whose level and multipliers are taken over.
    """

    def __init__(
        self, sampled: Sampled, band: Band, aim: Aim, y: Array, warm: Local | None = None
    ) -> None:
        self.sampled, self.band, self.aim = sampled, band, aim
        self.frame = sampled.frame
        self.y, self.t, self.steps = y, 1.0, 0
        self.touch = NO_TOUCH
        self.damping = 1e-2 / aim.scale**2
        self.scale = sampled.turn_scale(y)
        rows = self._rows(y, 1.0)
        if aim.kind == "input":
            self.t = max(1.0, 1 + float(rows.h.max(initial=0.0)))
        self.merit = Merit(np.zeros(len(rows.h)), 100.0)
        if warm is not None:
            self.t = warm.t
            samples = len(sampled.samples.piece)
            shift = warm.merit.shift.reshape(len(rows.h) // samples, -1)[:, :samples]
            self.merit = Merit(shift.ravel(), warm.merit.weight)

    def take(self, sampled: Sampled, extra: int) -> None:
        """Go on with other samples, the last `extra` of which are new."""
        self.sampled = sampled
        self.scale = np.append(self.scale, sampled.turn_scale(self.y)[len(self.scale) :])
        table = self.merit.shift.reshape(-1, len(sampled.samples.piece) - extra)
        self.merit.shift = np.pad(table, ((0, 0), (0, extra))).ravel()

    def go(self, max_steps: int) -> Local:
        """Descend until nothing changes, or for `max_steps` programmes.

        Raises:
            StalledError: If the path left the chart's domain, which no step does by itself.
        """
        rows, last, stuck = self._rows(self.y, self.t), np.inf, 0
        end = self.steps + max_steps
        while self.steps < end:
            rows, gain = self._step(rows)
            settled = np.max(np.abs(np.maximum(rows.h, -self.merit.shift)), initial=0.0)
            if gain > max(1e-7, 1e-3 * settled):
                continue
            worst = float(rows.h.max(initial=-1.0))
            stuck = stuck + 1 if worst > 0.5 * last else 0
            if settled <= KEPT or stuck == 3:
                break
            self.merit.update(rows.h)
            if worst > 0.25 * last:
                self.merit.harden(10.0)
            last = worst
            self.damping = min(self.damping, 1.0 / self.aim.scale**2)
        if self.aim.kind == "input":  # any path has a level, converged or not
            peaks = self.sampled.peaks(self.y) / self.sampled.limits.input
            self.t = max(self.t, float(peaks.max()) * (1 + 1e-9))
            rows = self._rows(self.y, self.t)
        worst = float(rows.h.max(initial=-1.0))
        return Local(self.y, self.t, worst, worst <= KEPT, self.steps, self.touch, self.merit)

    def _rows(self, y: Array, t: float) -> Rows:
        rows = self.sampled.rows(y, t, SIGHT, self.scale)
        if rows is None:
            raise StalledError("the path leaves the chart's domain")
        return rows

    def _total(self, y: Array, t: float, h: Array) -> float:
        return self.aim.value(self.frame, y, t) + self.merit.penalty(h)

    def _step(self, rows: Rows) -> tuple[Rows, float]:
        """One accepted step, or none; with the merit's relative gain, 0 when none is to be had."""
        now = self._total(self.y, self.t, rows.h)
        for _ in range(12):
            self.steps += 1
            try:
                y, t = self._solve(rows)
            except StalledError:
                self.damping *= 10
                continue
            hoped = (now - self._model(rows, y, t)) / (abs(now) + 1e-3)
            trial = self.sampled.rows(y, t, SIGHT, self.scale)
            if hoped <= 1e-9:
                return rows, 0.0
            gain = -np.inf
            if trial is not None:
                gain = (now - self._total(y, t, trial.h)) / (abs(now) + 1e-3)
            if trial is not None and gain >= 0.1 * hoped:
                self.y, self.t = y, t
                if gain > 0.6 * hoped:
                    self.damping = max(self.damping / 5, LEAST_DAMPING / self.aim.scale**2)
                return trial, gain
            self.damping *= 5
        return rows, 0.0

    def _model(self, rows: Rows, y: Array, t: float) -> float:
        h = np.minimum(rows.h, -self.merit.shift)  # out of sight: taken as kept
        h[rows.near] = rows.h[rows.near] + rows.J @ (y - self.y) + rows.k * (t - self.t)
        return self._total(y, t, h)

    def _solve(self, rows: Rows) -> tuple[Array, float]:
        step = _StepProgramme(self, rows)
        answer = cut(
            self.frame, self.band, Programme("one step", step.solve, 1e-9, strict=False), self.touch
        )
        if not isinstance(answer, Best):
            raise StalledError("no step inside the band")
        self.touch = answer.touch
        return step.y, step.t


class _StepProgramme:
    """The linearised programme in (y, level, slacks), each scaled to unit weight."""

    def __init__(self, run: Succession, rows: Rows) -> None:
        self.run, self.rows = run, rows
        self.y, self.t = run.y, run.t
        frame, aim, damping = run.frame, run.aim, run.damping
        unit = 1 / aim.scale**2
        own = unit if aim.kind == "smooth" else FLAT * unit
        count = len(rows.near)
        self.weight = np.concatenate(
            [
                np.full(frame.size, own + damping),
                [unit if aim.kind == "peak" else unit + damping],
                np.full(count, run.merit.weight),
            ]
        )
        level = 0.0 if aim.kind == "peak" else run.t * damping / (unit + damping)
        self.centre = np.concatenate([run.y * damping / (own + damping), [level], np.zeros(count)])
        k = rows.k[:, None] if aim.kind == "input" else np.zeros((count, 1))
        self.soft = np.hstack([rows.J, k, -np.eye(count)])
        self.soft_limit = rows.J @ run.y + rows.k * run.t * (aim.kind == "input")
        self.soft_limit -= rows.h[rows.near] + run.merit.shift[rows.near]

    def solve(
        self, frame: Frame, A: Array, b: Array, radius: float, guess: Array | None
    ) -> Optimum | Farkas:
        hard, limit = self._hard(A, b)
        rows = np.concatenate([hard, self.soft])
        shrink = 1 / np.sqrt(self.weight)
        limits = np.concatenate([limit, self.soft_limit]) - rows @ self.centre
        answer = solve_quadratic(rows * shrink, limits, np.inf, "active set alone")
        assert isinstance(answer, Optimum)
        point = self.centre + shrink * answer.y
        self.y = point[: frame.size]
        if self.run.aim.kind == "input":
            self.t = float(point[frame.size])
        return replace(answer, y=self.y, multipliers=answer.multipliers[: len(A)])

    def _hard(self, A: Array, b: Array) -> tuple[Array, Array]:
        """The band's rows, and for the least peak |C y + d| ≤ level."""
        count = self.soft.shape[0]
        wide = np.hstack([A, np.zeros((len(A), 1 + count))])
        if self.run.aim.kind != "peak":
            return wide, b
        C, d = self.run.frame.coefficient_rows()
        one, none = np.ones((len(C), 1)), np.zeros((len(C), count))
        up, down = np.hstack([C, -one, none]), np.hstack([-C, -one, none])
        return np.concatenate([wide, up, down]), np.concatenate([b, -d, d])
