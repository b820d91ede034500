"""What a motion must keep: one class a kind, asked by whoever has to do with it.

Today the judge asks, and the lists of what is to be proven; the transcription still knows each kind
by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem


@dataclass(frozen=True, eq=False)
class At:
    """Where a requirement is asked for.

    Attributes:
        system: What moves.
        q: Coordinates, shape (…, N).
        u: Inputs, shape (…, 2).
        du: Their rates, shape (…, 2).
    """

    system: TriangularSystem
    q: Array
    u: Array
    du: Array


@dataclass(frozen=True)
class Part:
    """One line of a requirement in every message and table: a value between low and high.

    Attributes:
        label: What is limited, as in "input u2".
        unit: Unit of value and limits.
        low: Least value; may be −∞.
        high: Largest value; may be ∞.
        scale: What an excess is compared with, in the unit.
        index: The input or coordinate it is about, from 0.
    """

    label: str
    unit: str
    low: float
    high: float
    scale: float
    index: int = 0


class Requirement(ABC):
    """Something that holds at all times.

    Attributes:
        reads: What its values depend on, of "q", "u" and "du".
        shaped: Whether a value is a function of these, rather than one of them as it is.
    """

    reads: ClassVar[frozenset[str]]
    shaped: ClassVar[bool] = False

    @property
    @abstractmethod
    def parts(self) -> tuple[Part, ...]:
        """Its parts, R of them."""

    @abstractmethod
    def values(self, at: At) -> Sequence[Any]:
        """R arrays of the shape of `at.q[..., 0]`: what lies between low and high."""
