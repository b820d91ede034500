"""A long way leg by leg, by places from which random motions get somewhere.

Where the joints of a long chain stand near their limits, the last ones hardly move, and what they
have to move by is the dearest part of the way. So the first joints are straightened before, and put
into their last place after; in between, all the way is cut in half until a leg can be afforded.
"""

from __future__ import annotations

import numpy as np

from planner.bridge.closing import Chain
from planner.bridge.leg import Ground, leg
from planner.systems.base import Array

AFFORDABLE = 0.35
"""Cost of a pair (see `Pair`) up to which its gap can mostly be closed."""

DEEP = 2
"""Coordinates at the end of the chain that the places on the way keep from its two ends."""

HALVINGS = 4
"""Times a leg is cut in half before it is given up."""

SAME = 0.05
"""Largest distance of the deep coordinates, in their unit, that counts as none."""


def by_legs(ground: Ground, start: Array, goal: Array) -> tuple[Chain | None, int]:
    """A path on long pieces, or None; and iterations made.

    Args:
        ground: Where.
        start: Shape (N,).
        goal: Shape (N,); the first coordinate may be NaN: free.
    """
    forth, back = _Way(ground, start), _Way(ground, goal)
    straight = _straightened(goal)
    reached = forth.to(_straightened(start)) and forth.to(straight)
    if np.isnan(goal[0]):
        reached = reached and forth.to(goal)
        return forth.chain if reached else None, forth.iterations
    reached = reached and back.to(straight) and forth.to(back.here)
    made = forth.iterations + back.iterations
    return _joined(forth.chain, _reversed(back.chain)) if reached else None, made


class _Way:
    """Legs one after the other."""

    def __init__(self, ground: Ground, start: Array) -> None:
        self._ground = ground
        self.chain = Chain(start[None], np.empty((0, 2)), np.empty((0, len(start))))
        self.iterations = 0

    @property
    def here(self) -> Array:
        """Where the last leg ended, shape (N,)."""
        return np.asarray(self.chain.q[-1])

    def to(self, place: Array, halvings: int = HALVINGS) -> bool:
        """Go on to a place (N,), by places half-way where need be; whether it was reached."""
        found, made = leg(self._ground, self.here, place, AFFORDABLE)
        self.iterations += made
        if found is not None:
            self.chain = _joined(self.chain, found)
            return True
        if halvings == 0:
            return False
        half = _half_way(self.here, place)
        return self.to(half, halvings - 1) and self.to(place, halvings - 1)


def _straightened(place: Array) -> Array:
    """The place with all but its last coordinates zero, and the first one free."""
    out = np.zeros_like(place)
    out[-DEEP:] = place[-DEEP:]
    out[0] = np.nan
    return out


def _half_way(here: Array, place: Array) -> Array:
    """The first coordinate is left free until the deep ones are where they should be."""
    half = _straightened((here + place) / 2)
    if np.max(np.abs(here - place)[-DEEP:]) <= SAME:
        half[0] = (here[0] + place[0]) / 2
    return half


def _joined(first: Chain, second: Chain) -> Chain:
    return Chain(
        np.concatenate([first.q, second.q[1:]]),
        np.concatenate([first.u, second.u]),
        np.concatenate([first.gap, second.gap]),
    )


def _reversed(chain: Chain) -> Chain:
    return Chain(chain.q[::-1], -chain.u[::-1], chain.gap[::-1])
