"""Checks that what a user gives is a system in triangular form, with messages that say why not."""

from __future__ import annotations

import keyword
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from planner.errors import InputError
from planner.systems.base import Coordinate
from planner.systems.expression import FUNCTIONS

Intervals = Mapping[int, tuple[float, float]]


def check_names(system: str, coordinates: Sequence[Coordinate]) -> tuple[Coordinate, ...]:
    """The coordinates, if there are three or more with different, usable names.

    Raises:
        InputError: If not.
    """
    names = [c.name for c in coordinates]
    if len(names) < 3:
        raise InputError(f"{system}: {len(names)} coordinates; a triangular system has at least 3")
    for name in names:
        if not name.isidentifier() or keyword.iskeyword(name) or name in FUNCTIONS or name == "pi":
            raise InputError(f"{system}: {name!r} cannot be the name of a coordinate")
        if names.count(name) > 1:
            raise InputError(f"{system}: two coordinates are called {name!r}")
    return tuple(coordinates)


def check_intervals(
    system: str, coordinates: Sequence[Coordinate], given: Mapping[str, Sequence[float]]
) -> dict[int, tuple[float, float]]:
    """Interval of each coordinate that a link is solved for (all but first and last), by index.

    Raises:
        InputError: If one is missing, empty, not finite, or of another coordinate.
    """
    links = {c.name: i for i, c in enumerate(coordinates) if 0 < i < len(coordinates) - 1}
    unknown = [name for name in given if name not in links]
    if unknown:
        raise InputError(
            f"{system}: intervals of {', '.join(unknown)}: only {', '.join(links)} have one"
        )
    out = {}
    for name, i in links.items():
        if name not in given and coordinates[i].unit != "rad":
            raise InputError(f"{system}: give the interval of {name} in {coordinates[i].unit}")
        low, high = (float(x) for x in given.get(name, (-np.pi / 2, np.pi / 2)))
        if not (np.isfinite(high - low) and low < high):
            raise InputError(f"{system}: the interval of {name} is ({low:g}, {high:g})")
        out[i] = (low, high)
    return out


def check_structure(system: str, coordinates: Sequence[Coordinate], slopes: Any, q: Any) -> None:
    """Refuse slopes that read an earlier coordinate than they may, or break the chain.

    Raises:
        InputError: Names the slope and the coordinate.
    """
    names = [c.name for c in coordinates]
    for link, slope in enumerate(slopes, start=1):
        reads = [bool(ca.depends_on(slope, q[j])) for j in range(len(names))]
        coordinate = names[link + 1]
        early = [names[j] for j in range(link) if reads[j]]
        if early:
            raise InputError(
                f"{system}: the slope of {coordinate} reads {', '.join(early)}; in triangular form"
                f" it may read {', '.join(names[link:])} only"
            )
        if not reads[link]:
            raise InputError(
                f"{system}: the slope of {coordinate} does not depend on {names[link]}, so the"
                " chain is broken there"
            )


def check_turns(
    system: str, coordinates: Sequence[Coordinate], intervals: Intervals, links: Mapping[int, Any]
) -> None:
    """Refuse a link whose derivative changes sign more than once on its interval.

    Sampled: on a grid, at a few seeded values of the later coordinates.

    Raises:
        InputError: Names the slope and the coordinate.
    """
    rng = np.random.default_rng(0)
    for i, (low, high) in intervals.items():
        for _ in range(5):
            points = np.tile(rng.uniform(-1, 1, len(coordinates)), (201, 1))
            for j, (a, b) in intervals.items():
                points[:, j] = rng.uniform(a, b)
            points[:, i] = np.linspace(low, high, 203)[1:-1]
            signs = np.sign(links[i](points)[:, 1])
            signs = signs[(signs != 0) & np.isfinite(signs)]
            if sum(a != b for a, b in pairwise(signs)) > 1:
                raise InputError(
                    f"{system}: the slope of {coordinates[i + 1].name} turns more than once for"
                    f" {coordinates[i].name} in ({low:g}, {high:g}); give a narrower interval"
                )
