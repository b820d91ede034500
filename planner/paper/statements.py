"""The paper's statements about its prototype, and the quantities in them as replays compute them.

The file also lists the range of each parameter of the prototype, with its source.

The paper gives no data sheet, but its Figs 2 and 3 show two servo motors, friction disks, bevel
gears, timing belts and long shafts on a bench. So the range of each parameter is that of typical
parts, and is taken as the central 95 % of a log-normal distribution. `planner.paper.fit` then fits
the parameters within these ranges to the paper's statements.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.machine.friction.contact_load import largest_load
from planner.machine.machine import Machine, draw
from planner.machine.simulate import simulate
from planner.plan.plan import Plan
from planner.support.arrays import Array
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


STATEMENTS = (
    Statement("largest error of theta3 (Fig. 9: '5 degree error')", 5.0, 0.1, "deg"),
    # An inequality, not a reading: the tolerance is the rounding of the preset to three digits.
    Statement(
        "largest error of theta2 (eq. 29: E is the largest of all joints)", 5.0, 0.01, "deg", True
    ),
    Statement(
        "motor 1: deviation from its command, rms (Fig. 10: 'precisely controlled')", 0.0, 1.0, "%"
    ),
    Statement(
        "motor 2: deviation from its command, rms (Fig. 10: 'precisely controlled')", 0.0, 1.0, "%"
    ),
    # No motor is precisely controlled at its limit.
    Statement("motor 1: largest torque over its limit (Fig. 10)", 100.0, 1.0, "%", True),
)


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


FITTED_PARAMETERS = (
    Parameter(
        "servo_bandwidth_rad_s", 30, 150, "profile filters of small servo drives: 5 to 25 Hz"
    ),
    Parameter(
        "motor_inertia_kgm2", 0.01, 0.04, "rotors of 10 to 40 g cm^2 (20 to 60 W) behind 1:100"
    ),
    Parameter("servo_gain_nms_per_rad", 2.5, 10, "loops of 20 to 80 Hz around 0.02 kg m^2"),
    Parameter("servo_integral_time_s", 0.01, 0.04, "2 to 5 times the time constant of that loop"),
    Parameter("torque_limit_nm", 1, 6, "continuous torque of planetary gearheads of 32 mm"),
    Parameter("creep", 0.001, 0.01, "rolling radius of a loaded polymer tread: 0.1 to 1 % less"),
    Parameter(
        "creep_per_nm", 0.001, 0.02, "0.1 to 1 % of creepage at half of the torque that slips"
    ),
    Parameter(
        "friction_capacity_nm", 0.5, 5, "mu N r: 0.15 to 0.4, 150 to 300 N, 20 to 40 mm of radius"
    ),
    Parameter("disk_inertia_kgm2", 5e-5, 5e-4, "two steel disks, 40 to 80 mm by 8 mm: m r^2/2"),
    Parameter(
        "gearhead_backlash_deg",
        0.25,
        1.0,
        "planetary gearheads of 32 mm; preloaded ones have 0.15 to 0.5 (maxon GP 32 BZ)",
    ),
    Parameter(
        "backlash_deg",
        1.3,
        5.2,
        "0.1 to 0.4 mm between the teeth of bevel gears on 8 mm (0.7 to 2.9) and of belts on 10 mm",
    ),
    Parameter(
        "axis_inertia_kgm2", 2e-6, 5e-5, "bevel gear, shaft and pulley: 40 to 200 g on 10 mm"
    ),
    Parameter(
        "shaft_stiffness_nm_per_rad",
        1.7,
        7.5,
        "G pi d^4/(32 L) of steel, 3 to 4 mm by 0.2 to 0.3 m (2.1 to 9.9), and a belt (10 to 30)",
    ),
    Parameter("shaft_damping_nms_per_rad", 0.005, 0.08, "1 to 10 % of critical: belt and bearings"),
    Parameter("link_inertia_kgm2", 0.01, 0.1, "0.25 to 1.5 kg at 0.2 m: a link with its mechanism"),
    Parameter("base_friction_nm", 0.05, 0.5, "bearings and seals under the weight of the arm"),
    Parameter("coulomb_friction_nm", 0.05, 0.5, "bearings, belt tension, disks of joint 3", 2),
    Parameter("coulomb_friction_nm", 0.05, 0.5, "bearings, belt tension", 3),
    Parameter("viscous_friction_nms_per_rad", 0.01, 0.2, "grease: a tenth to all of it at 1 rad/s"),
)
"""The fitted parameters, in the order of the signal path."""

FIXED_PARAMETERS: dict[str, str] = {
    "control_period_s": "a PC of 2010 commanding two drives over a bus",
    "delay_s": "half a period; a delay shifts the motion in time and hardly changes its shape",
    "velocity_resolution_rad_s": "one motor rpm behind 1:100",
    "input_gain_error": "drives with encoders hold 0.1 to 0.5 % of speed; mean 0, drawn",
    "input_bias_rad_s": "offset of the command, some 0.03 deg/s at the output; mean 0, drawn",
    "link_moment_kgm": "0.8 kg at 0.2 m, as the links' inertia; acts on a slope or with lengths",
    "velocity_limit_rad_s": "3000 to 4000 rpm behind 1:100; the paper's motion needs a fifth",
    "acceleration_limit_rad_s2": "a tenth of a second to that speed",
    "lateral_friction": "rollers or crowned rims; no statement of the paper fixes this ratio",
    "gear_ratio_error": "radii of disks and contacts to 0.1 mm on 20 mm; mean 0, drawn",
    "initial_play": "position of a joint within its backlash at the start, unknown; mean 0, drawn",
    "initial_angle_error_deg": "set by eye or against a stop before each run; mean 0, drawn",
    "encoder_noise_deg": "a third of the resolution: play and flutter of coupling and disk",
    "encoder_resolution_deg": "1024 lines, four edges each; affects the readings, not the motion",
}
"""Source of the value of each fixed parameter, which no statement of the paper determines."""

SPREADS: dict[str, float] = {
    "friction_capacity_nm": 0.1,
    "gearhead_backlash_deg": 0.2,
    "backlash_deg": 0.2,
    "shaft_stiffness_nm_per_rad": 0.1,
    "coulomb_friction_nm": 0.2,
}
"""Spread between machines by effect, as a share of the value, from manufacture and assembly."""
