"""Linearised motion as expressions: the effect of a small error of start, inputs or constants.

Along a motion q̇ = f, an error of unit size gives δq̇ = A δq + b with A = ∂f/∂q (H. K. Khalil,
Nonlinear Systems, 3rd ed., section 3.3). The errors are these, with p the size of an error:

    gain u1, gain u2        uᵢ becomes (1 + p) uᵢ
    bias u1, bias u2        p is added to uᵢ, in its unit
    delay u1, delay u2      the input arrives p seconds late (and ends p seconds late)
    stretch u1, stretch u2  the clock of uᵢ is slow by the fraction p: it arrives p t seconds late,
                            scaled so that its integral stays the same
    start <coordinate>      offset of the start, in the coordinate's unit
    K2, K3 …                relative error of a gear constant (of arms)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.triangular_system import PlanarArm, TriangularSystem


@dataclass(frozen=True)
class ErrorParameter:
    """An error, by name ("gain u1", "start theta2", "K3") and unit ("1" for relative errors)."""

    name: str
    unit: str

    @property
    def family(self) -> str:
        """Kind of the error: the first word of the name, or "gear" for a gear constant Kᵢ."""
        return self.name.split()[0] if " " in self.name else "gear"


@dataclass(frozen=True, eq=False)
class Linearisation:
    """CasADi expressions of the linearised motion.

    Attributes:
        q: Symbol of the coordinates (N).
        u: Symbol of the inputs (2).
        t: Symbol of the time since the start, s.
        rates: q̇ (N).
        A: ∂q̇/∂q (N, N).
        forcing: b (N) in δq̇ = A δq + b for an error of one unit, by the error's name.
        initial: δq(0), shape (N,), for an error of one unit, by the error's name.
    """

    q: Any
    u: Any
    t: Any
    rates: Any
    A: Any
    forcing: Mapping[str, Any]
    initial: Mapping[str, Array]


@lru_cache(maxsize=32)
def parameters(system: TriangularSystem) -> tuple[ErrorParameter, ...]:
    """Return the errors that a system can have, in the order of the table in this file."""
    u = system.inputs
    return (
        *(ErrorParameter(f"gain {i.name}", "1") for i in u),
        *(ErrorParameter(f"bias {i.name}", i.unit) for i in u),
        *(ErrorParameter(f"delay {i.name}", "s") for i in u),
        *(ErrorParameter(f"stretch {i.name}", "1") for i in u),
        *(ErrorParameter(f"start {c.name}", c.unit) for c in system.coordinates),
        *(ErrorParameter(f"K{i}", "1") for i in range(2, gear_count(system) + 2)),
    )


def gear_count(system: TriangularSystem) -> int:
    """Return the number of gear constants Kᵢ of a system; 0 if the system is not an arm."""
    return system.n - 1 if isinstance(system, PlanarArm) else 0


@lru_cache(maxsize=32)
def linearise(system: TriangularSystem) -> Linearisation:
    """Build the expressions of a system's linearised motion.

    A delayed input uᵢ(t − p) acts only through the Lie bracket: integrating −u̇ᵢ gᵢ by parts gives
    the forcing u₁u₂[gⱼ, gᵢ], j ≠ i, without a derivative of the input, so inputs may jump.
    A slow clock is a delay that grows with time, treated in the same way. For both errors, δq is
    the error once the late input has been applied in full, as at the end of the motion.
    """
    q, u, t = ca.SX.sym("q", system.size), ca.SX.sym("u", 2), ca.SX.sym("t")
    f = ca.vertcat(*system.rates_expr(q, u))
    g1, g2 = (ca.jacobian(f, u)[:, i] for i in range(2))
    late = u[0] * u[1] * (ca.jacobian(g2, q) @ g1 - ca.jacobian(g1, q) @ g2)  # u1 u2 [g1, g2]
    columns = [g1 * u[0], g2 * u[1], g1, g2, -late, late, -t * late, t * late]
    columns += [ca.SX(system.size, 1) for _ in system.coordinates]
    for i in range(2, gear_count(system) + 2):
        column = ca.SX(system.size, 1)
        column[i] = f[i]
        columns.append(column)
    names = [p.name for p in parameters(system)]
    initial = {name: np.zeros(system.size) for name in names}
    for i, c in enumerate(system.coordinates):
        initial[f"start {c.name}"][i] = 1.0
    forcing = dict(zip(names, columns, strict=True))
    return Linearisation(q, u, t, f, ca.jacobian(f, q), forcing, initial)
