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
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.machine.machine import Machine
from planner.paper.statements import (
    FITTED_PARAMETERS,
    STATEMENTS,
    PaperReplays,
    move,
    nominal_machine,
    values,
)
from planner.plan.plan import Plan
from planner.support.arrays import Array

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
