"""Collocation schemes: points, differentiation, quadrature, end point and Bernstein form.

On one interval, scaled to [0, 1], a coordinate is the polynomial of degree d through its value at 0
and at the d collocation points. Everything else is linear in those d + 1 values.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import casadi as ca
import numpy as np
from scipy.special import comb

from planner.systems.base import Array

Kind = Literal["radau", "legendre"]


@dataclass(frozen=True, eq=False)
class Scheme:
    """Weights of one scheme; build it with `scheme`.

    Attributes:
        kind: "radau" (right end point is a collocation point, order 2d − 1 at the end of an
            interval) or "legendre" (order 2d).
        degree: Number d of collocation points.
        points: τ₁ … τ_d, shape (d,), in (0, 1].
        differentiation: Shape (d, d+1): values at (0, τ₁ … τ_d) to derivatives at τ₁ … τ_d.
        integration: Shape (d, d): rates at the points to the moves from 0 to τ₁ … τ_d.
        quadrature: Shape (d,): ∫₀¹ f ≈ Σ quadrature · f(points).
        end: Shape (d+1,): values to the value at 1.
        bernstein: Shape (d+1, d+1): values to Bernstein coefficients.
    """

    kind: Kind
    degree: int
    points: Array
    differentiation: Array
    integration: Array
    quadrature: Array
    end: Array
    bernstein: Array

    @property
    def closed(self) -> bool:
        """Whether the last collocation point is the interval's end."""
        return self.kind == "radau"


@lru_cache(maxsize=16)
def scheme(kind: Kind, degree: int) -> Scheme:
    """The scheme of that kind and degree (1 to 5)."""
    points = np.array(ca.collocation_points(degree, kind))
    derivative, end = (np.array(m) for m in ca.collocation_coeff(points.tolist())[:2])
    powers = np.arange(degree)
    moments = points ** powers[:, None]
    values = bernstein_values(degree, np.array([0.0, *points]))
    return Scheme(
        kind=kind,
        degree=degree,
        points=points,
        differentiation=derivative.T,
        integration=np.asarray(np.linalg.inv(derivative.T[:, 1:]), dtype=float),
        quadrature=np.asarray(np.linalg.solve(moments, 1 / (powers + 1.0)), dtype=float),
        end=end.ravel(),
        bernstein=np.asarray(np.linalg.inv(values), dtype=float),
    )


def bernstein_values(degree: int, tau: Array) -> Array:
    """Bernstein polynomials of that degree at tau (m,): shape (m, degree+1)."""
    j = np.arange(degree + 1)
    x = tau[:, None]
    return np.asarray(comb(degree, j) * x**j * (1 - x) ** (degree - j))
