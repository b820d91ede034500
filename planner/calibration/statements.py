"""What the paper says of its prototype, as numbers that a replay gives for any parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.calibration.ranges import FITTED
from planner.machine import Draws, Machine, draw
from planner.machine.simulate import simulate_draws
from planner.plan import Plan
from planner.reproduce import paper_problem
from planner.solve import solve
from planner.systems.base import Array

STEP_S = 0.01
"""Step of the replays: their error, some 0.0002 deg, is far below what can be read off a figure."""

RECORD_S = 0.05
SETTLE_S = 0.5

BEGUN_S = 0.5
"""Before it, the first command's jump is a line in the figure that no one can read a gap off."""


@dataclass(frozen=True)
class Statement:
    """One sentence of the paper.

    Attributes:
        text: It.
        target: Its number.
        tolerance: How well it is known (standard deviation).
        unit: Of both.
    """

    text: str
    target: float
    tolerance: float
    unit: str


STATEMENTS = (
    Statement("largest error of theta3 (Fig. 9: '5 degree error')", 5.0, 0.1, "deg"),
    Statement("motor 1 off its command, rms (Fig. 10: 'precisely controlled')", 0.0, 1.0, "%"),
    Statement("motor 2 off its command, rms (Fig. 10: 'precisely controlled')", 0.0, 1.0, "%"),
)


def calibration_plan() -> Plan:
    """The paper's polynomial law at the travel of least peak input inside the chart's domain."""
    return solve(paper_problem(), "polynomial")


@dataclass(frozen=True, eq=False)
class Motion:
    """Replays of one plan on S single machines.

    Attributes:
        t: Recorded times, (R,), s.
        error: True minus planned angle, (S, R, n), deg.
        motors: Speed of the motors, (S, R, 2), as a percentage of each command's peak.
        gap: That minus the command, likewise.
        largest: Largest |error| over all steps, (S, n), deg.
    """

    t: Array
    error: Array
    motors: Array
    gap: Array
    largest: Array

    @property
    def statements(self) -> Array:
        """What the paper's statements are about, (S, 3)."""
        on = (self.t >= BEGUN_S) & (self.t < self.t[-1] - SETTLE_S - 1e-9)
        rms = np.sqrt(np.mean(self.gap[:, on] ** 2, axis=1))
        return np.column_stack([self.largest[:, 2], rms])


def nominal(values: Mapping[str, float], **changes: object) -> Machine:
    """The prototype with these parameters, no spread, and whatever else is changed."""
    return Machine.prototype(step_s=STEP_S).nominal().with_(**{**values, **changes})


def move(plan: Plan, machine: Machine, points: Sequence[Mapping[str, float]]) -> Motion:
    """Replay a plan on single machines that differ from `machine` in some parameters."""
    joints = plan.problem.system.size - 1
    base = draw(machine, joints, np.arange(len(points)), 0)
    changed = {
        name: np.stack([np.full(len(base[name]), p[name]) for p in points], axis=1)
        for name in points[0]
    }
    draws = Draws(base.numbers, {**base.values, **changed})
    run = simulate_draws(plan, machine, draws, settle_s=SETTLE_S, record_s=RECORD_S)
    u = np.where((run.t < plan.duration)[:, None], plan.u(run.t), 0.0)
    peak = np.max(np.abs(u), axis=0) / 100
    return Motion(
        t=run.t,
        error=np.rad2deg(run.q - plan.q(run.t))[:, :, 1:],
        motors=run.speed / peak,
        gap=(run.speed - u) / peak,
        largest=np.rad2deg(run.deviation),
    )


def values(x: Array) -> dict[str, float]:
    """Parameters at standardised coordinates x (P,): 0 the centre of each range, ±2 its ends."""
    return {r.name: r.centre * float(np.exp(r.width * xi)) for r, xi in zip(FITTED, x, strict=True)}


def coordinates(parameters: Mapping[str, float]) -> Array:
    """The inverse of `values`, (P,)."""
    return np.array([np.log(parameters[r.name] / r.centre) / r.width for r in FITTED])
