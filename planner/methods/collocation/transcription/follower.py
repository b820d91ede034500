"""The joints of the nominal machine beside the ideal motion, as states of the programme.

A joint follows its axis with lost motion w. In an interval in which the axis turns to a, the joint
goes from θ to

    max(min(θ, a + w), a − w),

the play operator. For a solver max(x, 0) is ε ln(1 + exp(x/ε)), with an angle ε that becomes
smaller from solve to solve. Its slope is nowhere zero, so that the solver sees beyond the play; and
it decays fast, so that a joint at rest keeps the distance to its axis, interval by interval (with
√(x² + ε²) an arm that was homed forgets it). The axes turn at the rates of the ideal kinematics at
the machine's own joint angles, times the share that the friction contacts pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.augmented import MovingSystem
from planner.support.arrays import Array

LARGEST_SHARE = 0.2
"""Largest ε as a share of a joint's lost motion; with more a joint does not stay where it was."""


@dataclass(frozen=True)
class Follower:
    """Joints that follow their axes with lost motion, on one or more machines.

    The states are, machine by machine, the n joint angles, then the angles of their n axes.

    Attributes:
        widths: Lost motion w of each joint of the m machines, (m, n), rad, the nominal machine's
            first; a joint with w = 0 is at its axis.
        lead: Share of w by which each axis is ahead of its joint at the start, (n,).
        passing: Share of the ideal rate that reaches each axis, (n,).
        weight: Weight of the spread of the machines' ends in the objective, per deg².
    """

    widths: tuple[tuple[float, ...], ...]
    lead: tuple[float, ...]
    passing: tuple[float, ...]
    weight: float = 0.0

    @property
    def size(self) -> int:
        """Number of states."""
        return 2 * np.size(self.widths)

    def start(self, q: Array) -> Array:
        """Return the states at coordinates q (n+1,)."""
        axes = q[1:] + np.multiply(self.lead, self.widths)
        return np.concatenate([np.append(q[1:], each) for each in axes])

    def step(self, system: MovingSystem, states: Any, way: Any, smoothing: Any) -> list[Any]:
        """Return the states after an interval, as CasADi expressions.

        Args:
            system: The system.
            states: States before.
            way: Integral of both inputs over the interval, (2,).
            smoothing: The angle ε, rad.
        """
        pairs = zip(self.widths, self._machines(states), strict=True)
        return [x for w, old in pairs for x in self._step(system, w, old, way, smoothing)]

    def _step(
        self,
        system: MovingSystem,
        widths: Sequence[float],
        old: list[Any],
        way: Any,
        smoothing: Any,
    ) -> list[Any]:
        """Return the states of one machine after an interval."""
        n, joints, axes = len(widths), list[Any](), list[Any]()
        middle = [0.0, *old[:n]]
        for i, (w, share) in enumerate(zip(widths, self.passing, strict=True)):
            axes.append(old[n + i] + share * system.rates_expr(ca.vertcat(*middle), way)[i + 1])
            joints.append(axes[i])
            if w > 0:
                near = ca.fmin(smoothing, LARGEST_SHARE * w)
                pushed = old[i] - _positive(old[i] - axes[i] - w, near)
                joints[i] = pushed + _positive(axes[i] - w - pushed, near)
            middle[i + 1] = (old[i] + joints[i]) / 2
        return [*joints, *axes]

    def end_cost_expr(self, states: Any) -> Any:
        """Return the cost of the ends' spread: the weighted mean square distance, deg², of the
        joints of the other machines from those of the first, as a CasADi expression."""
        first, *others = (ca.vertcat(*each[: len(self.lead)]) for each in self._machines(states))
        squares = [ca.sumsqr((each - first) / np.deg2rad(1.0)) for each in others]
        return self.weight * sum(squares) / max(len(others), 1)

    def run(self, system: MovingSystem, q: Array, ways: Array, smoothing: float) -> Array:
        """Return the states at the edges of K intervals, (K+1, size), with input integrals (K, 2)
        from coordinates q (n+1,)."""
        state, way, start = ca.SX.sym("b", self.size), ca.SX.sym("w", 2), self.start(q)
        after = ca.vertcat(*self.step(system, state, way, smoothing))
        steps = ca.Function("step", [state, way], [after]).mapaccum(len(ways))
        return np.vstack([start, steps(start, ways.T).full().T])

    def _machines(self, states: Any) -> list[list[Any]]:
        return [ca.vertsplit(each) for each in ca.vertsplit(states, 2 * len(self.lead))]


def _positive(x: Any, near: Any) -> Any:
    """Return max(x, 0), smoothed over an angle."""
    return ca.fmax(x, 0) + near * ca.log1p(ca.exp(-ca.fabs(x) / near))
