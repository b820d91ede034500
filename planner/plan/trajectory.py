"""Curves in time that can be evaluated anywhere: the continuous form of every plan.

A trajectory stores piecewise polynomials in the Bernstein basis (`Bernstein`), whose coefficients
bound the curve, and computes all other quantities with the system's chained form.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.plan.curves import expect_curve, nonfinite_part
from planner.support.arrays import Array, Frozen, floats, jsonable
from planner.support.calculus.bernstein import Bernstein, Pieces
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import TriangularSystem


class Trajectory(Frozen, ABC):
    """Curves q(t), u(t), z(t) and v(t) on [0, duration], vectorised over t.

    Before 0 and after the duration, coordinates are those of the nearest end; inputs are zero.
    """

    kind: ClassVar[str]
    _kinds: ClassVar[dict[str, type[Trajectory]]] = {}
    system: TriangularSystem

    def __init_subclass__(cls) -> None:
        if "kind" in vars(cls):  # a file's kind is the class that defines it, never a subclass
            Trajectory._kinds.setdefault(cls.kind, cls)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Trajectory) or self.system != other.system:
            return False
        return bool(jsonable(self.to_dict()) == jsonable(other.to_dict()))

    def __hash__(self) -> int:
        return hash((self.system, self.kind, *self.breaks.tolist()))

    def __repr__(self) -> str:
        pieces = len(self.breaks) - 1
        return f"{type(self).__name__}({self.system.kind}, {pieces} pieces, {self.duration:.4g} s)"

    @property
    @abstractmethod
    def breaks(self) -> Array:
        """Break times (K+1,) between which the curve is smooth, in seconds."""

    @abstractmethod
    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates, shape (…, N), at times t (…)."""

    @abstractmethod
    def u(self, t: ArrayLike) -> Array:
        """Return the inputs, shape (…, 2), at times t (…); the right-hand limit at a break."""

    @abstractmethod
    def z(self, t: ArrayLike) -> Array:
        """Return the chained coordinates, shape (…, N), at times t (…)."""

    @abstractmethod
    def v(self, t: ArrayLike) -> Array:
        """Return the chained inputs, shape (…, 2), at times t (…)."""

    @abstractmethod
    def margins(self, t: ArrayLike) -> Array:
        """Return the signed chart margins, shape (…, M), at times t (…); see
        `ChainedForm.margins`."""

    @abstractmethod
    def piece_values(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        """Return q (P, C, N) and u (P, C, 2) at fractions 0 … 1, shape (P, C), of the pieces (C,).

        If q or u jumps at a break, a fraction of 0 or 1 gives the limit from inside the piece. For
        many points on few pieces this takes a tenth of the time of q(t) and u(t).
        """

    @abstractmethod
    def slowed(self, factor: float) -> Trajectory:
        """Return the same path with a motion that takes `factor` times as long.

        −1 runs the motion backwards, from its end to its start.
        """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data, which `trajectory_from_dict` reads back exactly."""

    @classmethod
    @abstractmethod
    def from_dict(cls, system: TriangularSystem, data: Mapping[str, Any]) -> Trajectory:
        """Return the trajectory that `to_dict` wrote."""

    @property
    def degree(self) -> int:
        """Highest degree of the curves' polynomials; 0 without polynomials."""
        return 0

    @property
    def in_coordinates(self) -> bool:
        """Whether q and u are stored, so that they exist outside the chart's domain too."""
        return False

    @property
    def flaw(self) -> str:
        """Reason why the trajectory is not a valid motion of its kind; empty if it is valid.

        Proofs about a trajectory assume that the reason is empty.
        """
        return ""

    @cached_property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return float(self.breaks[-1])

    def _clip(self, t: ArrayLike) -> Array:
        return np.asarray(floats("t", t).clip(0.0, self.duration))

    def _is_running(self, t: ArrayLike) -> Array:
        times = np.asarray(t, dtype=float)
        return np.asarray((times >= 0) & (times <= self.duration), dtype=float)[..., None]


@dataclass(frozen=True, repr=False, eq=False)
class ChainedTrajectory(Trajectory):
    """A trajectory stored in chained coordinates.

    Attributes:
        system: The system that moves.
        z_curve: The curve of z, values (N,).
        v_curve: The curve of v, values (2,), on the same breaks.
        branch: Signs (N,) of the chart's branch.

    Raises:
        ValueError: If the curves differ in their breaks or have the wrong number of values, or the
            breaks do not increase from 0.
    """

    kind: ClassVar[str] = "chained"
    system: TriangularSystem
    z_curve: Bernstein
    v_curve: Bernstein
    branch: Array

    def __post_init__(self) -> None:
        for name, values in (("z_curve", self.system.size), ("v_curve", 2)):
            object.__setattr__(self, name, expect_curve(name, getattr(self, name), (values,)))
        if not np.array_equal(self.z_curve.x, self.v_curve.x):
            raise ValueError("z_curve and v_curve must have the same breaks")
        super().__post_init__()
        if np.shape(self.branch) != (self.system.size,):
            raise ValueError(f"branch must have {self.system.size} entries")

    @property
    def breaks(self) -> Array:
        """Times of the breaks between the polynomial pieces."""
        return np.asarray(self.z_curve.x)

    @property
    def degree(self) -> int:
        """The higher degree of the two curves."""
        return max(self.z_curve.degree, self.v_curve.degree)

    @property
    def flaw(self) -> str:
        """Which of the stored arrays contain NaN or infinity; empty if none does."""
        return nonfinite_part(z_curve=self.z_curve.c, v_curve=self.v_curve.c, branch=self.branch)

    def z(self, t: ArrayLike) -> Array:
        """Return the chained coordinates, from their polynomials."""
        return self.z_curve(self._clip(t))

    def v(self, t: ArrayLike) -> Array:
        """Return the chained inputs, from their polynomials; zero outside [0, duration]."""
        return self.v_curve(self._clip(t)) * self._is_running(t)

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates, by the inverse chart; NaN outside the chart's domain."""
        return chained_form(self.system).q(self.z(t), self.branch)

    def u(self, t: ArrayLike) -> Array:
        """Return the inputs, by the feedback transformation."""
        times = self._clip(t)
        z, v = self.z_curve(times), self.v_curve(times)
        u = chained_form(self.system).inputs(z, v, self.branch)
        return np.where(self._is_running(t) > 0, u, 0.0)

    def margins(self, t: ArrayLike) -> Array:
        """Return the chart margins, from z so that they exist even where q is not real."""
        return chained_form(self.system).margins(self.z(t), self.branch)

    def piece_values(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        """Return q and u by inverse chart and feedback transformation; NaN outside the domain."""
        z = self.z_curve.piece_values(piece, fraction)
        v = self.v_curve.piece_values(piece, fraction)
        return chained_form(self.system).both(z, v, self.branch)

    def slowed(self, factor: float) -> ChainedTrajectory:
        """Return the same path with a motion that takes `factor` times as long."""
        z, v = self.z_curve.slowed(factor), self.v_curve.slowed(factor, 1 / factor)
        return ChainedTrajectory(self.system, z, v, self.branch)

    def to_dict(self) -> dict[str, Any]:
        """Return the trajectory as JSON-ready data."""
        return {
            "kind": self.kind,
            "branch": self.branch.tolist(),
            "z": self.z_curve.to_dict(),
            "v": self.v_curve.to_dict(),
        }

    @classmethod
    def from_dict(cls, system: TriangularSystem, data: Mapping[str, Any]) -> ChainedTrajectory:
        """Return the trajectory that `to_dict` wrote."""
        branch = np.asarray(data["branch"], dtype=float)
        return cls(system, Bernstein.from_dict(data["z"]), Bernstein.from_dict(data["v"]), branch)


@dataclass(frozen=True, repr=False, eq=False)
class StateTrajectory(Trajectory):
    """A trajectory stored in coordinates and inputs.

    Attributes:
        system: The system that moves.
        q_curve: The curve of q, values (N,).
        u_curve: The curve of u, values (2,), on the same breaks.

    Raises:
        ValueError: If the curves differ in their breaks or have the wrong number of values, or the
            breaks do not increase from 0.
    """

    kind: ClassVar[str] = "state"
    system: TriangularSystem
    q_curve: Bernstein
    u_curve: Bernstein

    def __post_init__(self) -> None:
        for name, values in (("q_curve", self.system.size), ("u_curve", 2)):
            object.__setattr__(self, name, expect_curve(name, getattr(self, name), (values,)))
        if not np.array_equal(self.q_curve.x, self.u_curve.x):
            raise ValueError("q_curve and u_curve must have the same breaks")

    @property
    def breaks(self) -> Array:
        """Times of the breaks between the polynomial pieces."""
        return np.asarray(self.q_curve.x)

    @property
    def degree(self) -> int:
        """The higher degree of the two curves."""
        return max(self.q_curve.degree, self.u_curve.degree)

    @property
    def flaw(self) -> str:
        """Which of the stored arrays contain NaN or infinity; empty if none does."""
        return nonfinite_part(q_curve=self.q_curve.c, u_curve=self.u_curve.c)

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates, from their polynomials."""
        return self.q_curve(self._clip(t))

    def u(self, t: ArrayLike) -> Array:
        """Return the inputs, from their polynomials; zero outside [0, duration]."""
        return self.u_curve(self._clip(t)) * self._is_running(t)

    def z(self, t: ArrayLike) -> Array:
        """Return the chained coordinates, by the chart, which exists at every configuration."""
        return chained_form(self.system).z(self.q(t))

    def v(self, t: ArrayLike) -> Array:
        """Return the chained inputs, by the feedback transformation."""
        return chained_form(self.system).v(self.q(t), self.u(t))

    def margins(self, t: ArrayLike) -> Array:
        """Return the chart margins, from q on the branch in which the motion starts."""
        branch = self.system.branch(self.q(0.0))
        return self.system.chart_margins(self.q(t), branch)

    def piece_values(self, piece: Pieces, fraction: Array) -> tuple[Array, Array]:
        """Return q and u from their polynomials, with the shapes of `Trajectory.piece_values`."""
        q = self.q_curve.piece_values(piece, fraction)
        return q, self.u_curve.piece_values(piece, fraction)

    def slowed(self, factor: float) -> StateTrajectory:
        """Return the same path with a motion that takes `factor` times as long."""
        q, u = self.q_curve.slowed(factor), self.u_curve.slowed(factor, 1 / factor)
        return StateTrajectory(self.system, q, u)

    def to_dict(self) -> dict[str, Any]:
        """Return the trajectory as JSON-ready data."""
        return {"kind": self.kind, "q": self.q_curve.to_dict(), "u": self.u_curve.to_dict()}

    @classmethod
    def from_dict(cls, system: TriangularSystem, data: Mapping[str, Any]) -> StateTrajectory:
        """Return the trajectory that `to_dict` wrote."""
        return cls(system, Bernstein.from_dict(data["q"]), Bernstein.from_dict(data["u"]))

    @property
    def in_coordinates(self) -> bool:
        """Whether q and u are stored, which is true for every `StateTrajectory`."""
        return True


def trajectory_from_dict(system: TriangularSystem, data: Mapping[str, Any]) -> Trajectory:
    """Return the trajectory that `Trajectory.to_dict` wrote.

    Raises:
        InputError: If the kind is unknown.
    """
    kind = data["kind"]
    if kind not in Trajectory._kinds:
        raise InputError(
            f"trajectory kind {kind!r} is unknown; allowed: {', '.join(Trajectory._kinds)}"
        )
    return Trajectory._kinds[kind].from_dict(system, data)
