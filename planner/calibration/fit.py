"""The most probable parameters, given their ranges and what the paper says.

With x the parameters, standardised by their ranges, and f(x) what replays give for the paper's
statements, the most probable x minimises

    |x|² + |(f(x) − target) / tolerance|²

(least squares; a normal prior on x and normal errors of reading). The largest error of θ₃ comes
from the quasi-static model, the usual one; how well motors follow from the dynamic one, in which
the load acts on them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from planner.calibration.ranges import FITTED
from planner.calibration.statements import STATEMENTS, move, nominal, values
from planner.plan import Plan
from planner.systems.base import Array

DELTA = 0.1
"""Half of a central difference, in standard deviations of the range."""

TOLERANCE = 5e-3
"""Of the fit, in standard deviations of the ranges."""

DIGITS = 3
"""Significant digits of the preset."""

TARGETS = np.array([s.target for s in STATEMENTS])
TOLERANCES = np.array([s.tolerance for s in STATEMENTS])


@dataclass(frozen=True, eq=False)
class Fit:
    """The result.

    Attributes:
        x: Standardised parameters, (P,).
        parameters: The same in their units, rounded to the digits of the preset.
        found: What the paper's statements come to with them.
        evaluations: How many times x was looked at.
    """

    x: Array
    parameters: dict[str, float]
    found: Array
    evaluations: int


def around(x: Array) -> list[dict[str, float]]:
    """x itself, and x with each coordinate a little more and a little less; 1 + 2 P of them."""
    steps = DELTA * np.eye(len(x))
    return [values(p) for p in (x, *(x + steps), *(x - steps))]


def differences(seen: Array) -> Array:
    """Derivatives by standardised parameters (…, P) from values (1 + 2 P, …) at `around`."""
    count = len(seen) // 2
    return np.moveaxis((seen[1 : 1 + count] - seen[1 + count :]) / (2 * DELTA), 0, -1)


def said(plan: Plan, points: list[dict[str, float]]) -> Array:
    """What the paper's statements are about, (S, 3)."""
    machine = nominal(points[0])
    still = move(plan, machine, points).statements
    moving = move(plan, machine.with_(fidelity="dynamic"), points).statements
    return np.column_stack([still[:, :1], moving[:, 1:]])


def fit(plan: Plan) -> Fit:
    """Fit the parameters of `FITTED`."""
    slopes: dict[bytes, Array] = {}

    def residuals(x: Array) -> Array:
        seen = (said(plan, around(x)) - TARGETS) / TOLERANCES
        slopes[x.tobytes()] = np.concatenate([np.eye(len(x)), differences(seen)])
        return np.concatenate([x, seen[0]])

    found = least_squares(
        residuals,
        np.zeros(len(FITTED)),
        lambda x: slopes[x.tobytes()],
        xtol=TOLERANCE,
        ftol=TOLERANCE**2,
    )
    parameters = {name: rounded(value) for name, value in values(found.x).items()}
    return Fit(found.x, parameters, said(plan, [parameters])[0], int(found.nfev))


def rounded(value: float) -> float:
    """To the digits of the preset."""
    return float(f"{value:.{DIGITS}g}")
