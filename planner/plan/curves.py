"""Piecewise polynomials in the Bernstein basis (`scipy.interpolate.BPoly`).

Their values, roots and range, and how a file holds them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, PPoly

from planner.support.arrays import Array

Pieces = NDArray[np.int_]
"""Numbers of pieces, from 0."""


def expect_curve(name: str, curve: BPoly, values: tuple[int, ...]) -> None:
    """Refuse a curve that cannot be evaluated over [0, duration].

    Raises:
        ValueError: If its breaks do not increase from 0 or its values have another shape.
    """
    breaks, shape = np.asarray(curve.x), curve.c.shape[2:]
    if breaks[0] != 0 or not np.all(np.diff(breaks) > 0) or not np.isfinite(breaks[-1]):
        raise ValueError(f"the breaks of {name} must increase from 0 and be finite")
    if shape != values or np.iscomplexobj(curve.c):
        raise ValueError(f"{name} must have real values of shape {values}, not {shape}")


def undefined(**parts: Array) -> str:
    """Which of some arrays holds what is no finite number, in words; empty if none does."""
    bad = [name for name, part in parts.items() if not np.all(np.isfinite(part))]
    return f"{' and '.join(bad)} hold numbers that are not finite" if bad else ""


def on_pieces(curve: BPoly, piece: Pieces, fraction: Array) -> Array:
    """Values (P, C, …) of a piecewise polynomial at fractions (P, C) of its pieces (C,).

    The Bernstein basis at the fractions, times the coefficients.
    """
    degree, shape = len(curve.c) - 1, (*fraction.shape, *curve.c.shape[2:])
    c = curve.c[:, piece].reshape(degree + 1, len(piece), -1)
    if np.all(fraction == fraction[:, :1]):  # the same in all pieces: one matrix
        return product(_bernstein(degree, fraction[:, 0]).T, c.reshape(degree + 1, -1)).reshape(
            shape
        )
    basis = np.transpose(_bernstein(degree, fraction), (2, 1, 0))
    return np.asarray(np.swapaxes(basis @ np.swapaxes(c, 0, 1), 0, 1).reshape(shape))


def at_times(curve: BPoly, t: Array) -> Array:
    """Values (…) of a scalar piecewise polynomial at many times (…): its own call, but faster."""
    piece = np.clip(np.searchsorted(curve.x, t, side="right") - 1, 0, len(curve.x) - 2)
    basis = _bernstein(len(curve.c) - 1, (t - curve.x[piece]) / np.diff(curve.x)[piece])
    return np.asarray(np.sum(basis * curve.c[:, piece], axis=0))


def _bernstein(degree: int, x: Array) -> Array:
    """All Bernstein polynomials of a degree at x, on a new first axis."""
    up, down = np.ones((2, degree + 1, *x.shape))
    rest = 1 - x
    for k in range(1, degree + 1):
        up[k], down[k] = up[k - 1] * x, down[k - 1] * rest
    up *= down[::-1]
    up *= _binomials(degree).reshape(-1, *[1] * x.ndim)
    return np.asarray(up)


@lru_cache(maxsize=32)
def _binomials(degree: int) -> Array:
    return np.array([float(comb(degree, k)) for k in range(degree + 1)])


def product(matrix: Array, columns: Array) -> Array:
    """The matrix times columns (K, M), a few at a time.

    OpenBLAS starts threads for products of more than 2^18 multiplications (its default,
    GEMM_MULTITHREAD_THRESHOLD 4); on a computer that is busy they cost more than they gain.
    """
    most = max(1, 2**18 // matrix.size)
    if columns.shape[1] <= most:
        return np.asarray(matrix @ columns)
    out = np.empty((len(matrix), columns.shape[1]))
    for k in range(0, columns.shape[1], most):
        np.matmul(matrix, columns[:, k : k + most], out=out[:, k : k + most])
    return out


def polynomial_roots(curve: BPoly, component: int) -> list[float]:
    """Times at which one component of a piecewise polynomial is zero, by polynomial roots."""
    scalar = BPoly(np.ascontiguousarray(curve.c[:, :, component]), curve.x)
    roots = PPoly.from_bernstein_basis(scalar).roots(extrapolate=False)
    return sorted({float(r) for r in np.atleast_1d(roots) if np.isfinite(r)})


def polynomial_range(curve: BPoly, component: int) -> tuple[float, float]:
    """Least and greatest value of one component over all time, by the roots of its derivative."""
    times = np.concatenate([curve.x, polynomial_roots(curve.derivative(), component)])
    values = curve(times)[:, component]
    return float(values.min()), float(values.max())


def stretched(curve: BPoly, factor: float, gain: float = 1.0) -> BPoly:
    """The curve in `factor` times the time, its values times `gain`."""
    return BPoly(curve.c * gain, curve.x * factor)


def curve_to_dict(curve: BPoly) -> dict[str, Any]:
    """JSON-ready form of a piecewise polynomial."""
    return {"breaks": curve.x.tolist(), "bernstein": curve.c.tolist()}


def curve_from_dict(data: Mapping[str, Any]) -> BPoly:
    """Read back what `curve_to_dict` wrote."""
    return BPoly(
        np.asarray(data["bernstein"], dtype=float), np.asarray(data["breaks"], dtype=float)
    )
