"""Test controllability at a configuration: Lie brackets, growth vector, Frobenius and Chow.

This replaces the recursion of the paper's section 3.2, which does not hold for the paper's own
mechanism (`planner.problem.nonholonomy`).

The Lie brackets of the two input fields are formed symbolically, one per Lyndon word. The brackets
of the Lyndon words of length ≤ k over {g₁, g₂} span all brackets of length ≤ k (C. Reutenauer, Free
Lie Algebras, 1993, ch. 5); there are 2, 3, 5, 8, 14, 23, 41 … of them for k = 1, 2, 3 ….
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError
from planner.support.arrays import Array, floats
from planner.support.casadi import ca
from planner.support.compiled_calls import Pointwise
from planner.systems.triangular_system import TriangularSystem, expect_system

RANK_TOLERANCE = 1e-14
"""Share of the largest singular value above which a singular value counts towards the rank."""

_NEIGHBOUR_POINTS = 8
_NEIGHBOUR_RADIUS = 0.1
_LARGEST_VALUE = 1e12


@dataclass(frozen=True)
class Controllability:
    """Result of `controllability` at one configuration.

    Attributes:
        system: Kind of the system.
        q: The configuration, in the coordinates' units.
        size: Number N of coordinates.
        growth: Growth vector: dimension spanned by all brackets of length ≤ 1, 2, … at q.
        degree: Degree of nonholonomy: the bracket length at which the growth vector reaches N;
            None if it stays below N up to the examined depth.
        basis: Names of independent brackets, shortest first: N of them if `chow` is true.
        singular_values: Singular values of the matrix of all brackets examined, largest first.
        tolerance: A singular value counts towards the rank if it exceeds this share of the largest.
        involutive: Whether [g₁, g₂] stays in span{g₁, g₂} at q and around it (Frobenius).
        chow: Whether the brackets span all N directions (Chow). If so, the system is locally
            controllable at q; if not, this depth does not decide it.
        neighbours: Distinct growth vectors at random points around q (fixed seed). The point is
            regular if its own growth vector is the only one.
    """

    system: str
    q: tuple[float, ...]
    size: int
    growth: tuple[int, ...]
    degree: int | None
    basis: tuple[str, ...]
    singular_values: tuple[float, ...]
    tolerance: float
    involutive: bool
    chow: bool
    neighbours: tuple[tuple[int, ...], ...]

    @property
    def depth(self) -> int:
        """Greatest length of the brackets examined."""
        return len(self.growth)

    @property
    def regular(self) -> bool:
        """Whether the growth vector is the same at q and at all random points around q."""
        return self.neighbours == (self.growth,)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as a dictionary that JSON can store."""
        return {
            "system": self.system,
            "q": list(self.q),
            "growth_vector": list(self.growth),
            "degree_of_nonholonomy": self.degree,
            "depth": self.depth,
            "basis": list(self.basis),
            "singular_values": list(self.singular_values),
            "rank_tolerance": self.tolerance,
            "frobenius_involutive": self.involutive,
            "chow_controllable": self.chow,
            "regular": self.regular,
            "growth_vectors_around": [list(g) for g in self.neighbours],
        }

    def __str__(self) -> str:
        values = ", ".join(f"{s:.4g}" for s in self.singular_values)
        text = " and ".join(_vector(g) for g in self.neighbours)
        lines = [
            f"growth vector {_vector(self.growth)}, N = {self.size}, "
            + ("regular point" if self.regular else f"singular point (around it: {text})"),
            "degree of nonholonomy "
            + (f"{self.degree}" if self.degree else f"above {self.depth}, the depth examined"),
            f"spanned by {', '.join(self.basis)}",
            f"singular values {values} (rank counts those above {self.tolerance:g} of the largest)",
            "Frobenius: span{g1, g2} is "
            + (
                "involutive as far as sampled, so integrable: the constraints are holonomic"
                if self.involutive
                else "not involutive, so not integrable: the constraints are nonholonomic"
            ),
            "Chow: brackets up to length "
            + (
                f"{self.degree} span all {self.size} directions: locally controllable here"
                if self.chow
                else f"{self.depth} span {self.growth[-1]} of {self.size} directions:"
                " controllability is not shown to this depth"
            ),
        ]
        return "\n".join(lines)


def controllability(
    system: TriangularSystem,
    q: ArrayLike,
    depth: int | None = None,
    *,
    tolerance: float = RANK_TOLERANCE,
) -> Controllability:
    """Examine the brackets of g₁ and g₂ (q̇ = g₁u₁ + g₂u₂) at one configuration.

    Args:
        system: Any system.
        q: Configuration, shape (N,), in the coordinates' units.
        depth: Greatest bracket length. By default increased until the rank is full, up to 2N − 3
            (which the paper's manipulator needs with every θᵢ = 0).
        tolerance: A singular value counts towards the rank if it exceeds this share of the largest.

    Returns:
        The result; its `str()` is a short report.

    Raises:
        InputError: If q does not fit the system, the depth is not positive, or the kinematics are
            infinite at q.
    """
    expect_system(system)
    point = _check_arguments(system, q, depth)
    family, limit = brackets(system), depth or max(2, 2 * system.size - 3)
    if not np.all(np.abs(family.values(point, 1)) < _LARGEST_VALUE):
        raise InputError(
            f"the kinematics of the {system.kind} are infinite at q = {point.tolist()}"
        )
    blocks: list[Array] = []
    names: list[str] = []
    for length in range(1, limit + 1):
        blocks.append(family.values(point, length))
        names += family.names(length)
        if depth is None and _rank(blocks, tolerance) == system.size:
            break
    growth, span = _growth(blocks, tolerance), (_NEIGHBOUR_POINTS, len(point))
    away = np.random.default_rng(0).uniform(-_NEIGHBOUR_RADIUS, _NEIGHBOUR_RADIUS, span)
    points = list(point + away)
    reached = [k for k, rank in enumerate(growth, start=1) if rank == system.size]
    nearby = (_growth(_blocks(family, p, len(growth)), tolerance) for p in points)
    return Controllability(
        system=system.kind,
        q=tuple(point.tolist()),
        size=system.size,
        growth=growth,
        degree=reached[0] if reached else None,
        basis=_basis(blocks, names, growth),
        singular_values=tuple(_singular_values(blocks).tolist()),
        tolerance=tolerance,
        involutive=all(_growth(_blocks(family, p, 2), tolerance)[1] == 2 for p in [point, *points]),
        chow=bool(reached),
        neighbours=tuple(dict.fromkeys(nearby)),
    )


def _check_arguments(system: TriangularSystem, q: ArrayLike, depth: int | None) -> Array:
    point = floats("q", q)
    if point.shape != (system.size,) or not np.all(np.isfinite(point)):
        raise InputError(
            f"q = {point.tolist()}: the {system.kind} needs {system.size} finite numbers"
            f" ({', '.join(c.name for c in system.coordinates)})"
        )
    if depth is not None and depth < 1:
        raise InputError(f"depth = {depth}: a bracket has a length of at least 1")
    return point


def _singular_values(blocks: Sequence[Array]) -> Array:
    return np.asarray(np.linalg.svd(np.concatenate(blocks), compute_uv=False))


def _rank(blocks: Sequence[Array], tolerance: float) -> int:
    values = _singular_values(blocks)
    return int(np.sum(values > tolerance * values[0]))


def _basis(blocks: Sequence[Array], names: Sequence[str], growth: Sequence[int]) -> tuple[str, ...]:
    """Return the names of independent brackets, shortest first.

    From each length, choose as many brackets as the length adds to the growth vector; each time,
    choose the bracket with the largest component orthogonal to the brackets chosen before.
    """
    chosen: list[int] = []
    left, position = [block.copy() for block in blocks], 0
    for k, gain in enumerate(np.diff([0, *growth])):
        for _ in range(gain):
            best = int(np.argmax(np.linalg.norm(left[k], axis=1)))
            unit = left[k][best] / np.linalg.norm(left[k][best])
            left = [rest - np.outer(rest @ unit, unit) for rest in left]
            chosen.append(position + best)
        position += len(blocks[k])
    return tuple(names[k] for k in sorted(chosen))


def _blocks(family: Brackets, q: Array, depth: int) -> list[Array]:
    return [family.values(q, length) for length in range(1, depth + 1)]


def _growth(blocks: Sequence[Array], tolerance: float) -> tuple[int, ...]:
    return tuple(_rank(blocks[: k + 1], tolerance) for k in range(len(blocks)))


def _vector(growth: Sequence[int]) -> str:
    return f"({', '.join(map(str, growth))})"


Word = tuple[int, ...]


def lie_bracket(f: Any, g: Any, q: Any) -> Any:
    """Return the Lie bracket [f, g] = (∂g/∂q) f − (∂f/∂q) g of two vector fields in q."""
    return ca.cse(ca.jtimes(g, q, f) - ca.jtimes(f, q, g))


def lyndon_words(length: int) -> list[Word]:
    """Return the Lyndon words of a length over {1, 2}, in order, by Duval's algorithm."""
    words, word = [], [0]
    while word:
        word[-1] += 1
        if len(word) == length:
            words.append(tuple(word))
        period = len(word)
        while len(word) < length:
            word.append(word[-period])
        while word and word[-1] == 2:
            word.pop()
    return words


def split(word: Word) -> tuple[Word, Word]:
    """Split a Lyndon word in two; the second part is its longest proper Lyndon suffix."""
    for k in range(1, len(word)):
        suffix = word[k:]
        if all(suffix < suffix[j:] for j in range(1, len(suffix))):
            return word[:k], suffix
    raise ValueError(f"{word} is a letter")


def bracket_name(word: Word) -> str:
    """Return the bracket that belongs to a Lyndon word as text: (1, 1, 2) is "[g1,[g1,g2]]"."""
    if len(word) == 1:
        return f"g{word[0]}"
    a, b = split(word)
    return f"[{bracket_name(a)},{bracket_name(b)}]"


class Brackets:
    """The Lie brackets of a system's input fields, one per Lyndon word, derived on demand."""

    def __init__(self, system: TriangularSystem) -> None:
        self._q = ca.SX.sym("q", system.size)
        self._fields: dict[Word, Any] = {
            (1,): ca.SX(ca.vertcat(*system.rates_expr(self._q, [1.0, 0.0]))),
            (2,): ca.SX(ca.vertcat(*system.rates_expr(self._q, [0.0, 1.0]))),
        }
        self._values: dict[int, tuple[list[str], Pointwise]] = {}

    def names(self, length: int) -> list[str]:
        """Return the names of the brackets of exactly the given length."""
        return self._fields_of_length(length)[0]

    def values(self, q: Array, length: int) -> Array:
        """Return the values at q (…, N) of all brackets of a given length, (…, count, N)."""
        names, function = self._fields_of_length(length)
        return function(q).reshape(*q.shape[:-1], len(names), q.shape[-1])

    def _fields_of_length(self, length: int) -> tuple[list[str], Pointwise]:
        if length not in self._values:
            words = lyndon_words(length)
            function = Pointwise("brackets", [self._q], ca.vertcat(*map(self._field, words)))
            self._values[length] = ([bracket_name(w) for w in words], function)
        return self._values[length]

    def _field(self, word: Word) -> Any:
        if word not in self._fields:
            f, g = (self._field(part) for part in split(word))
            self._fields[word] = lie_bracket(f, g, self._q)
        return self._fields[word]


@lru_cache(maxsize=16)
def brackets(system: TriangularSystem) -> Brackets:
    """Return the brackets of a system, derived once and cached."""
    return Brackets(system)
