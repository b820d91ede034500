"""The user coordinates of a system given by expressions: the map and its inverse, as text.

The file also checks that the two maps are inverse to each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.support.compiled_calls import Pointwise
from planner.systems.expressions import parse_expression
from planner.systems.triangular_system import Coordinate

KEYS = ("coordinates", "units", "expressions", "inverse")

ROUND_TRIP = 1e-9
"""Largest accepted error of q after mapping to w and back, relative to 1 + |q|; rounding errors
stay far below."""


class UserMap:
    """The user coordinates w of a system with coordinates q, and the maps between them.

    Args:
        system: The system's name, for messages.
        names: The system's N coordinates q.
        given: `coordinates` (names of the N user coordinates), their `units`, `expressions` (N
            texts for w, in the names of q) and `inverse` (N texts for q, in the names of w).

    Raises:
        InputError: If a key is missing or has the wrong length, a text is not an expression, or a
            name that is in both lists stands for two quantities.
    """

    def __init__(self, system: str, names: Sequence[Coordinate], given: Mapping[str, Any]) -> None:
        self.name, self.own = system, tuple(names)
        if missing := [key for key in KEYS if key not in given]:
            raise InputError(f"{system}: user lacks {', '.join(missing)}")
        self.texts = {key: [str(text) for text in given[key]] for key in KEYS}
        for key, texts in self.texts.items():
            if len(texts) != len(names):
                raise InputError(
                    f"{system}: user.{key} has {len(texts)} entries for {len(names)} coordinates"
                )
        pairs = zip(self.texts["coordinates"], self.texts["units"], strict=True)
        self.coordinates = tuple(Coordinate(*pair) for pair in pairs)
        self._check_shared()

    def there(self, q: Any) -> list[Any]:
        """Return the N user coordinates w as CasADi expressions in the coordinates q (N)."""
        return self._parse("expressions", self.own, q)

    def back(self, w: Any) -> list[Any]:
        """Return the N coordinates q as CasADi expressions in the user coordinates w (N)."""
        return self._parse("inverse", self.coordinates, w)

    def _parse(self, key: str, names: Sequence[Coordinate], x: Any) -> list[Any]:
        symbols = {c.name: x[i] for i, c in enumerate(names)}
        where = f"{self.name}: user.{key}"
        texts = enumerate(self.texts[key])
        return [ca.SX(parse_expression(text, symbols, f"{where}[{k}]")) for k, text in texts]

    def _check_shared(self) -> None:
        """Check that a name of both a user and a system coordinate means the same quantity."""
        x = ca.SX.sym("x", len(self.own))
        there, back = self.there(x), self.back(x)
        mine = {c.name: i for i, c in enumerate(self.own)}
        for i, c in enumerate(self.coordinates):
            j = mine.get(c.name)
            if j is None:
                continue
            same = ca.is_equal(there[i], x[j]) and ca.is_equal(back[j], x[i])
            if not same or c.unit != self.own[j].unit:
                raise InputError(
                    f"{self.name}: '{c.name}' in user.coordinates is a triangular coordinate too:"
                    f" give '{c.name}' the unit of that coordinate, and the expression '{c.name}'"
                    " in user.expressions and user.inverse; or choose another name"
                )

    def check_inverse(self, intervals: Mapping[int, tuple[float, float]]) -> None:
        """Raise an error unless the maps to and from the user coordinates undo each other.

        The test uses those of 20 random points (fixed seed) in the intervals, which are given by
        array index, at which both maps give real numbers.

        Raises:
            InputError: If the maps do not match; the message names the coordinate and the point.
        """
        x = ca.SX.sym("x", len(self.own))
        rng = np.random.default_rng(0)
        q = rng.uniform(-1, 1, (20, len(self.own)))
        for i, (low, high) in intervals.items():
            q[:, i] = rng.uniform(low, high, len(q))
        w = Pointwise("there", [x], ca.vertcat(*self.there(x)))(q)
        again = Pointwise("back", [x], ca.vertcat(*self.back(x)))(w)
        real = np.all(np.isfinite(again), axis=1)
        if not np.any(real):
            raise InputError(
                f"{self.name}: user.expressions and user.inverse are not both real at any of 20"
                " points inside the intervals"
            )
        off = np.where(real[:, None], np.abs(again - q) / (1 + np.abs(q)), 0.0)
        row, column = np.unravel_index(int(np.argmax(off)), off.shape)
        if off[row, column] > ROUND_TRIP:
            raise InputError(
                f"{self.name}: user.inverse does not undo user.expressions:"
                f" at {pairs_of(self.own, q[row])} it gives"
                f" {pairs_of(self.own[column : column + 1], again[row, column : column + 1])}"
            )


def pairs_of(coordinates: Sequence[Coordinate], values: Array) -> str:
    """Format coordinates with their values and units as text ("x = 1 m, y = 2 m")."""
    return ", ".join(
        f"{c.name} = {x:.6g} {c.unit}".rstrip() for c, x in zip(coordinates, values, strict=True)
    )
