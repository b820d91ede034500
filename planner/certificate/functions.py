"""Elementary functions of models, by interpolation that is then proven.

Each function is interpolated at the Chebyshev points, which proves nothing; then the interpolant is
put into an equation that the function itself satisfies, and what is left over, bounded by model
arithmetic, bounds the error:

    sine, cosine   S' − C p' and C' + S p': the pair's error keeps its length, so it is at most the
                   error at the middle plus the greatest of what is left
    square root    (y² − p)/(y + √p)
    1/p            (y p − 1)/p
    e^p, p^a       the relative error's derivative is (y' − y p' …)/y
    arctan, log …  y' − g'(p) p', integrated

The remainder of the argument adds by the mean value theorem. A cell on which the function is not
defined, or not smooth, gets an infinite remainder.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.certificate.model import UNIT, Index, Model, interpolated
from planner.systems.base import Array


def sine_cosine(p: Model) -> tuple[Model, Model]:
    """sin and cos."""
    values = p.at_nodes()
    s, c = (Model(interpolated(f(values)), np.zeros(len(values))) for f in (np.sin, np.cos))
    middle, slip = _middle(p)
    start = np.hypot(_middle(s)[0] - np.sin(middle), _middle(c)[0] - np.cos(middle))
    start = start + slip + _middle(s)[1] + _middle(c)[1] + 8 * UNIT
    turn = p.polynomial().slope()
    left = (s.slope() - c * turn).size, (c.slope() + s * turn).size
    error = start + np.hypot(*left) + p.r
    return s.widened(error), c.widened(error)


def square_root(p: Model) -> Model:
    """√p where p > 0."""
    low, y = p.low, _through(p, np.sqrt)
    defect = (y * y - p.polynomial()).size
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(low)
        error = defect / (root + np.maximum(y.low, 0.0)) + p.r / (2 * root)
    return _where(low > 0, y, error)


def reciprocal(p: Model) -> Model:
    """1/p where p keeps its sign."""
    y = _through(p, np.reciprocal)
    least = np.maximum(p.low, -p.high)
    defect = (y * p.polynomial() - 1.0).size
    with np.errstate(divide="ignore", invalid="ignore"):
        error = defect / least + p.r / least**2
    return _where(least > 0, y, error)


def exponential(p: Model) -> Model:
    """e^p."""
    y = _through(p, np.exp)
    defect = (y.slope() - y * p.polynomial().slope()).size
    with np.errstate(over="ignore", invalid="ignore"):
        high, low = np.exp(p.high), np.exp(p.low)
        error = high * (_relative(p, y, np.exp) + defect / low) + high * p.r
    return _where(np.isfinite(error), y, error * (1 + 8 * UNIT))


def power(p: Model, exponent: float) -> Model:
    """p^a with a constant a: whole a ≥ 0 by products, others where p > 0."""
    if exponent == int(exponent) and 0 <= exponent <= 8:
        return _whole(p, int(exponent))
    low = p.low

    def raised(x: Array) -> Array:
        return np.asarray(np.abs(x) ** exponent)

    y = _through(p, raised)
    core = p.polynomial()
    defect = (y.slope() * core - (y * core.slope()).scaled(np.full(len(low), exponent))).size
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ends = raised(low), raised(p.high)
        most, least = np.maximum(*ends), np.minimum(*ends)
        error = most * (_relative(p, y, raised) + defect / (low * least))
        error = error + abs(exponent) * most / low * p.r
    return _where(low > 0, y, error * (1 + 16 * UNIT))


def logarithm(p: Model) -> Model:
    """log p where p > 0."""
    return _primitive(p, np.log, reciprocal(p))


def arctangent(p: Model) -> Model:
    """arctan."""
    return _primitive(p, np.arctan, reciprocal(p * p + 1.0))


def arcsine(p: Model) -> Model:
    """arcsin where |p| < 1."""
    return _primitive(p, np.arcsin, reciprocal(square_root(1.0 + (-(p * p)))))


def arctangent2(y: Model, x: Model) -> Model:
    """The angle of (x, y), on cells that keep to one side of one of the axes (not x < 0)."""
    upright = np.maximum(y.low, -y.high) > np.maximum(x.low, 0.0)
    over, under = _chosen(upright, x, y), _chosen(upright, y, x)
    angle = arctangent(over * reciprocal(under))
    quarter = np.where(upright, np.sign(y.c[:, 0]) * np.pi / 2, 0.0)
    turned = angle.scaled(np.where(upright, -1.0, 1.0))
    turned = turned + Model(quarter[:, None], np.where(upright, UNIT, 0.0))
    return _where(upright | (x.low > 0), turned.polynomial(), turned.r)


def absolute(p: Model) -> Model:
    """|p|; where the sign changes, only its range."""
    sign = np.where(p.low >= 0, 1.0, np.where(p.high <= 0, -1.0, 0.0))
    half = p.size / 2
    kept = p.scaled(sign)
    c = kept.c.copy()
    c[:, 0] = np.where(sign == 0, half, c[:, 0])
    return Model(c, np.where(sign == 0, half * (1 + 4 * UNIT), kept.r))


def signum(p: Model) -> Model:
    """The sign of p; where it changes, only its range."""
    sign = np.where(p.low > 0, 1.0, np.where(p.high < 0, -1.0, 0.0))
    return Model(sign[:, None], np.where(sign == 0, 1.0, 0.0))


def _whole(p: Model, exponent: int) -> Model:
    out = Model.constant(1.0, len(p.r)) if exponent == 0 else p
    for _ in range(exponent - 1):
        out = out * p
    return out


def _through(p: Model, function: Callable[[Array], Array]) -> Model:
    """The interpolant of a function of p's polynomial; nothing is proven of it."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        values = function(p.at_nodes())
    usable = np.all(np.isfinite(values), axis=1)
    c = interpolated(np.where(usable[:, None], values, 1.0))
    return Model(c, np.where(usable, 0.0, np.inf))


def _where(defined: Index, y: Model, error: Array) -> Model:
    fine = defined & np.isfinite(error) & np.isfinite(y.r)
    c = np.where(fine[:, None], y.c, 0.0)
    return Model(c, np.where(fine, error * (1 + 1e-12), np.inf))


def _chosen(mask: Index, first: Model, second: Model) -> Model:
    width = max(first.c.shape[1], second.c.shape[1])
    a, b = (np.pad(m.c, ((0, 0), (0, width - m.c.shape[1]))) for m in (first, second))
    return Model(np.where(mask[:, None], a, b), np.where(mask, first.r, second.r))


def _middle(p: Model) -> tuple[Array, Array]:
    """The polynomial at τ = 0, where Tₖ = 1, 0, −1, 0, …, and a bound on rounding."""
    even = p.c[:, ::2]
    signs = np.where(np.arange(even.shape[1]) % 2 == 0, 1.0, -1.0)
    return np.asarray(even @ signs), p.c.shape[1] * UNIT * p.norm


def _relative(p: Model, y: Model, function: Callable[[Array], Array]) -> Array:
    """Relative error of the interpolant y of a monotone function at the middle."""
    middle, slip = _middle(p)
    value, own = _middle(y)
    exact = function(middle)
    swing = np.abs(function(middle + slip) - function(middle - slip))
    return np.asarray((np.abs(value - exact) + own + swing) / np.abs(exact) + 8 * UNIT)


def _primitive(p: Model, function: Callable[[Array], Array], derivative: Model) -> Model:
    """A function whose derivative is known as a model of the same argument."""
    y, (middle, slip) = _through(p, function), _middle(p)
    value, own = _middle(y)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = function(middle)
    start = np.abs(value - exact) + own + 8 * UNIT * np.abs(exact) + derivative.size * slip
    left = (y.slope() - derivative * p.polynomial().slope()).size
    return _where(np.isfinite(exact), y, start + left + derivative.size * p.r)
