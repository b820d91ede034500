"""Piecewise polynomials in the Bernstein basis, whose coefficients bound the curve.

On the piece from xₖ to xₖ₊₁, with s = (t − xₖ)/(xₖ₊₁ − xₖ),

    p(t) = Σⱼ c[j, k] C(d, j) sʲ (1 − s)ᵈ⁻ʲ.

`c` and `x` have the layout of SciPy's `BPoly`, whose import takes a third of a second.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.support.arrays import Array, Frozen, frozen, product

Pieces = NDArray[np.int_]
"""Indices of a curve's pieces, or of a plan's cells, from 0."""

MOST_COEFFICIENTS = 100_000
"""Largest number of coefficients of one curve in a file, as in a compensated plan of 500 s.
Verification needs some 5 kB of memory per coefficient."""


@dataclass(frozen=True, eq=False)
class Bernstein(Frozen):
    """A piecewise polynomial.

    Attributes:
        c: Coefficients of K pieces of degree d, shape (d+1, K, …); "…" is the shape of one value.
        x: Breaks between the pieces, shape (K+1,), increasing.

    Raises:
        ValueError: If the number of pieces does not fit the number of breaks.
    """

    c: Array
    x: Array

    def __post_init__(self) -> None:
        for name in ("c", "x"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype=float)))
        if self.c.ndim < 2 or not len(self.c) or self.x.shape != (self.c.shape[1] + 1,):
            raise ValueError(f"coefficients {self.c.shape} do not fit breaks {self.x.shape}")

    @property
    def degree(self) -> int:
        """Degree d, the same for every piece."""
        return len(self.c) - 1

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t, shape (*shape of t, *shape of one value).

        At a break the later piece counts; outside the breaks the first and last piece continue.
        """
        times = np.asarray(t, dtype=float)
        if times.ndim == 0:
            return self._value(float(times))
        flat = times.ravel()
        piece = self.piece(flat)
        weights = basis(self.degree, (flat - self.x[piece]) / self._width[piece])
        c = self.c.reshape(*self.c.shape[:2], -1)
        if c.shape[1] == 1:
            out = product(c[:, 0].T, weights).T
        else:
            out = np.einsum("jm,jmn->mn", weights, c.take(piece, axis=1))
        return np.asarray(out.reshape(*times.shape, *self.c.shape[2:]))

    def _value(self, t: float) -> Array:
        """Return the curve's value at one time, computed with plain floats for speed."""
        inner, rows, binomials = self._rows
        if t != t:
            return np.full(self.c.shape[2:], t)
        k = bisect_right(inner, t)
        s, d = (t - float(self.x[k])) / float(self._width[k]), self.degree
        weights = [b * s**j * (1 - s) ** (d - j) for j, b in enumerate(binomials)]
        return np.asarray(np.dot(weights, rows[k]).reshape(self.c.shape[2:]))

    @cached_property
    def _rows(self) -> tuple[list[float], Array, list[float]]:
        rows = np.moveaxis(self.c, 1, 0).reshape(self.c.shape[1], len(self.c), -1)
        return self.x[1:-1].tolist(), np.ascontiguousarray(rows), _binomials(self.degree).tolist()

    @cached_property
    def _width(self) -> Array:
        return np.diff(self.x)

    def piece(self, t: Array) -> Pieces:
        """Return the index of the piece that contains each time (…)."""
        return np.asarray(self.x[1:-1].searchsorted(t, side="right"))

    def piece_values(self, piece: Pieces, fraction: Array) -> Array:
        """Return the values (P, C, …) at P places in each of C pieces.

        `piece` (C,) has the pieces' indices, `fraction` (P, C) the places, from 0 to 1.
        """
        c = self.c[:, piece].reshape(len(self.c), len(piece), -1)
        if np.all(fraction == fraction[:, :1]):  # equal in all pieces: one matrix does
            out = product(basis(self.degree, fraction[:, 0]).T, c.reshape(len(c), -1))
        else:
            weights = np.transpose(basis(self.degree, fraction), (2, 1, 0))
            out = np.swapaxes(weights @ np.swapaxes(c, 0, 1), 0, 1)
        return np.asarray(out.reshape(*fraction.shape, *self.c.shape[2:]))

    def derivative(self, order: int = 1) -> Bernstein:
        """Return the time derivative of the given order; the degree falls by the order."""
        c = self.c
        for _ in range(order):
            c = (len(c) - 1) * np.diff(c, axis=0) / self._wide if len(c) > 1 else np.zeros_like(c)
        return Bernstein(c, self.x)

    def antiderivative(self) -> Bernstein:
        """Return ∫ p dt from the first break: one degree higher, exactly continuous at breaks."""
        c = integral(self.c) * self._wide
        c[:, 1:] += np.cumsum(c[-1], axis=0)[:-1]
        return Bernstein(c, self.x)

    @property
    def _wide(self) -> Array:
        return self._width.reshape(-1, *[1] * (self.c.ndim - 2))

    def slowed(self, factor: float, gain: float = 1.0) -> Bernstein:
        """Return the curve stretched in time by `factor`, with values multiplied by `gain`.

        A negative factor also runs it backwards.
        """
        if factor < 0:
            return Bernstein(self.c[::-1, ::-1] * gain, (self.x[::-1] - self.x[-1]) * factor)
        return Bernstein(self.c * gain, self.x * factor)

    def only(self, which: NDArray[np.bool_]) -> Bernstein:
        """Return the pieces of a mask, one right after another from 0."""
        return Bernstein(self.c[:, which], np.append(0.0, np.cumsum(self._width[which])))

    def to_dict(self) -> dict[str, Any]:
        """Return the breaks and the coefficients as JSON-ready data.

        Raises:
            InputError: If the curve has too many coefficients for a file.
        """
        if flaw := length_flaw(len(self.x) - 1, self.degree):
            raise InputError(
                f"the plan is too long for a file: one of its curves {flaw}; give it a shorter"
                " duration, or export its samples (planner.export to a CSV file)"
            )
        return {"breaks": self.x.tolist(), "bernstein": self.c.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Bernstein:
        """Make a curve from the output of `to_dict`."""
        return cls(data["bernstein"], data["breaks"])


def length_flaw(pieces: int, degree: int) -> str:
    """Return in words why a curve is too long for a file; "" if it is short enough."""
    if pieces * (degree + 1) <= MOST_COEFFICIENTS:
        return ""
    most = f"at most {MOST_COEFFICIENTS} coefficients are allowed (pieces times degree + 1)"
    return f"has {pieces} pieces of degree {degree}; {most}"


def basis(degree: int, x: Array) -> Array:
    """Return the values of all Bernstein polynomials of a degree at x (…), shape (degree+1, …)."""
    if not degree:
        return np.asarray(1 + 0 * x[None])  # keeps NaN
    up, down = np.ones((2, degree + 1, *x.shape))
    rest = 1 - x
    for k in range(1, degree + 1):
        up[k], down[k] = up[k - 1] * x, down[k - 1] * rest
    up *= down[::-1]
    up *= _binomials(degree).reshape(-1, *[1] * x.ndim)
    return np.asarray(up)


@lru_cache(maxsize=64)
def _binomials(degree: int) -> Array:
    return np.array([float(comb(degree, k)) for k in range(degree + 1)])


# -- coefficients (d+1, …) on [0, 1] ---------------------------------------------------------------


def elevate(c: Array, degree: int) -> Array:
    """Return Bernstein coefficients of the same polynomials at a higher degree."""
    out = np.dot(_elevation(len(c) - 1, degree), c.reshape(len(c), -1))
    return np.asarray(out.reshape(-1, *c.shape[1:]))


@lru_cache(maxsize=256)
def _elevation(low: int, high: int) -> Array:
    """Return the matrix (high+1, low+1) that raises Bernstein coefficients from `low` to `high`."""
    out = np.eye(low + 1)
    for d in range(low + 1, high + 1):
        share = (np.arange(d + 1) / d)[:, None]
        out = share * np.concatenate([out[:1], out]) + (1 - share) * np.concatenate([out, out[-1:]])
    return out


def integral(c: Array) -> Array:
    """Return Bernstein coefficients of the polynomials' integrals from 0, one degree higher."""
    return np.concatenate([np.zeros_like(c[:1]), np.cumsum(c, axis=0)]) / len(c)


def split(c: Array, place: Array | float) -> tuple[Array, Array]:
    """Return Bernstein coefficients on [0, place] and on [place, 1], by de Casteljau's algorithm.

    `place` is one number for all polynomials, or one number for each polynomial.
    """
    left, right, row, rest = [c[0]], [c[-1]], c, 1 - place
    while len(row) > 1:
        row = rest * row[:-1] + place * row[1:]
        left.append(row[0])
        right.append(row[-1])
    return np.stack(left), np.stack(right[::-1])


def part(c: Array, low: Array, high: Array) -> Array:
    """Return Bernstein coefficients of each polynomial on its own part [low, high] of [0, 1]."""
    return split(split(c, high)[0], low / high)[1]
