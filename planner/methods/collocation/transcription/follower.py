"""The joints of the nominal machine beside the ideal motion, as states of the programme.

A joint follows its axis with lost motion w. In a part of an interval in which the axis turns to a,
the joint goes from θ to

    max(min(θ, a + w), a − w),

the play operator. For a solver max(x, 0) is ε ln(1 + exp(x/ε)), with an angle ε that becomes
smaller from solve to solve. Its slope is nowhere zero, so that the solver sees beyond the play; and
it decays fast, so that a joint at rest keeps the distance to its axis, interval by interval (with
√(x² + ε²) an arm that was homed forgets it). The axes turn at the rates of the ideal kinematics at
the machine's own joint angles, times the share that the friction contacts pass at these angles.
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

LARGEST_LEAD = 0.9
"""Largest distance of an axis from its joint at the start, as a share of w: at w joints drift."""

PARTS = 4
"""Parts of an interval, in each of which joints turn evenly. With one part a solver makes use of
the error: on 100 intervals of 1.2 s four joints ended up to 14 degrees off, with four up to 1."""

MIDDLES = (np.arange(PARTS) + 0.5) / PARTS
"""Middles of the parts, as fractions of an interval: inputs there times seconds are the ways."""

LEAST_COSINE, ROUND_SINE, MOST_SHARE = 0.02, 0.01, 0.99
"""Least |cosθ| of a contact, the sine within which |sinθ| is rounded, and the largest load as a
share of the capacity. Beyond these the formula of a contact has no value or no slope."""


@dataclass(frozen=True)
class Contacts:
    """The friction contacts of a machine whose joints are all pushed.

    Attributes:
        gears: Gear constants k₂ … kₙ.
        torques: Friction of joints 2 … n, N m.
        lateral: Ratio of sideways to driving friction.
        capacity: Largest torque of a contact, N m.
        creep: Share of the rate that a contact loses.
        creep_per_nm: Further share per load, 1/(N m).
    """

    gears: tuple[float, ...]
    torques: tuple[float, ...]
    lateral: float
    capacity: float
    creep: float
    creep_per_nm: float

    def passing_expr(self, joints: Sequence[Any]) -> list[Any]:
        """Return the share of the ideal rate that reaches each axis, n CasADi expressions.

        The formulas are those of `planner.machine.friction.contacts`.
        """
        later, stages = 0.0, list[tuple[Any, Any]]()
        for j in reversed(range(len(self.gears))):
            c = ca.fmax(ca.fabs(ca.cos(joints[j])), LEAST_COSINE)
            s = self.lateral * ca.sqrt(ca.sin(joints[j]) ** 2 + ROUND_SINE**2)
            load, parts = self.gears[0] * self.torques[j], list[Any]()
            for further in (0.0, 0.0, later):  # P3, P2, P1
                load = ca.fmin(load + further, MOST_SHARE * self.capacity)
                hold = ca.sqrt(self.capacity**2 - load**2)
                parts.append(
                    (1 - s * load / (c * hold)) * (1 - self.creep - self.creep_per_nm * load)
                )
                load = load * c + s * hold
            later = self.gears[j] / self.gears[j - 1] * load
            stages.insert(0, (parts[2], parts[0] * parts[1]))
        chain = np.cumprod([first for first, _ in stages])
        return [1.0, *(a * b for a, (_, b) in zip(chain, stages, strict=True))]


@dataclass(frozen=True)
class Follower:
    """Joints that follow their axes with lost motion, on one or more machines.

    The states are, machine by machine, the n joint angles, then the angles of their n axes.

    Attributes:
        widths: Lost motion w of each joint of the m machines, (m, n), rad, the nominal machine's
            first; a joint with w = 0 is at its axis.
        lead: Share of w by which each axis is ahead of its joint at the start, (n,).
        contacts: Friction contacts of the nominal machine.
        weight: Weight of the spread of the machines' ends in the objective, per deg².
    """

    widths: tuple[tuple[float, ...], ...]
    lead: tuple[float, ...]
    contacts: Contacts
    weight: float = 0.0

    @property
    def size(self) -> int:
        """Number of states."""
        return 2 * np.size(self.widths)

    def start(self, q: Array) -> Array:
        """Return the states at coordinates q (n+1,)."""
        axes = q[1:] + np.clip(self.lead, -LARGEST_LEAD, LARGEST_LEAD) * self.widths
        return np.concatenate([np.append(q[1:], each) for each in axes])

    def step(
        self, system: MovingSystem, states: Any, ways: list[Any], smoothing: Any
    ) -> tuple[list[Any], list[tuple[Any, Any]]]:
        """Return the states after an interval, as CasADi expressions in symbols; and the symbols,
        as columns, each with its definition by the arguments and earlier columns.

        Args:
            system: The system.
            states: States before.
            ways: Integrals of both inputs over the parts of the interval, (2,) each.
            smoothing: The angle ε, rad.
        """
        after, inside, n = list[Any](), list[tuple[Any, Any]](), len(self.lead)

        def named(*values: Any) -> list[Any]:
            symbols = [ca.SX.sym(f"b{len(inside)}_{i}") for i in range(len(values))]
            inside.append((ca.vertcat(*symbols), ca.vertcat(*values)))
            return symbols

        for widths, machine in zip(self.widths, self._machines(states), strict=True):
            joints, axes = machine[:n], machine[n:]
            for way in ways:
                shares = named(*self.contacts.passing_expr(joints))
                middle = [0.0, *joints]
                for i, (w, share) in enumerate(zip(widths, shares, strict=True)):
                    turn = share * system.rates_expr(ca.vertcat(*middle), way)[i + 1]
                    (axis,) = (joint,) = named(axes[i] + turn)
                    if w > 0:
                        near = ca.fmin(smoothing, LARGEST_SHARE * w)
                        pushed = joints[i] - _positive(joints[i] - axis - w, near)
                        (joint,) = named(pushed + _positive(axis - w - pushed, near))
                    middle[i + 1] = (joints[i] + joint) / 2
                    joints[i], axes[i] = joint, axis
            after += [*joints, *axes]
        return after, inside

    def end_cost_expr(self, states: Any) -> Any:
        """Return the cost of the ends' spread: the weighted mean square distance, deg², of the
        joints of the other machines from those of the first, as a CasADi expression."""
        first, *others = (ca.vertcat(*each[: len(self.lead)]) for each in self._machines(states))
        squares = [ca.sumsqr((each - first) / np.deg2rad(1.0)) for each in others]
        return self.weight * sum(squares) / max(len(others), 1)

    def run(self, system: MovingSystem, q: Array, ways: Array, smoothing: float) -> Array:
        """Return the states at the edges of K intervals, (K+1, size), from coordinates q (n+1,),
        with the integrals of both inputs over the `PARTS` of each interval, (K, PARTS, 2)."""
        state, way, start = ca.SX.sym("b", self.size), ca.SX.sym("w", 2, PARTS), self.start(q)
        after, inside = self.step(system, state, ca.horzsplit(way), smoothing)
        symbols, meaning = map(list, zip(*inside, strict=True))
        after = ca.substitute_inplace(symbols, meaning, [ca.vertcat(*after)])[1][0]
        steps = ca.Function("step", [state, way], [after]).mapaccum(len(ways))
        return np.vstack([start, steps(start, ways.reshape(-1, 2).T).full().T])

    def _machines(self, states: Any) -> list[list[Any]]:
        return [ca.vertsplit(each) for each in ca.vertsplit(states, 2 * len(self.lead))]


def _positive(x: Any, near: Any) -> Any:
    """Return max(x, 0), smoothed over an angle."""
    return ca.fmax(x, 0) + near * ca.log1p(ca.exp(-ca.fabs(x) / near))
