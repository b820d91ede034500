"""The manipulator with inertia: two masses an axis, backlash by Nordin and Gutman, real torques.

The gap position is a state of its own (M. Nordin, P.-O. Gutman, Automatica 38, 2002, 1633): with
twist x of the shaft and position b of the axis in its play, |b| <= gap/2,

    x + b = axis − joint,    T = k x + c ẋ,    T in the normal cone of [−gap/2, gap/2] at b

so that T = 0 inside the play and never pulls: the shaft's damping cannot hold the teeth together.
Each servo is a velocity loop around what `servo` makes of the command, with that acceleration fed
forward, integral action and a torque limit; the torque of the load acts back on the motor. Friction
contacts hold up to their capacity; below it they slip by creep_per_nm times torque times rate.
Creep without load counts as a smaller rolling radius: it costs travel and no power.

Time stepping: SDIRK2 (R. Alexander, SIAM J. Numer. Anal. 14, 1977, 1006; order 2, L-stable) with
gear ratios frozen at the middle of the step. Samples in which any law changes its piece within the
step (an impact, the start or end of slip) take two steps of the implicit Euler method instead,
which never creates energy. Order 2 where nothing switches, at least 1 through events.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from planner.machine.draw import Draws
from planner.machine.implicit import Stage
from planner.machine.masses import STICK, Masses, Rows, masses
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator

GAMMA = 1 - 1 / np.sqrt(2)
"""Length of a stage of SDIRK2 as a part of the step."""

DRAG = 1e-6
"""Viscous friction of every body, N m s/rad: what has no mass and no contact stays where it is."""

UPRIGHT = 1e-9
"""Least ratio of speeds that the torque of a contact is divided by."""


class _State:
    """Rows of the state: speeds first (see `masses`), then what they move."""

    def __init__(self, m: int) -> None:
        self.bodies = Rows(m)
        start = self.bodies.count
        self.v = slice(0, start)
        self.behind = slice(start, start + 2)
        self.twist = slice(start + 2, start + 4 + m)
        self.gap = slice(start + 4 + m, start + 6 + 2 * m)
        self.reference = slice(start + 6 + 2 * m, start + 8 + 2 * m)
        self.q = slice(start + 8 + 2 * m, start + 10 + 3 * m)
        self.count = start + 10 + 3 * m


@dataclass(frozen=True, eq=False)
class _Gears:
    """What is frozen over a step: see `Stage.first` and `second`, slope and limit of contacts."""

    first: Array
    second: Array
    slope: Array
    limit: Array

    def part(self, chosen: NDArray[np.intp]) -> _Gears:
        return _Gears(*(getattr(self, f.name)[:, chosen] for f in fields(self)))


@dataclass(frozen=True, eq=False)
class _Arrived:
    """A state (rows, S) at the end of a stage, the pieces of its laws, and power there, (2, S)."""

    y: Array
    pieces: Array
    power: Array


class DynamicChain:
    """S manipulators with inertia.

    Args:
        system: The manipulator as the planner knows it.
        draws: The machines.
        q: Coordinates at the start, (N, S); everything is at rest then.

    Attributes:
        work_J: Work of the motors so far, (S,), J.
        lost_J: What friction, slip and damping took of it, (S,), J.
    """

    def __init__(self, system: Manipulator, draws: Draws, q: Array) -> None:
        k = system.k_g * system.K[:, None] * (1 + draws["gear_ratio_error"])
        k = np.array(np.broadcast_to(k, (len(k), draws.count)))
        self._k_g, self._masses = system.k_g, masses(draws, k)
        self._at = at = _State(len(k))
        self._y = np.zeros((at.count, draws.count))
        self._y[at.q] = q
        self._y[at.gap][2:] = draws["initial_play"] * self._masses.half_gap[2:]
        self._pieces = np.zeros((5 + 4 * len(k), draws.count))
        self._gaining = np.zeros((len(k), draws.count))
        self.work_J, self.lost_J = np.zeros(draws.count), np.zeros(draws.count)

    @property
    def q(self) -> Array:
        """Coordinates (φₙ₋₁, θ₁ … θₙ), shape (N, S), rad."""
        return self._y[self._at.q]

    @property
    def motor_rates(self) -> Array:
        """Speeds of the motors, behind their gearheads' ratio, (2, S), rad/s."""
        return self._y[self._at.bodies.motors]

    @property
    def shaft_torque(self) -> Array:
        """Of the springs in the shafts into joints 2 … n, (n−1, S), N m."""
        return np.asarray((self._masses.stiffness * self._y[self._at.twist])[2:])

    @property
    def gap(self) -> Array:
        """Where the axes of joints 2 … n are in their play, (n−1, S), rad; 0 is the middle."""
        return self._y[self._at.gap][2:]

    @property
    def stored_J(self) -> Array:
        """Kinetic energy and that of the shafts, (S,), J."""
        v, twist = self._y[self._at.v], self._y[self._at.twist]
        kinetic = np.sum(self._masses.inertia * v * v, axis=0)
        return np.asarray((kinetic + np.sum(self._masses.stiffness * twist * twist, axis=0)) / 2)

    def step(self, speed: Array, travel: Array, h: float) -> None:
        """Advance by a step.

        Args:
            speed: That the motors should have at the step's P points (2 or 3), (P, 2, S), rad/s.
            travel: Likewise, from the start to each later point, (P−1, 2, S), rad.
            h: Length of the step, s.
        """
        mean, swing = travel[-1] / h, speed[-1] - speed[0]
        data, gears, y = self._masses, self._gears(h), self._y
        early = mean + (GAMMA - 0.5) * swing
        one = self._stage(data, gears, y, early, GAMMA * h, self._pieces)
        ahead = y + (1 - GAMMA) / GAMMA * (one.y - y)
        two = self._stage(data, gears, ahead, mean + swing / 2, GAMMA * h, one.pieces)
        new, pieces = two.y, two.pieces
        energy = h * ((1 - GAMMA) * one.power + GAMMA * two.power)
        switched = np.any((one.pieces != self._pieces) | (two.pieces != self._pieces), axis=0)
        some = np.flatnonzero(switched)
        if some.size:
            data, gears = data.part(some), gears.part(some)
            mean, swing = (np.broadcast_to(x, (2, y.shape[1]))[:, some] for x in (mean, swing))
            one = self._stage(
                data, gears, y[:, some], mean - swing / 4, h / 2, self._pieces[:, some]
            )
            two = self._stage(data, gears, one.y, mean + swing / 4, h / 2, one.pieces)
            new[:, some], pieces[:, some] = two.y, two.pieces
            energy[:, some] = h / 2 * (one.power + two.power)
        drivers = self._at.bodies.drivers
        self._gaining = (new[drivers] - y[drivers]) / h
        self._y, self._pieces = new, pieces
        self.work_J += energy[0]
        self.lost_J += energy[1]

    def _gears(self, h: float) -> _Gears:
        """Ratios at the middle of the step, and the contacts that go with them."""
        data, rows, y = self._masses, self._at.bodies, self._y
        angles = y[self._at.q][1:-1] + h / 2 * y[rows.links][:-1]
        c = np.cos(angles)
        first, second = c * data.kept, data.k * c * c * data.kept * data.kept
        disk = np.abs(y[rows.drivers] + h / 2 * self._gaining)
        both = np.maximum(np.abs(first * second), UPRIGHT)
        share = data.creep * disk / data.disk
        slip = np.concatenate([share * first * first, 2 * share * both * both])
        levers = np.concatenate([np.maximum(np.abs(first), UPRIGHT), both])
        limit = np.tile(data.capacity * data.disk, (2, 1)) / levers
        return _Gears(first, second, 1 / (slip + 1 / STICK), limit)

    def _stage(
        self, data: Masses, gears: _Gears, y: Array, reference: Array, h: float, pieces: Array
    ) -> _Arrived:
        """The state y + h f(new state), by the implicit Euler method."""
        at, rows = self._at, self._at.bodies
        heavy = data.inertia / h
        fed = heavy[rows.motors] * (reference - y[at.reference])
        behind, twist = y[at.behind], y[at.twist]
        spring = data.stiffness + data.damping / h
        rough = np.where(data.coulomb > 0, STICK, 0.0)
        drag = heavy + DRAG
        drag[rows.passive] += data.viscous
        stage = Stage(
            rows=rows,
            h=h,
            drag=drag,
            push=heavy * y[at.v],
            reference=reference,
            first=gears.first,
            second=gears.second,
            offset=np.concatenate(
                [data.integral * behind + fed, np.zeros((1 + 3 * rows.m, y.shape[1]))]
            ),
            slope=np.concatenate([data.gain + data.integral * h, gears.slope, rough]),
            limit=np.concatenate([data.limit, gears.limit, data.coulomb]),
            ahead=y[at.gap] + twist * data.stiffness / spring,
            stiff=spring,
            half_gap=data.half_gap,
        )
        v, pieces = stage.solve(pieces)
        held, pressed = stage.torques(v)
        limited, play = stage.relative(v)
        new = np.empty_like(y)
        new[at.v], new[at.reference] = v, reference
        loop = held[:2] - fed + data.gain / h * behind
        new[at.behind] = loop / (data.gain / h + data.integral)
        new[at.twist] = (pressed + data.damping / h * twist) / spring
        new[at.gap] = np.clip(stage.ahead + h * play, -data.half_gap, data.half_gap)
        new[at.q.start] = y[at.q.start] + h * self._k_g * v[rows.drivers[-1]]
        new[at.q][1:] = y[at.q][1:] + h * v[rows.links]
        wound = (new[at.twist] - twist) / h
        lost = np.sum(held[2:] * limited[2:], axis=0) + np.sum(data.damping * wound**2, axis=0)
        lost += np.sum(data.viscous * v[rows.passive] ** 2, axis=0) + DRAG * np.sum(v**2, axis=0)
        work = np.sum(held[:2] * v[rows.motors], axis=0)
        return _Arrived(new, pieces, np.stack([work, lost]))
