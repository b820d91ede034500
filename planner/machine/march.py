"""One time step of the dynamic arm.

The method is SDIRK2 (R. Alexander, SIAM J. Numer. Anal. 14, 1977, 1006; order 2, L-stable) with
gear ratios frozen at the middle of the step. If a law of a sample changes its piece within the step
(an impact, the start or end of slip), that sample takes two steps of the implicit Euler method
instead, which never creates energy. So the order is 2 without such events, and at least 1 with
them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from planner.machine.bodies import STICTION_SLOPE, Masses, OfSamples, StageLaws, StateRows, masses
from planner.machine.disk_chain import rest_at, rest_range
from planner.machine.friction.contact_load import gear_constants
from planner.machine.friction.contacts import SLIP_SPEED_RAD_S, Grip, chain_loads
from planner.machine.machine import Draws
from planner.support.arrays import Array
from planner.systems.manipulator import (
    Manipulator,
    centrifugal_torques,
    chain_inertia,
    gravity_torques,
    mass_matrix,
    on_joints,
)

GAMMA = 1 - 1 / np.sqrt(2)
"""Length of a stage of SDIRK2 as a fraction of the step."""

LEAST_DRAG = 1e-6
"""Viscous friction of every body, N m s/rad, so that a body without mass or contact stays put."""


@dataclass(frozen=True, eq=False)
class _Gears(OfSamples):
    """Gear ratios, contact laws and link masses, constant over a step of time.

    For `first` and `second` see `StageLaws`. `slope` and `limit` are those of the contacts; `drag`
    is the largest drag of contacts that slide sideways on disk B1 and on the stages, (1+m, S), N m;
    `pull` is the torque on the joints by gravity and by the rotation of the links, (1+m, S), N m;
    `mass` is the links' mass matrix, (1+m, 1+m, S), kg m^2.
    """

    first: Array
    second: Array
    slope: Array
    limit: Array
    drag: Array
    pull: Array
    mass: Array


@dataclass(frozen=True, eq=False)
class _StageEnd:
    """State (rows, S), pieces of the laws, and power of motors and losses (2, S) after a stage."""

    y: Array
    pieces: Array
    power: Array


@dataclass(frozen=True, eq=False)
class March:
    """S arms with inertia that advance together in time.

    Attributes:
        data: Parameters of the arms.
        place: Rows of the state.
        k_g: Drive constant of the disk in the planner's model.
        y: State, (rows, S).
        pieces: Pieces of all laws at the end of the last step, (6+5m, S); see `StageLaws`.
        speed_change: Change of the speeds of disks and links over the last step, (1+2m, S), rad/s.
        energy: Work of the motors so far, and energy lost to friction, slip and damping, (2, S), J.
        slipping: Number of the contact in gross slip, (1, S); see `contacts.contact_name`.
    """

    data: Masses
    place: StateRows
    k_g: float
    y: Array
    pieces: Array
    speed_change: Array
    energy: Array
    slipping: Array

    @property
    def table(self) -> Array:
        """All parameters in the order of `Masses`, (rows, S), for compiled code."""
        return np.concatenate([getattr(self.data, f.name) for f in fields(Masses)])

    def step(self, mean: Array, swing: Array, h: float, lead: float) -> None:
        """Advance the arms by a step in which the reference speeds change linearly.

        Args:
            mean: Mean of the reference, (2, S), rad/s.
            swing: Change of the reference over the step, (2, S), rad/s.
            h: Length of the step, s.
            lead: h/2 divided by the length of the last step, at most one half.
        """
        data, gears, y = self.data, self._gears(h, lead), self.y
        early = mean + (GAMMA - 0.5) * swing
        one = self._stage(data, gears, y, early, GAMMA * h, self.pieces)
        ahead = y + (1 - GAMMA) / GAMMA * (one.y - y)
        two = self._stage(data, gears, ahead, mean + swing / 2, GAMMA * h, one.pieces)
        new, pieces = two.y, two.pieces
        energy = h * ((1 - GAMMA) * one.power + GAMMA * two.power)
        switched = np.any((one.pieces != self.pieces) | (two.pieces != self.pieces), axis=0)
        some = np.flatnonzero(switched)
        if some.size:
            data, gears = data.part(some), gears.part(some)
            mean, swing = mean[:, some], swing[:, some]
            was = self.pieces[:, some]
            one = self._stage(data, gears, y[:, some], mean - swing / 4, h / 2, was)
            two = self._stage(data, gears, one.y, mean + swing / 4, h / 2, one.pieces)
            new[:, some], pieces = two.y, pieces.copy()
            pieces[:, some] = two.pieces
            energy[:, some] = h / 2 * (one.power + two.power)
        rows = self.place.bodies
        seen = [*rows.drivers, *range(rows.links.start, rows.links.stop)]
        self.speed_change[:] = new[seen] - y[seen]
        self.y[:], self.pieces[:] = new, pieces
        self.energy[:] += energy

    def _gears(self, h: float, lead: float) -> _Gears:
        """Return gear ratios, laws of the contacts and link masses at the middle of the step.

        The friction that a contact has left for the sideways direction depends on its load, which
        is computed from the shafts' torques at the end of the last step.
        """
        data, rows, y = self.data, self.place.bodies, self.y
        angles = y[self.place.q][1:] + h / 2 * y[rows.links]
        c = np.cos(angles[:-1])
        disk = y[rows.drivers] + lead * self.speed_change[: rows.m]
        turning, disk = np.sign(disk) * np.sign(c), np.abs(disk)
        torques = y[self.place.torque][2:] * turning
        loads, parts, _ = chain_loads(c, data.k, torques, data.lateral, data.capacity)
        slips = (parts <= 0.0) & (data.disk * disk > SLIP_SPEED_RAD_S)
        flat = np.swapaxes(slips, 0, 1).reshape(-1, slips.shape[-1])
        self.slipping[0] = np.where(flat.any(axis=0), flat.argmax(axis=0), -1)
        grip = Grip(c, data.lateral, data.capacity)
        hold = grip.hold(grip.contact_load(loads))
        # Rate lost per N m, by creep and sideways; the drag of P3 loads P2 at any torque.
        lost, drag = data.creep * grip.cosine + grip.sideways / hold, grip.sideways * hold
        kept = np.maximum(data.kept * np.ones_like(c), 0.0)
        first = c * kept
        second = data.k * c * c * kept * kept
        second *= np.maximum(1.0 - drag[2] * lost[1] / grip.cosine, 0.0)
        speed = data.k * disk * parts[0] * (data.k[0] * grip.cosine) * grip.cosine
        of_axes = speed * (grip.cosine * lost[1] + parts[1] * lost[2])
        slip = np.concatenate([disk / data.disk * lost[0], of_axes])
        room = np.minimum(data.capacity, (data.capacity - drag[2]) / grip.cosine)
        limit = np.concatenate([data.capacity * data.disk, room / data.k[0]])
        slid = np.zeros((len(c) + 1, c.shape[1]))
        slid[:-1] = data.disk * drag[0]
        slid[1:] += data.disk * (drag[1] + grip.cosine * drag[2])
        of_links = (data.lengths, data.moments, np.cumsum(angles, axis=0))
        links = np.cumsum(y[rows.links] + lead * self.speed_change[rows.m :], axis=0)
        pull = gravity_torques(data.weights, angles)
        pull -= on_joints(centrifugal_torques(*of_links, links))
        mass = mass_matrix(chain_inertia(data.inertia[rows.links], *of_links))
        return _Gears(first, second, 1 / (slip + 1 / STICTION_SLOPE), limit, slid, pull, mass)

    def _stage(
        self, data: Masses, gears: _Gears, y: Array, reference: Array, h: float, pieces: Array
    ) -> _StageEnd:
        """Advance the state y by a stage of h seconds with the implicit Euler method."""
        place, rows = self.place, self.place.bodies
        feedforward = data.inertia[rows.motors] / h * (reference - y[place.reference])
        stage = self._laws(data, gears, y, reference, feedforward, h)
        v, pieces = stage.solve(pieces)
        limited_torque, pressed = stage.torques(v)
        limited, play = stage.relative(v)
        new = np.empty_like(y)
        new[place.v], new[place.reference], new[place.torque] = v, reference, pressed
        loop = limited_torque[:2] - feedforward + data.gain / h * y[place.behind]
        new[place.behind] = loop / (data.gain / h + data.integral)
        new[place.twist] = (pressed + data.damping / h * y[place.twist]) / stage.stiff
        new[place.gap] = np.clip(stage.ahead + h * play, -data.half_gap, data.half_gap)
        new[place.q.start] = y[place.q.start] + h * self.k_g * v[rows.drivers[-1]]
        new[place.q][1:] = y[place.q][1:] + h * v[rows.links]
        wound = (new[place.twist] - y[place.twist]) / h
        lost = np.sum(limited_torque[2:] * limited[2:], axis=0)
        lost += np.sum(data.damping * wound**2, axis=0)
        dragged = np.sum(data.viscous * v[rows.passive] ** 2, axis=0)
        lost += dragged + LEAST_DRAG * np.sum(v**2, axis=0)
        work = np.sum(limited_torque[:2] * v[rows.motors], axis=0)
        return _StageEnd(new, pieces, np.stack([work, lost]))

    def _laws(
        self, data: Masses, gears: _Gears, y: Array, reference: Array, feedforward: Array, h: float
    ) -> StageLaws:
        """Return the laws of a stage of h s from state y; `feedforward` are torques (2, S), N m."""
        place, rows = self.place, self.place.bodies
        heavy, spring = data.inertia / h, data.stiffness + data.damping / h
        coupling = gears.mass / h
        push = heavy * y[place.v]
        push[rows.links] = gears.pull + np.einsum("jks,ks->js", coupling, y[rows.links])
        diagonal = np.arange(1 + rows.m)
        heavy[rows.links] = coupling[diagonal, diagonal]
        coupling[diagonal, diagonal] = 0.0
        drag = heavy + LEAST_DRAG
        drag[rows.passive] += data.viscous
        driven = data.integral * y[place.behind] + feedforward
        rubbing = np.concatenate([data.coulomb, gears.drag])
        rough = np.where(rubbing > 0, STICTION_SLOPE, 0.0)
        return StageLaws(
            rows=rows,
            h=h,
            drag=drag,
            coupling=coupling,
            push=push,
            reference=reference,
            first=gears.first,
            second=gears.second,
            offset=np.concatenate([driven, np.zeros((2 + 4 * rows.m, y.shape[1]))]),
            slope=np.concatenate([data.gain + data.integral * h, gears.slope, rough]),
            limit=np.concatenate([data.limit, gears.limit, rubbing]),
            ahead=y[place.gap] + y[place.twist] * data.stiffness / spring,
            stiff=spring,
            half_gap=data.half_gap,
        )


def begin_march(system: Manipulator, draws: Draws, q: Array) -> March:
    """Return S arms with inertia at rest at coordinates q (N, S), each joint at its start position
    in its play."""
    k = gear_constants(system, draws)
    data, place = masses(draws, k), StateRows(len(k))
    y = np.zeros((place.count, draws.count))
    y[place.q] = q
    y[place.gap][2:] = draws["initial_play"] * data.half_gap[2:]
    _settle(data, place, y, draws.start)
    pieces, energy = np.zeros((6 + 5 * len(k), draws.count)), np.zeros((2, draws.count))
    speed_change = np.zeros((1 + 2 * len(k), draws.count))
    slipping = np.full((1, draws.count), -1.0)
    return March(data, place, system.k_g, y, pieces, speed_change, energy, slipping)


def _settle(data: Masses, place: StateRows, y: Array, shares: Array) -> None:
    """Set gears, shafts and velocity loops so that they hold the arm against gravity at the
    start."""
    angles = y[place.q][1:]
    load = gravity_torques(data.weights, angles)
    ahead, k = np.zeros_like(data.half_gap), data.stiffness
    ahead[2:] = y[place.gap][2:]

    def hold(rows: slice, load: Array, friction: Array) -> None:
        least, most = rest_range(load, data.half_gap[rows], friction, k[rows])
        ahead[rows] = rest_at(shares[rows], ahead[rows], least, most)
        y[place.gap][rows] = np.clip(ahead[rows], -data.half_gap[rows], data.half_gap[rows])
        y[place.twist][rows] = ahead[rows] - y[place.gap][rows]
        y[place.torque][rows] = k[rows] * y[place.twist][rows]

    hold(slice(1, None), load, data.coulomb)
    shafts, c = y[place.torque][2:], np.cos(angles[:-1])
    shafts = shafts * np.cumprod(np.sign(c), axis=0)
    loads, _, _ = chain_loads(c, data.k, shafts, np.zeros((1, 1)), data.capacity)  # nothing slides
    hold(slice(0, 1), -loads[0, :1] * np.abs(c[:1]), np.zeros((1, y.shape[1])))
    held_back = data.integral > 0
    integral = np.where(held_back, data.integral, 1.0)
    y[place.behind] = np.where(held_back, y[place.torque][:2] / integral, 0.0)
