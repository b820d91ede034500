"""The most probable parameters, given their ranges and the paper's statements.

Let x be the parameters, standardised by their ranges, and f(x) the values of the paper's
statements, computed by replays. The most probable x minimises

    |x|² + |(f(x) − target) / tolerance|²

(least squares; a normal prior on x and normal reading errors). A statement that says "at most"
counts only if it is exceeded. The largest errors of θ₃ and θ₂ are computed with the quasi-static
model, the default. The deviations of the motors from their commands are computed with the dynamic
model, in which the load acts on the motors.

`planner.identify` solves a different problem: it fits thousands of readings with a robust loss,
offsets of each log and a bootstrap. Here there are five numbers, two of them bounds. Both use
SciPy's `least_squares`, but a common function would save only about ten lines.

Identifiability: for observables f(x) with reading errors σ, the scaled sensitivity S = (∂f/∂x)/σ at
standardised parameters x has the singular values s₁ ≥ s₂ ≥ … Along a direction in parameter space
with s > 1 the data determine more than the ranges do; with s = 0 the data determine nothing. Of a
parameter's spread over its range the share √((1 + SᵀS)⁻¹)ᵢᵢ remains (linear theory, normal errors):
1 means not identifiable, 0 known.

The paper gives no data sheet, but its Figs 2 and 3 show two servo motors, friction disks, bevel
gears, timing belts and long shafts on a bench. So the range of each parameter is that of typical
parts, and is taken as the central 95 % of a log-normal distribution. `statements.toml` has the
statements, and the ranges with their sources.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

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


HALF_STEP = 0.1
"""Half of the step of central differences, in standard deviations of a parameter's range."""

FIT_TOLERANCE = 5e-3
"""Tolerance of the fit, in standard deviations of the ranges."""

PRESET_DIGITS = 3
"""Number of significant digits of the parameters in the prototype preset."""

TARGETS = np.array([s.target for s in STATEMENTS])
TOLERANCES = np.array([s.tolerance for s in STATEMENTS])
BOUNDS = np.array([s.bound for s in STATEMENTS])


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a fit of the prototype's parameters to the paper's statements.

    Attributes:
        x: Standardised parameters, (P,).
        parameters: The parameters in their units, rounded to the digits of the preset.
        values: Values of the paper's statements with these parameters.
        motor_nm: Largest torque of motor 1 in the paper's motion, N m.
    """

    x: Array
    parameters: dict[str, float]
    values: Array
    motor_nm: float

    @property
    def distance(self) -> float:
        """Distance of the parameters from their ranges' centres, |x|, in standard deviations."""
        return float(np.linalg.norm(self.x))


def difference_points(x: Array) -> list[dict[str, float]]:
    """Return the 1 + 2 P parameter sets, by name, that `central_differences` needs.

    They are x, then x with each of its P entries `HALF_STEP` higher, then with each lower.
    """
    steps = HALF_STEP * np.eye(len(x))
    return [values(p) for p in (x, *(x + steps), *(x - steps))]


def central_differences(values: Array) -> Array:
    """Return derivatives (…, P) by the P standardised parameters.

    `values` (1 + 2 P, …) are those at the points of `difference_points`.
    """
    count = len(values) // 2
    return np.moveaxis((values[1 : 1 + count] - values[1 + count :]) / (2 * HALF_STEP), 0, -1)


def statement_values(plan: Plan, points: list[dict[str, float]], **changes: Any) -> Array:
    """Compute the quantities of the five `STATEMENTS` at S parameter sets, shape (S, 5)."""
    machine = nominal_machine(points[0], **changes)
    still = move(plan, machine, points).statements
    moving = move(plan, machine.with_(fidelity="dynamic"), points).statements
    return np.column_stack([still[:, :2], moving[:, 2:]])


def fit(plan: Plan, **changes: Any) -> Fit:
    """Fit `FITTED_PARAMETERS` to the statements except bounds; fit again while a bound is exceeded.

    Each exceeded bound ("at most") enters the next fit as an equality: a one-sided residual has a
    kink, at which least squares would stop too early.

    Args:
        plan: The paper's motion.
        changes: Values of effects of the machine that are not fitted.
    """
    from scipy.optimize import least_squares  # slow to import

    slopes: dict[bytes, Array] = {}
    counted, x = ~BOUNDS, np.zeros(len(FITTED_PARAMETERS))

    def residuals(x: Array) -> Array:
        quantities = statement_values(plan, difference_points(x), **changes)
        deviations = ((quantities - TARGETS) / TOLERANCES)[:, counted]
        slopes[x.tobytes()] = np.concatenate([np.eye(len(x)), central_differences(deviations)])
        return np.concatenate([x, deviations[0]])

    while True:
        solution = least_squares(
            residuals, x, lambda x: slopes[x.tobytes()], xtol=FIT_TOLERANCE, ftol=FIT_TOLERANCE**2
        )
        x = solution.x
        parameters = {name: to_preset_digits(value) for name, value in values(x).items()}
        quantities = statement_values(plan, [parameters], **changes)[0]
        if not np.any((quantities > TARGETS) & ~counted):
            motor = quantities[-1] / 100 * parameters["torque_limit_nm"]
            return Fit(x, parameters, quantities, float(motor))
        counted = counted | (quantities > TARGETS)


def to_preset_digits(value: float) -> float:
    """Round a value to the significant digits of the preset."""
    return float(f"{value:.{PRESET_DIGITS}g}")


READ_DEG, READ_PERCENT = 0.25, 1.0
"""Reading error of a curve in the paper's figures, half the width of a line: of angles, deg, and of
motor speeds, % of the peak."""

ENCODER_DEG, TACHO_PERCENT = 0.088, 0.1
"""Resolution of the prototype's encoders, deg, and tachometers, % of the peak speed."""

CURVE_STRIDE = 5
"""Number of records per reading of a curve, so that a reading is taken every 0.05 s."""

DURATION_RATIOS = (0.5, 1.0, 4.0)
"""Durations of the runs with encoders, relative to the duration of the paper's motion."""


@dataclass(frozen=True, eq=False)
class DataSet:
    """A set of measured data, and how well the data determine the parameters.

    Attributes:
        name: What was measured.
        count: Number of measured values.
        singular: Singular values of the scaled sensitivity, (P,), decreasing.
        directions: Direction in the space of standardised parameters for each singular value, one
            per row, (P, P).
        remaining: Share of each parameter's spread that remains given the data, (P,).
    """

    name: str
    count: int
    singular: Array
    directions: Array
    remaining: Array

    @property
    def rank(self) -> int:
        """Number of directions along which the data determine more than the parameter ranges."""
        return int(np.sum(self.singular > 1))


def identify(plan: Plan, fit: Fit) -> tuple[DataSet, ...]:
    """Compute how well each of three data sets determines the fitted parameters.

    The data sets are the paper's statements in words, the curves in the paper's figures, and
    records that the prototype's encoders and tachometers could have given at three speeds. Bounds
    are left out, because an inequality gives no value.
    """
    points = difference_points(fit.x)
    machine = nominal_machine(points[0], fidelity="dynamic")
    usual = move(plan, machine, points)
    words = (central_differences(statement_values(plan, points)) / TOLERANCES[:, None])[~BOUNDS]
    runs = (_run(plan, ratio, usual, machine, points) for ratio in DURATION_RATIOS)
    every = [_curves(run, ENCODER_DEG, TACHO_PERCENT) for run in runs]
    return (
        _data("the paper's words", words),
        _data("the paper's curves in Figs 9 and 10", _curves(usual, READ_DEG, READ_PERCENT)),
        _data("encoders and tachometers, three speeds", np.concatenate(every)),
    )


def _run(
    plan: Plan, slower: float, usual: PaperReplays, machine: Machine, points: list[dict[str, float]]
) -> PaperReplays:
    if slower == 1.0:
        return usual
    problem = plan.problem.changed({"goal.duration": plan.duration * slower})
    same = Plan(problem, plan.method, plan.options, plan.trajectory.slowed(slower))
    return move(same, machine, points)


def _curves(motion: PaperReplays, degrees: float, percent: float) -> Array:
    """Return the scaled sensitivities of all readings of angles and speeds, shape (readings, P)."""
    curves = np.concatenate([motion.error / degrees, motion.motors / percent], axis=2)
    return central_differences(curves[:, ::CURVE_STRIDE].reshape(len(curves), -1))


def _data(name: str, scaled: Array) -> DataSet:
    size = scaled.shape[1]
    full = np.concatenate([scaled, np.zeros((max(0, size - len(scaled)), size))])
    _, singular, directions = np.linalg.svd(full, full_matrices=False)
    remaining = np.sqrt(np.sum(directions**2 / (1 + singular[:, None] ** 2), axis=0))
    return DataSet(name, len(scaled), singular, directions, remaining)


def main_parameters(data: DataSet, k: int, least: float = 0.15) -> dict[str, float]:
    """Return the components of direction k of a data set that reach `least`, largest first.

    Keys are names of parameters. The direction's sign makes the largest component positive.
    """
    names = list(values(np.zeros(len(data.remaining))))
    row = data.directions[k] * np.sign(data.directions[k][np.argmax(np.abs(data.directions[k]))])
    order = np.argsort(-np.abs(row))
    return {names[i]: float(row[i]) for i in order if abs(row[i]) >= least}
