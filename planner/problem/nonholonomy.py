"""Section 3.2 of the paper for a problem: is the system controllable at its start and goal?

Also tests the paper's proof of controllability, eqs (9)–(17), on the paper's own mechanism.

The paper builds a basis X₁ … Xₙ, Yₙ of all directions by

    Xᵢ₊₁ = (cᵢYᵢ − sᵢZᵢ)/(cᵢ² kᵢ₊₁)  (12)     Yᵢ₊₁ = sᵢYᵢ + cᵢZᵢ  (13)
    Zᵢ = [Xᵢ, Yᵢ] = ∂Yᵢ/∂θᵢ  (16)

and claims Xᵢ₊₁ = ∂/∂θᵢ₊₁ (14), Yᵢ₊₁ = (0, yᵢ₊₁) (15) and a determinant that vanishes nowhere (17).
With the fields of eq. (6) none of these holds. What holds for sinθᵢ ≠ 0 is

    Xᵢ₊₁ = (sᵢYᵢ + cᵢZᵢ)/(−2kᵢ₊₁cᵢ³sᵢ)     Yᵢ₊₁ = cᵢYᵢ − sᵢZᵢ − kᵢ₊₁cᵢ²(1 + 2sᵢ²)Xᵢ₊₁     i ≤ n − 2
    Xₙ = Zₙ₋₁/(−3kₙcₙ₋₁²sₙ₋₁)              Yₙ = Yₙ₋₁ − kₙcₙ₋₁³Xₙ

The last step differs because cosθₙ₋₁ drives neither θₙ nor the disk: eq. (6) ends at n − 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.support.casadi import ca
from planner.systems.controllability import Controllability, controllability, lie_bracket
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

SINGULAR = 1e-12
"""Value of |sinθᵢ| or |cosθᵢ| below which step i of a recursion counts as dividing by zero."""

Step = Callable[[float, bool, Any, Any, Any], tuple[Any, Any]]
"""Step of a recursion: function of kᵢ₊₁, whether the step is last, θᵢ, Yᵢ and Zᵢ to Xᵢ₊₁, Yᵢ₊₁."""


@dataclass(frozen=True)
class Family:
    """Result of one recursion for the basis X₁ … Xₙ, Yₙ at one configuration.

    Attributes:
        x_error: Largest entry of |Xᵢ₊₁ − ∂/∂θᵢ₊₁| for each step i = 1 … n−1; NaN from the first
            division by zero on.
        y_error: Largest entry of |Yᵢ₊₁ − (0, yᵢ₊₁)| for each step; NaN where `x_error` is.
        divides_by_zero: Steps i whose divisor vanishes at q.
        determinant: det(X₁ … Xₙ, Yₙ), rows in the order θ₁ … θₙ, φ; NaN after a division by zero.
    """

    x_error: tuple[float, ...]
    y_error: tuple[float, ...]
    divides_by_zero: tuple[int, ...]
    determinant: float

    @property
    def holds(self) -> tuple[bool, ...]:
        """Whether each step satisfies eqs (14) and (15) of the paper."""
        return tuple(max(e) < 1e-9 for e in zip(self.x_error, self.y_error, strict=True))


@dataclass(frozen=True)
class PaperRecursion:
    """Result of `paper_recursion`: the recursion as printed, and as corrected."""

    printed: Family
    corrected: Family

    def __str__(self) -> str:
        lines = ["as printed, (12) and (13) with the fields of eq. (6):"]
        lines += _steps(self.printed)
        lines.append(f"  determinant (17): {self.printed.determinant:.6g}")
        lines.append("corrected for the cos^3 law:")
        lines += _steps(self.corrected)
        lines.append(f"  determinant: {self.corrected.determinant:.6g}")
        if self.corrected.divides_by_zero:
            lines.append(
                "  at sin(theta_i) = 0 no basis of this form exists: the first bracket vanishes and"
                " longer ones are needed (see controllability)"
            )
        return "\n".join(lines)


def paper_recursion(system: Manipulator, q: ArrayLike) -> PaperRecursion:
    """Evaluate the paper's recursion as printed and as corrected.

    Args:
        system: The paper's manipulator.
        q: Configuration (φₙ₋₁, θ₁ … θₙ), shape (n+1,), radians.

    Returns:
        For both forms, which steps hold, which divide by zero, and the determinants.

    Raises:
        InputError: If the system is not the manipulator or q does not fit it.
    """
    if not isinstance(system, Manipulator):
        raise InputError(f"the paper's recursion is for the manipulator, not the {system.kind}")
    point = np.asarray(q, dtype=float)
    if point.shape != (system.size,) or not np.all(np.isfinite(point)):
        raise InputError(f"q = {point.tolist()}: the manipulator needs {system.size} numbers")
    sines, cosines = np.abs(np.sin(point[1:-1])), np.abs(np.cos(point[1:-1]))
    flat = {i for i, c in enumerate(cosines, start=1) if c < SINGULAR}
    straight = {i for i, s in enumerate(sines, start=1) if s < SINGULAR}
    printed = _family(system, point, _printed_step, flat)
    return PaperRecursion(printed, _family(system, point, _corrected_step, flat | straight))


def _printed_step(k: float, last: bool, angle: Any, Y: Any, Z: Any) -> tuple[Any, Any]:
    s, c = ca.sin(angle), ca.cos(angle)
    return (c * Y - s * Z) / (c**2 * k), s * Y + c * Z


def _corrected_step(k: float, last: bool, angle: Any, Y: Any, Z: Any) -> tuple[Any, Any]:
    s, c = ca.sin(angle), ca.cos(angle)
    if last:
        X = Z / (-3 * k * c**2 * s)
        return X, Y - k * c**3 * X
    X = (s * Y + c * Z) / (-2 * k * c**3 * s)
    return X, c * Y - s * Z - k * c**2 * (1 + 2 * s**2) * X


def _family(system: Manipulator, point: Array, step: Step, zero: set[int]) -> Family:
    """Run a recursion symbolically and evaluate it at `point`.

    The rows of all fields are (φ, θ₁ … θₙ), as in q; only the determinant has φ last. `zero` holds
    the steps that divide by zero.
    """
    n, q, k = system.n, ca.SX.sym("q", system.size), system.k_g * system.K
    X, Y = ca.SX.eye(system.size)[:, 1], ca.vertcat(*system.rates_expr(q, [1.0, 0.0]))
    family, remainders = [X], [Y]
    for i in range(1, n):
        X, Y = step(k[i - 1], i == n - 1, q[i], Y, lie_bracket(X, Y, q))
        family.append(X)
        remainders.append(Y)
    columns = ca.densify(ca.horzcat(*family, *remainders))
    values = np.array(ca.Function("family", [q], [columns])(point))
    xs, ys = values[:, :n], values[:, n:]
    order = min(zero, default=n)
    x_error = [np.max(np.abs(xs[:, i] - np.eye(n + 1)[:, i + 1])) for i in range(1, n)]
    y_error = [np.max(np.abs(ys[:, i] - _remaining_field(ys[:, 0], point, i))) for i in range(1, n)]
    basis = np.roll(np.column_stack([xs, ys[:, -1]]), -1, axis=0)
    return Family(
        x_error=tuple(float(e) if i < order else np.nan for i, e in enumerate(x_error, start=1)),
        y_error=tuple(float(e) if i < order else np.nan for i, e in enumerate(y_error, start=1)),
        divides_by_zero=tuple(sorted(zero)),
        determinant=float(np.linalg.det(basis)) if order == n else np.nan,
    )


def _remaining_field(first: Array, point: Array, i: int) -> Array:
    """Return (0, yᵢ₊₁): φ and θᵢ₊₂ … θₙ of the field Y₁, divided by cosθ₁ … cosθᵢ (φ: to n − 2)."""
    n = len(point) - 1
    out = np.zeros(n + 1)
    passed = np.prod(np.cos(point[1 : i + 1]))
    out[i + 2 :] = first[i + 2 :] / passed
    out[0] = first[0] / (passed if i < n - 1 else np.prod(np.cos(point[1 : n - 1])))
    return out


def _steps(family: Family) -> list[str]:
    out = []
    results = zip(family.x_error, family.y_error, family.holds, strict=True)
    for i, (x, y, good) in enumerate(results, start=1):
        if i in family.divides_by_zero:
            out.append(f"  step {i}: divides by zero")
        elif np.isnan(x):
            out.append(f"  step {i}: not reached")
        else:
            holds = "holds" if good else "does not hold"
            out.append(f"  step {i}: {holds} (X off by {x:.3g}, Y off by {y:.3g})")
    return out


MOST_DEPTH = 8
"""Longest bracket that `nonholonomy` examines; `planner.controllability` has no such limit."""

RECURSION_JOINTS = 6
"""Largest number of joints for the paper's recursion, which then takes a second; each further joint
multiplies that time by eight."""


@dataclass(frozen=True)
class Probe:
    """Controllability at one configuration; `finding` is None if the kinematics are singular."""

    name: str
    finding: Controllability | None

    def to_dict(self) -> dict[str, Any]:
        """Return the probe as JSON-ready data."""
        finding = None if self.finding is None else self.finding.to_dict()
        return {"at": self.name, "controllability": finding}

    def __str__(self) -> str:
        if self.finding is None:
            return "the kinematics are infinite here"
        f = self.finding
        growth = ", ".join(str(g) for g in f.growth)
        frobenius = "involutive: holonomic" if f.involutive else "not involutive: nonholonomic"
        chow = "controllable" if f.chow else f"not shown up to bracket length {f.depth}"
        return f"growth vector ({growth}), N = {f.size}; Frobenius: {frobenius}; Chow: {chow}"


@dataclass(frozen=True)
class Nonholonomy:
    """Result of `nonholonomy`.

    Attributes:
        places: Start, goal, and for the manipulator the start with θ₁ = 0.
        recursion: The paper's recursion (12)–(15) at the start; None for other systems and for arms
            with more than six joints.
    """

    places: tuple[Probe, ...]
    recursion: PaperRecursion | None

    @property
    def recursion_verdict(self) -> str:
        """Line on which steps of the paper's recursion fail; "" if the recursion was not tested."""
        if self.recursion is None:
            return ""
        failing = [str(i) for i, holds in enumerate(self.recursion.printed.holds, 1) if not holds]
        zeros = [str(i) for i in self.recursion.corrected.divides_by_zero]
        text = f"as printed fails at step {', '.join(failing)}" if failing else "as printed holds"
        corrected = (
            f"divides by zero at step {', '.join(zeros)}"
            if zeros
            else "holds here, and divides by zero where a theta is 0"
        )
        return f"{text} (it belongs to a sine law); corrected for cos^3 it {corrected}"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-ready data."""
        verdict = self.recursion_verdict or None
        return {"places": [p.to_dict() for p in self.places], "paper_recursion": verdict}


def nonholonomy(problem: Problem) -> Nonholonomy:
    """Test controllability at the start, and at the goal if it gives all joints.

    For the manipulator, also test the start with θ₁ = 0, and the paper's recursion at the start.
    """
    start, goal = problem.start, np.where(np.isnan(problem.goal), problem.start, problem.goal)
    places = [_place(problem.system, "start", start)]
    if not problem.free:
        places.append(_place(problem.system, "goal", goal))
    recursion = None
    if isinstance(problem.system, Manipulator):
        straight = start.copy()
        straight[1] = 0.0
        places.append(_place(problem.system, "start with theta1 = 0", straight))
        if problem.system.n <= RECURSION_JOINTS:
            recursion = paper_recursion(problem.system, start)
    return Nonholonomy(tuple(places), recursion)


def _place(system: TriangularSystem, name: str, q: Array) -> Probe:
    """Test controllability at q (N,), with limited brackets where long ones may be needed."""
    flat = int(np.sum(np.abs(q[1:-1]) < 1e-12))
    depth = MOST_DEPTH if system.size - 1 + flat > MOST_DEPTH else None
    try:
        return Probe(name, controllability(system, q, depth))
    except InputError:
        return Probe(name, None)
