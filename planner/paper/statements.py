"""The paper's statements about its prototype, and the quantities in them as replays compute them.

`statements.toml` has the statements, and the range of each parameter of the prototype with its
source.

The paper gives no data sheet, but its Figs 2 and 3 show two servo motors, friction disks, bevel
gears, timing belts and long shafts on a bench. So the range of each parameter is that of typical
parts, and is taken as the central 95 % of a log-normal distribution. `planner.paper.fit` then fits
the parameters within these ranges to the paper's statements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planner.machine.friction.contact_load import largest_load
from planner.machine.machine import Machine, draw
from planner.machine.simulate import simulate
from planner.plan.plan import Plan
from planner.support.arrays import Array
from planner.support.files import read_toml
from planner.systems.manipulator import Manipulator

STEP_S = 0.01
"""Step of the replays, s: its error of about 0.0002 deg is far below a figure's reading error.

The motion is recorded at the same step. Where a gearhead reverses, the motor deviates from its
command for less than 0.05 s. With one record per 0.05 s, the rms would depend on the time of the
reversal (0.26 to 0.38 %)."""

SETTLE_S = 0.5

COUNT_FROM_S = 0.5
"""Time, s, before which deviations are ignored, since the first jump hides them in the figure."""


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper that states a number about the prototype.

    Attributes:
        text: The statement.
        target: The stated number.
        tolerance: Standard deviation of the stated number.
        unit: Unit of target and tolerance.
        bound: Whether the paper says "at most"; then any value below the target agrees.
    """

    text: str
    target: float
    tolerance: float
    unit: str
    bound: bool = False

    @property
    def target_text(self) -> str:
        """Value or bound that the paper states, in words, such as "at most 5 deg"."""
        return f"{'at most ' if self.bound else ''}{self.target:g} {self.unit}"


_DATA = read_toml(Path(__file__).with_name("statements.toml"), "a table of the paper's statements")

STATEMENTS = tuple(Statement(*row) for row in _DATA["statements"])


@dataclass(frozen=True, eq=False)
class PaperReplays:
    """Replays of one plan on S single machines.

    Attributes:
        t: Recorded times, (R,), s.
        error: True minus planned angle, (S, R, n), deg.
        motors: Speed of the motors, (S, R, 2), as a percentage of the peak of each command.
        gap: Speed minus command of the motors, (S, R, 2), as a percentage of that peak.
        largest: Largest |error| over all steps, (S, n), deg.
        torque_share: Largest torque that the contacts require of motor 1, (S,), % of its limit.
    """

    t: Array
    error: Array
    motors: Array
    gap: Array
    largest: Array
    torque_share: Array

    @property
    def statements(self) -> Array:
        """Values of the five `STATEMENTS` on each machine, (S, 5), in the statements' units."""
        counted = (self.t >= COUNT_FROM_S) & (self.t < self.t[-1] - SETTLE_S - 1e-9)
        rms = np.sqrt(np.mean(self.gap[:, counted] ** 2, axis=1))
        return np.column_stack([self.largest[:, [2, 1]], rms, self.torque_share])


def nominal_machine(values: Mapping[str, float], **changes: object) -> Machine:
    """Return the prototype with given parameters and changed effects, without any spread."""
    return Machine.prototype(step_s=STEP_S).nominal().with_(**{**settings(values), **changes})


def move(plan: Plan, machine: Machine, points: Sequence[Mapping[str, float]]) -> PaperReplays:
    """Replay a plan on S machines, one per parameter set in `points`, otherwise like `machine`."""
    system = plan.problem.system
    assert isinstance(system, Manipulator)
    base = draw(machine, system.size - 1, np.arange(len(points)), 0)
    rows = [settings(p) for p in points]
    given = {name: np.array([row[name] for row in rows]).T for name in rows[0]}
    changed = {name: np.broadcast_to(x, base[name].shape) for name, x in given.items()}
    draws = replace(base, values={**base.values, **changed})
    run = simulate(plan, machine, draws, settle_s=SETTLE_S, record_s=STEP_S)
    u = np.where((run.t < plan.duration)[:, None], plan.trajectory.u(run.t), 0.0)
    peak = np.max(np.abs(u), axis=0) / 100
    q = plan.trajectory.q(plan.t)
    load = largest_load(system, draws, q, system.rates(q, plan.trajectory.u(plan.t)))
    return PaperReplays(
        t=run.t,
        error=np.rad2deg(run.q - plan.trajectory.q(run.t))[:, :, 1:],
        motors=run.motor_rates / peak,
        gap=(run.motor_rates - u) / peak,
        largest=np.rad2deg(run.deviation),
        torque_share=100 * load.motor_nm / draws["torque_limit_nm"][0],
    )


def values(x: Array) -> dict[str, float]:
    """Convert standardised parameters x (P,) to values: 0 is a range's centre, ±2 are its ends."""
    pairs = zip(FITTED_PARAMETERS, x, strict=True)
    return {r.key: r.centre * float(np.exp(r.width * xi)) for r, xi in pairs}


def settings(parameters: Mapping[str, float]) -> dict[str, float | list[float]]:
    """Convert parameters by key to effects of a machine; values of single joints form a list."""
    out: dict[str, float | list[float]] = {}
    for key, value in parameters.items():
        name, *joint = key.split(JOINT_MARK)
        out[name] = [*np.atleast_1d(out.get(name, [])).tolist(), value] if joint else value
    return out


JOINT_MARK = " of joint "
"""Text between effect and joint in the key of a parameter."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of the prototype that is fitted, with its range.

    Attributes:
        name: Effect of the machine, in the unit of the `[machine]` table.
        low, high: Ends of the range, the central 95 % of a log-normal distribution.
        source: Where the range comes from.
        joint: The joint, if joints 2 and 3 have separate values.
    """

    name: str
    low: float
    high: float
    source: str
    joint: int | None = None

    @property
    def key(self) -> str:
        """Unique name of the parameter: effect and joint."""
        return self.name if self.joint is None else f"{self.name}{JOINT_MARK}{self.joint}"

    @property
    def centre(self) -> float:
        """Geometric mean of the range."""
        return float(np.sqrt(self.low * self.high))

    @property
    def width(self) -> float:
        """Standard deviation of the parameter's logarithm: a quarter of the logarithm's range."""
        return float(np.log(self.high / self.low) / 4)


FITTED_PARAMETERS = tuple(Parameter(*row) for row in _DATA["fitted"])
"""The fitted parameters, in the order of the signal path."""

FIXED_PARAMETERS: dict[str, str] = _DATA["fixed"]
"""Source of the value of each fixed parameter, which no statement of the paper determines."""

SPREADS: dict[str, float] = _DATA["spreads"]
"""Spread between machines by effect, as a share of the value, from manufacture and assembly."""
