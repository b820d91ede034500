"""One implicit stage of the dynamic arm: speeds and torques that agree at its end.

Every connection is a monotone law between one relative speed w and one torque, with three pieces:

    limited    T = clip(o + g w, ± limit)       servo, friction contact, Coulomb friction
    play       T = A dz(e + h w, gap/2)         shaft behind play

so that the speeds minimise a convex function, and are unique. They are found by active sets (a
semi-smooth Newton method): with the piece of every law known, the bodies form a tree of linear
equations, solved from the links to the motors and back. That ends when the pieces agree with the
speeds: after one pass in most steps, since pieces seldom change.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.machine.masses import Rows
from planner.systems.base import Array

PASSES = 12
"""Passes with full steps; after them, each step goes as far as the convex function falls."""

MOST_PASSES = 100
HALVINGS = 40

EDGE_NM = 1e-8
"""A law may lie so far outside its piece, N m."""

EDGE_RAD = 1e-16


@dataclass(frozen=True, eq=False)
class Stage:
    """The laws of one stage; arrays are (rows, S), rows of speeds as in `masses`.

    Rows of limited laws: servos (2), contacts P1 (m), contacts P2 with P3 (m), friction (1 + m).

    Attributes:
        rows: Where the bodies are.
        h: Length of the stage, s.
        drag: Inertia over h, and viscous friction, N m s/rad.
        push: Inertia over h, times the speed that each body would keep, N m.
        reference: Speed that the servos aim at, (2, S), rad/s.
        first: Speed of each stage over that of the disk before, without slip, (m, S).
        second: Speed of each axis over that of its stage, without slip, (m, S).
        offset: o of the limited laws, (3+3m, S), N m.
        slope: g of them, N m s/rad.
        limit: Their limits, N m.
        ahead: e of the play laws, (2+m, S), rad.
        stiff: A of them, N m/rad.
        half_gap: Half of the play, rad.
    """

    rows: Rows
    h: float
    drag: Array
    push: Array
    reference: Array
    first: Array
    second: Array
    offset: Array
    slope: Array
    limit: Array
    ahead: Array
    stiff: Array
    half_gap: Array

    def part(self, chosen: NDArray[np.intp]) -> Stage:
        """The laws of some samples."""
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays = {k: v[:, chosen] for k, v in values.items() if isinstance(v, np.ndarray)}
        return Stage(**{**values, **arrays})

    def solve(self, pieces: Array) -> tuple[Array, Array]:
        """Speeds (rows, S) and pieces of all laws that agree.

        Args:
            pieces: A guess: −1, 0 or 1 for each law, limited ones first, (5+4m, S).
        """
        v = self._tree(pieces)
        fresh = self._pieces(v, pieces)
        left = np.flatnonzero((fresh != pieces).any(axis=0))
        if not left.size:
            return v, pieces
        part, before = self.part(left), v[:, left]
        for count in range(MOST_PASSES):
            own = fresh[:, left]
            new = part._tree(own)
            if count >= PASSES:
                new = part._search(before, new)
            v[:, left] = before = new
            fresh[:, left] = after = part._pieces(new, own)
            on = np.flatnonzero((after != own).any(axis=0))
            if not on.size:
                break
            left, part, before = left[on], part.part(on), before[:, on]
        return v, fresh

    # -- the laws ------------------------------------------------------------------------------

    def relative(self, v: Array) -> tuple[Array, Array]:
        """w of the limited laws, (3+3m, S), and of the play laws, (2+m, S), rad/s."""
        rows, stages = self.rows, v[self.rows.stages]
        limited = np.concatenate(
            [
                self.reference - v[rows.motors],
                self.first * v[rows.drivers] - stages,
                self.second * stages - v[rows.axes],
                v[rows.links],
            ]
        )
        return limited, v[rows.before] - v[rows.after]

    def torques(self, v: Array) -> tuple[Array, Array]:
        """Torques of the limited laws and of the play laws, likewise, N m."""
        limited, play = self.relative(v)
        ahead = self.ahead + self.h * play
        wound = ahead - np.minimum(np.maximum(ahead, -self.half_gap), self.half_gap)
        held = np.minimum(np.maximum(self.offset + self.slope * limited, -self.limit), self.limit)
        return held, self.stiff * wound

    def _pieces(self, v: Array, before: Array) -> Array:
        """Pieces at these speeds; those before wherever they hold to within rounding."""
        limited, play = self.relative(v)
        value = np.concatenate([self.offset + self.slope * limited, self.ahead + self.h * play])
        edge = np.concatenate([self.limit, self.half_gap])
        room = np.concatenate(
            [np.full_like(self.limit, EDGE_NM), np.full_like(self.ahead, EDGE_RAD)]
        )
        inside = np.abs(value) <= edge + room
        holds = np.where(before == 0, inside, before * value >= edge - room)
        new = np.where(inside, 0.0, np.sign(value))
        new[: len(limited)][before[: len(limited)] * new[: len(limited)] < 0] = 0.0
        new = np.where(holds, before, new)
        new[len(limited) :][self.half_gap == 0] = 1.0
        return new

    def _lines(self, pieces: Array) -> tuple[Array, Array, Array, Array]:
        """Torque c + s w of the limited and of the play laws on their pieces: c, s, c, s."""
        count = len(self.limit)
        held, touching = pieces[:count], pieces[count:]
        moving = held == 0
        pressed = self.stiff * np.abs(touching)
        return (
            np.where(moving, self.offset, held * self.limit),
            np.where(moving, self.slope, 0.0),
            pressed * (self.ahead - touching * self.half_gap),
            pressed * self.h,
        )

    # -- the tree ------------------------------------------------------------------------------

    def _tree(self, pieces: Array) -> Array:
        """Speeds (rows, S) of all bodies with every law on a known piece."""
        rows, m = self.rows, self.rows.m
        c, s, c_play, s_play = self._lines(pieces)
        one, two = self.first, self.second
        p23, rub = slice(2 + m, 2 + 2 * m), slice(2 + 2 * m, None)

        links, links_push = self.drag[rows.links] + s[rub], self.push[rows.links] - c[rub]
        base, base_push = links[0], links_push[0]
        links, links_push = links[1:], links_push[1:]
        asked, more = _drawn(c_play[2:], s_play[2:], links, links_push)
        axes, axes_push = self.drag[rows.axes] + more, self.push[rows.axes] - asked
        asked, more = _drawn(c[p23], s[p23], axes, axes_push)
        stages = self.drag[rows.stages] + two * two * more
        stages_push = self.push[rows.stages] - two * asked
        geared = np.stack([self.drag[rows.disk], base])
        geared_push = np.stack([self.push[rows.disk], base_push])
        for j in range(m - 1, -1, -1):
            asked, more = _drawn(c[2 + j], s[2 + j], stages[j], stages_push[j])
            body, push = (stages, stages_push) if j else (geared, geared_push)
            body[max(j - 1, 0)] += one[j] * one[j] * more
            push[max(j - 1, 0)] -= one[j] * asked
        asked, more = _drawn(c_play[:2], s_play[:2], geared, geared_push)

        v = np.empty_like(self.drag)
        servo = self.push[rows.motors] - asked + c[:2] + s[:2] * self.reference
        v[rows.motors] = servo / (self.drag[rows.motors] + more + s[:2])
        pull = c_play[:2] + s_play[:2] * v[rows.motors]
        v[rows.geared] = (geared_push + pull) / (geared + s_play[:2])
        for j, driver in enumerate(rows.drivers):
            pull = c[2 + j] + s[2 + j] * one[j] * v[driver]
            v[rows.stages.start + j] = (stages_push[j] + pull) / (stages[j] + s[2 + j])
        pull = c[p23] + s[p23] * two * v[rows.stages]
        v[rows.axes] = (axes_push + pull) / (axes + s[p23])
        pull = c_play[2:] + s_play[2:] * v[rows.axes]
        v[rows.passive] = (links_push + pull) / (links + s_play[2:])
        return v

    # -- the convex function -------------------------------------------------------------------

    def _search(self, start: Array, end: Array) -> Array:
        """The lowest point of the convex function on the way from start to end."""
        way = end - start
        low, high = np.zeros(start.shape[1]), np.ones(start.shape[1])
        falling = self._slope_along(end, way) <= 0
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            rising = self._slope_along(start + middle * way, way) > 0
            low, high = np.where(rising, low, middle), np.where(rising, middle, high)
        return np.asarray(start + np.where(falling, 1.0, (low + high) / 2) * way)

    def _slope_along(self, v: Array, way: Array) -> Array:
        held, pressed = self.torques(v)
        limited, play = self.relative(way)
        limited[:2] -= self.reference
        own = np.sum(way * (self.drag * v - self.push), axis=0)
        return np.asarray(own + np.sum(limited * held, axis=0) + np.sum(play * pressed, axis=0))


def _drawn(c: Array, s: Array, drag: Array, push: Array) -> tuple[Array, Array]:
    """What a body, and all behind it, asks of the body before it through a law c + s w.

    Returns:
        a and b of the torque a + b (speed that comes without slip), N m and N m s/rad.
    """
    share = 1.0 / (drag + s)
    return (c * drag - s * push) * share, s * drag * share
