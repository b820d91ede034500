"""Lie brackets of a system's two input fields, symbolically, one bracket a Lyndon word.

The brackets of the Lyndon words of length ≤ k over {g₁, g₂} span every bracket of that length
(C. Reutenauer, Free Lie Algebras, 1993, ch. 5): 2, 3, 5, 8, 14, 23, 41 … of them for k = 1, 2, 3 ….
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from planner.systems.base import Array, TriangularSystem
from planner.systems.pointwise import Pointwise

Word = tuple[int, ...]


def lie_bracket(f: Any, g: Any, q: Any) -> Any:
    """[f, g] = (∂g/∂q) f − (∂f/∂q) g of two columns in the CasADi vector q."""
    return ca.cse(ca.jtimes(g, q, f) - ca.jtimes(f, q, g))


def lyndon_words(length: int) -> list[Word]:
    """The Lyndon words of that length over {1, 2}, in order (Duval's algorithm)."""
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
    """The standard factorisation: the second factor is the longest proper Lyndon suffix."""
    for k in range(1, len(word)):
        suffix = word[k:]
        if all(suffix < suffix[j:] for j in range(1, len(suffix))):
            return word[:k], suffix
    raise ValueError(f"{word} is a letter")


def bracket_name(word: Word) -> str:
    """As people write it: (1, 1, 2) is "[g1,[g1,g2]]"."""
    if len(word) == 1:
        return f"g{word[0]}"
    a, b = split(word)
    return f"[{bracket_name(a)},{bracket_name(b)}]"


class Brackets:
    """All brackets of a system up to any length, derived when first asked for."""

    def __init__(self, system: TriangularSystem) -> None:
        self._q = ca.SX.sym("q", system.size)
        self._fields: dict[Word, Any] = {
            (1,): ca.SX(ca.vertcat(*system.rates_expr(self._q, [1.0, 0.0]))),
            (2,): ca.SX(ca.vertcat(*system.rates_expr(self._q, [0.0, 1.0]))),
        }
        self._values: dict[int, tuple[list[str], Pointwise]] = {}

    def names(self, length: int) -> list[str]:
        """Names of the brackets of exactly that length."""
        return self._of_length(length)[0]

    def values(self, q: Array, length: int) -> Array:
        """The brackets of exactly that length at q (…, N), shape (…, count, N)."""
        names, function = self._of_length(length)
        return function(q).reshape(*q.shape[:-1], len(names), q.shape[-1])

    def _of_length(self, length: int) -> tuple[list[str], Pointwise]:
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
    """The brackets of a system, derived once and kept."""
    return Brackets(system)
