"""Which parameters what was measured can tell, and which it cannot.

For observables f(x) with errors of reading σ, at standardised parameters x, the scaled sensitivity
S = (∂f/∂x)/σ has the singular values s₁ ≥ s₂ ≥ …; the data say more than the ranges along the
directions in parameter space whose s > 1, and nothing where s = 0. Of the spread of a parameter
over its range, the part √((1 + SᵀS)⁻¹)ᵢᵢ is left (linear theory, normal errors): 1 means not
identifiable, 0 known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.calibration.fit import TOLERANCES, Fit, around, differences
from planner.calibration.statements import Motion, move, nominal, values
from planner.machine import Machine
from planner.plan import Plan
from planner.systems.base import Array

READ_DEG, READ_PERCENT = 0.25, 1.0
"""How well a curve can be read off the paper's figures: half a line's width."""

ENCODER_DEG, TACHO_PERCENT = 0.088, 0.1
"""How well the prototype could record itself."""

SPEEDS = (0.5, 1.0, 4.0)
"""Durations, over that of the paper's motion, of the runs that would tell most."""


@dataclass(frozen=True, eq=False)
class Data:
    """Something measured.

    Attributes:
        name: What.
        count: How many numbers.
        singular: Singular values of the scaled sensitivity, (P,), decreasing.
        directions: Their directions among the standardised parameters, (P, P), one a row.
        left: Part of each parameter's spread that it leaves, (P,).
    """

    name: str
    count: int
    singular: Array
    directions: Array
    left: Array

    @property
    def rank(self) -> int:
        """Number of directions along which the data say more than the ranges."""
        return int(np.sum(self.singular > 1))


def identify(plan: Plan, fit: Fit) -> tuple[Data, ...]:
    """What three sets of data tell: the paper's words, its curves, and what it might record."""
    points = around(fit.x)
    machine = nominal(points[0], fidelity="dynamic")
    usual = move(plan, machine, points)
    said = differences(usual.statements) / TOLERANCES[:, None]
    every = [
        _curves(_run(plan, f, usual, machine, points), ENCODER_DEG, TACHO_PERCENT) for f in SPEEDS
    ]
    return (
        _data("the paper's words", said),
        _data("its curves in Figs 9 and 10", _curves(usual, READ_DEG, READ_PERCENT)),
        _data("encoders and tachometers, three speeds", np.concatenate(every)),
    )


def _run(
    plan: Plan, slower: float, usual: Motion, machine: Machine, points: list[dict[str, float]]
) -> Motion:
    if slower == 1.0:
        return usual
    problem = plan.problem.changed({"goal.duration": plan.duration * slower})
    same = Plan(problem, plan.method, plan.options, plan.trajectory.slowed(slower))
    return move(same, machine, points)


def _curves(motion: Motion, degrees: float, percent: float) -> Array:
    """Scaled sensitivities of all recorded angles and motor speeds, (numbers, P)."""
    seen = np.concatenate([motion.error / degrees, motion.motors / percent], axis=2)
    return differences(seen.reshape(len(seen), -1))


def _data(name: str, scaled: Array) -> Data:
    size = scaled.shape[1]
    full = np.concatenate([scaled, np.zeros((max(0, size - len(scaled)), size))])
    _, singular, directions = np.linalg.svd(full, full_matrices=False)
    left = np.sqrt(np.sum(directions**2 / (1 + singular[:, None] ** 2), axis=0))
    return Data(name, len(scaled), singular, directions, left)


def leading(data: Data, k: int, least: float = 0.15) -> dict[str, float]:
    """The parameters that direction k of some data is mostly made of, with their parts."""
    names = list(values(np.zeros(len(data.left))))
    row = data.directions[k] * np.sign(data.directions[k][np.argmax(np.abs(data.directions[k]))])
    order = np.argsort(-np.abs(row))
    return {names[i]: float(row[i]) for i in order if abs(row[i]) >= least}
