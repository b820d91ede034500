"""Theorem 1 (eqs 1–5): transform a triangular system to the chained form, and back.

    z_N = q_N,  zᵢ = Σ_{j>i} (∂zᵢ₊₁/∂qⱼ) fⱼ  (i = N−1 … 2),  z₁ = q₁
    ż₁ = v₁,    ż₂ = v₂,    żᵢ = zᵢ₋₁ v₁

CasADi takes the derivatives, so the chain may have any length. Separating the term j = i+1 gives
zᵢ = aᵢ + cᵢ fᵢ₊₁(qᵢ; qᵢ₊₁ …), where aᵢ and cᵢ depend only on the coordinates after qᵢ. So the
inverse goes down the chain from q_N, and each step is one scalar equation, which the system solves
(`link_from_slope`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.support.compiled_calls import Pointwise
from planner.systems.triangular_system import TriangularSystem, expect_system


class ChainedForm:
    """Transformation of a system's coordinates and inputs to the chained form, and back.

    The function `chained_form` builds and caches it. In all arrays the last axis holds the
    coordinates or inputs; the leading axes broadcast. `branch`, a result of
    `TriangularSystem.branch`, selects one solution of the inverse."""

    def __init__(self, system: TriangularSystem) -> None:
        self.system = system
        q = ca.SX.sym("q", system.size)
        z, links = _chain(system, q)
        gradient = ca.jacobian(z[1], q)
        slopes = ca.vertcat(*system.slopes_expr(q))
        drift = gradient[0, 2:] @ slopes
        self._z = Pointwise("z", [q], ca.vertcat(*z))
        self._links = {i: Pointwise(f"link{i}", [q], ca.vertcat(*ac)) for i, ac in links.items()}
        feedback = ca.vertcat(system.drive_expr(q), gradient[0, 1], drift)
        self._feedback = Pointwise("feedback", [q], feedback)
        functions = _compile_functions(system, links, q, feedback)
        self._state, self._inputs, self._state_and_inputs = functions

    def __reduce__(self) -> tuple[Any, ...]:
        return chained_form, (self.system,)

    def __repr__(self) -> str:
        return f"ChainedForm({self.system!r})"

    @property
    def point_s(self) -> float:
        """Estimated computing time of `both` per point, s; two more joints multiply it by eight."""
        both = self._state_and_inputs
        return 1e-5 if both is None else 2e-6 + 1e-8 * float(both.function.n_instructions())

    def z_expr(self, q: Any) -> Any:
        """Return the chained coordinates z (N) as a CasADi expression in q (N)."""
        return self._z.function(q)

    def q_expr(self, z: Any, branch: Any) -> Any | None:
        """Return q (N) as an expression in z (N), branch (N); None if a link has no expression."""
        return None if self._state is None else self._state.function(z, branch)

    def inputs_expr(self, z: Any, v: Any, branch: Any) -> Any | None:
        """Return u (2) as an expression in z (N), v (2), branch (N); None if a link has none."""
        return None if self._inputs is None else self._inputs.function(z, v, branch)

    def z(self, q: Array) -> Array:
        """Convert coordinates q (…, N) to chained coordinates z (…, N), by eq. (3)."""
        return self._z(q)

    def v(self, q: Array, u: Array) -> Array:
        """Convert inputs u (…, 2) at q (…, N) to chained inputs v (…, 2), by eq. (4)."""
        drive, slope, drift = np.moveaxis(self._feedback(q), -1, 0)
        v1 = drive * u[..., 0]
        return np.stack([v1, slope * u[..., 1] + drift * v1], axis=-1)

    def u(self, q: Array, v: Array) -> Array:
        """Convert chained inputs v (…, 2) at q (…, N) to u (…, 2); not finite at a singularity."""
        drive, slope, drift = np.moveaxis(self._feedback(q), -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            u1 = v[..., 0] / drive
            u2 = (v[..., 1] - drift * v[..., 0]) / slope
        return np.stack([u1, u2], axis=-1)

    def q(self, z: Array, branch: Array) -> Array:
        """Convert chained coordinates z (…, N) to q (…, N) on a branch; NaN outside the domain."""
        if self._state is None:
            return self._invert(z, branch)
        return self._state(z, np.broadcast_to(branch, z.shape))

    def inputs(self, z: Array, v: Array, branch: Array) -> Array:
        """Convert chained inputs v (…, 2) at chained coordinates z (…, N) to inputs u (…, 2)."""
        if self._inputs is None:
            return self.u(self.q(z, branch), v)
        return self._inputs(z, v, np.broadcast_to(branch, z.shape))

    def both(self, z: Array, v: Array, branch: Array) -> tuple[Array, Array]:
        """Convert chained z (…, N) and v (…, 2) to coordinates q (…, N) and inputs u (…, 2)."""
        if self._state_and_inputs is None:
            q = self._invert(z, branch)
            return q, self.u(q, v)
        values = self._state_and_inputs(z, v, np.broadcast_to(branch, z.shape))
        return values[..., : self.system.size], values[..., self.system.size :]

    def margins(self, z: Array, branch: Array) -> Array:
        """Return the M margins of the chart's domain at z (…, N), shape (…, M); positive inside.

        `system.margin_labels` says what each margin means. If a coordinate has no real value, the
        margins of the coordinates before it are NaN.
        """
        margins: list[Array] = []
        self._invert(z, branch, margins)
        return np.stack(margins, axis=-1)

    def _invert(self, z: Array, branch: Array, margins: list[Array] | None = None) -> Array:
        """Return q (…, N) of z (…, N); fill the list `margins`, if given, with all margins."""
        q = np.full(z.shape, np.nan)
        q[..., 0], q[..., -1] = z[..., 0], z[..., -1]
        for i in range(self.system.size - 2, 0, -1):
            a, c = np.moveaxis(self._links[i](q), -1, 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = (z[..., i] - a) / c
            q[..., i] = self.system.link_from_slope(i, slope, q, branch)
            if margins is not None:
                margins[:0] = self.system.link_margins(i, slope, q, branch)
        return q


@lru_cache(maxsize=64)
def chained_form(system: TriangularSystem) -> ChainedForm:
    """Return the chained form of a system, built once and cached.

    Raises:
        InputError: If the argument is not a system.
    """
    expect_system(system)
    return ChainedForm(system)


def _compile_functions(
    system: TriangularSystem, links: dict[int, tuple[Any, Any]], q: Any, feedback: Any
) -> tuple[Pointwise | None, Pointwise | None, Pointwise | None]:
    """Compile the functions (z, branch) → q, (z, v, branch) → u and (z, v, branch) → (q, u).

    All three are None if `TriangularSystem.link_expr` gives no expression.
    """
    size = system.size
    z, v, branch = ca.SX.sym("z", size), ca.SX.sym("v", 2), ca.SX.sym("branch", size)
    states: list[Any] = [z[0], *[ca.SX(0)] * (size - 2), z[size - 1]]
    for i in range(size - 2, 0, -1):
        a, c = ca.substitute(list(links[i]), [q], [ca.vertcat(*states)])
        link = system.link_expr(i, (z[i] - a) / c, states, branch)
        if link is None:
            return None, None, None
        states[i] = link
    state = ca.vertcat(*states)
    (values,) = ca.substitute([feedback], [q], [state])
    u = ca.vertcat(v[0] / values[0], (v[1] - values[2] * v[0]) / values[1])
    every = [z, v, branch]
    both = Pointwise("both", every, ca.vertcat(state, u))
    return Pointwise("state", [z, branch], state), Pointwise("inputs", every, u), both


def _chain(system: TriangularSystem, q: Any) -> tuple[list[Any], dict[int, tuple[Any, Any]]]:
    """Return the expressions of z, and the pairs (aᵢ, cᵢ) in zᵢ = aᵢ + cᵢ fᵢ₊₁ by array index i."""
    size = system.size
    f = [None, None, *system.slopes_expr(q)]
    z: list[Any] = [q[0], *[None] * (size - 2), q[size - 1]]
    links = {}
    for i in range(size - 2, 0, -1):
        gradient = ca.jacobian(z[i + 1], q)
        c = gradient[0, i + 1]
        a = ca.SX(0)
        for j in range(i + 2, size):
            a += gradient[0, j] * f[j]
        z[i] = a + c * f[i + 1]
        links[i] = (a, c)
    return z, links
