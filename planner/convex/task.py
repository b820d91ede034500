"""One problem made ready: its class of paths, its domain, and the two ways to a plan in it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from planner.convex.band import Band, band_of
from planner.convex.cuts import Above, Best, Impossible, Programme, Touch, cut
from planner.convex.frame import Frame
from planner.convex.local import ROUNDS, Setting, improve
from planner.convex.objectives import lowest_peak, smoothest
from planner.convex.shape import input_shape
from planner.convex.successive import Local
from planner.problem import Problem
from planner.schema.methods import ConvexOptions
from planner.systems.base import Array


@dataclass(frozen=True)
class Task:
    """A problem, the class of paths to plan it in, and what to minimise.

    Attributes:
        problem: The problem.
        options: As given.
        frame: The class at some travel; `frame.at` gives the others.
        band: The convex part of the chart's domain.
        programme: The convex objective.
        setting: What local optima must keep.
    """

    problem: Problem
    options: ConvexOptions
    frame: Frame
    band: Band
    programme: Programme = field(repr=False)
    setting: Setting = field(repr=False)

    @classmethod
    def of(cls, problem: Problem, options: ConvexOptions, start: Array, goal: Array) -> Task:
        """Make a problem ready.

        Args:
            problem: The problem.
            options: Of the method.
            start: z(0), shape (N,).
            goal: z(T), shape (N,), in the same branch of the chart; its first entry is not read.
        """
        aim = {"peak_input": "input"}.get(options.objective, options.objective)
        rated = bool(np.any(np.isfinite(problem.limits.input_rate)))
        linear = options.input == "linear" or (options.input == "auto" and rated)
        engine = "osqp" if options.solver == "osqp" else "active set"
        programme = lowest_peak() if aim == "peak" else smoothest(engine)
        band = band_of(problem, start, goal, options.edge)
        nearest = _nearest(problem)
        margin = None if band.complete else np.minimum(options.edge, nearest / 2)
        shape = input_shape(options.pieces, int(linear))
        setting = Setting(problem, band, margin, nearest, 1.0, aim, options.max_steps)
        setting = replace(setting, duration=_duration(setting))
        return cls(
            problem,
            options,
            Frame(shape, start, goal, 1.0).at(problem.travel or 1.0),
            band,
            replace(programme, tolerance=options.tolerance),
            setting,
        )

    @property
    def aim(self) -> str:
        """ "smooth", "peak" or "input"."""
        return self.setting.aim

    def eased(self) -> Task:
        """The same task, seeking the least peak input."""
        setting = replace(self.setting, aim="input")
        return replace(self, setting=replace(setting, duration=_duration(setting)))

    def level(self, local: Local) -> float:
        """The greatest input over its limit at the problem's duration, for the aim "input"."""
        return local.t * self.setting.duration / (self.problem.duration or self.setting.duration)

    def optimum(self, travel: float, rows: Touch, ceiling: float) -> Best | Impossible | Above:
        """The convex optimum at one travel, of the requirements that are convex; see `cut`."""
        rounds = self.options.max_cuts
        return cut(self.frame.at(travel), self.band, self.programme, rows, rounds, ceiling)

    def complaint(self, frame: Frame, y: Array) -> float:
        """How far a path breaks what is not convex, relative to the limits; ≤ 0 if it keeps it."""
        return self.setting.judge(frame, y).worst

    def improve(
        self, frame: Frame, y: Array, warm: Local | None = None, rounds: int = ROUNDS
    ) -> Local:
        """A local optimum from a path inside the chart's domain; see `improve`."""
        return improve(self.setting, frame, y, self._scale(frame, y), warm, rounds)

    def value(self, frame: Frame, local: Local) -> float:
        """The objective of a local optimum, in the programme's measure (or the level on inputs)."""
        if self.aim == "input":
            return local.t
        return frame.peak(local.y) if self.aim == "peak" else frame.smoothness(local.y)

    def _scale(self, frame: Frame, y: Array) -> float:
        if self.aim == "input":
            return 1.0
        if self.aim == "peak":
            return frame.peak(y)
        return float(np.sqrt(2 * abs(frame.travel) * frame.smoothness(y)))


def _duration(setting: Setting) -> float:
    """The duration that local optima are sought at.

    The least peak input does not depend on it but for scale, so there it is one at which that
    peak is of the order of the limits: the time that straight motions at the limits take.
    """
    problem = setting.problem
    if setting.aim != "input":
        return problem.duration or 1.0
    drive = float(problem.system.drive(problem.start))
    travel = 1.0 if problem.travel is None else problem.travel
    turn = problem.goal[1] - problem.start[1]
    needs = np.abs([travel / drive, turn]) / setting.limits.input
    return float(max(needs.sum(), 1e-3))


def _nearest(problem: Problem) -> Array:
    """The lesser of start's and goal's chart margins, shape (m,)."""
    known = np.where(np.isnan(problem.goal), problem.start, problem.goal)
    ends = np.stack([problem.start, known])
    return np.asarray(problem.system.chart_margins(ends, problem.branch).min(axis=0))
