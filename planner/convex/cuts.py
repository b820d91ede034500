"""Cutting planes at one travel: the global optimum of a class with its gap, or a certificate.

The relaxation keeps the floor and tangents of the cap at a growing list of points, so its optimum
bounds every path of the class from below. When no piece leaves the band by more than a tolerance,
all rows are tightened by twice that and the programme solved again; a path proven inside the
band bounds the optimum from above.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.convex.band import Band
from planner.convex.between import Excess, cap_excess, floor_excess
from planner.convex.frame import Frame
from planner.convex.quadratic import Farkas, Optimum, StalledError
from planner.systems.base import Array


@dataclass(frozen=True)
class Programme:
    """One objective over linear rows.

    Attributes:
        name: What is minimised.
        solve: From (frame, A, b, radius, guess) to the least over A y ≤ b, |y| ≤ radius.
        tolerance: Excess over the band (in z₂) below which cutting stops; what `solve` resolves.
    """

    name: str
    solve: Callable[[Frame, Array, Array, float, Array | None], Optimum | Farkas]
    tolerance: float


@dataclass(frozen=True)
class Touch:
    """Points that rows stand for: path fractions and, for the cap, where its tangent touches.

    Attributes:
        floor: τ of the rows p(τ) ≥ floor.
        cap: τ of the rows p(τ) ≤ tangent at `at`.
        at: z₃ of those tangents.
    """

    floor: Array
    cap: Array
    at: Array

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.floor) + len(self.cap)

    def only(self, keep: NDArray[np.bool_]) -> Touch:
        """Those whose row has `keep` True; rows are floor first, then cap."""
        split = len(self.floor)
        return Touch(self.floor[keep[:split]], self.cap[keep[split:]], self.at[keep[split:]])

    def plus(self, other: Touch) -> Touch:
        """Both lists."""
        return Touch(
            np.concatenate([self.floor, other.floor]),
            np.concatenate([self.cap, other.cap]),
            np.concatenate([self.at, other.at]),
        )


NO_TOUCH = Touch(np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class Best:
    """The optimum of a class at one travel, from below and above.

    Attributes:
        frame: The class.
        y: The path, proven inside the band.
        bound: What no path of the class can be below, as the programme measures it.
        touch: The points of the rows beside the nodes' that the path leans on.
        final: The last programme's answer, with its engine.
        rounds: Programmes solved.
        proven: Greatest possible excess over the band between the nodes; ≤ 0.
    """

    frame: Frame
    y: Array
    bound: float
    touch: Touch
    final: Optimum
    rounds: int
    proven: float

    @property
    def value(self) -> float:
        """Objective of the path, as the programme measures it."""
        return self.final.value

    @property
    def gap(self) -> float:
        """(value − bound) / |value|."""
        return (self.value - self.bound) / max(abs(self.value), 1e-300)


@dataclass(frozen=True)
class Above:
    """The optimum was not sought further, since it cannot be below `bound`."""

    bound: float


@dataclass(frozen=True)
class Impossible:
    """A certificate that a class holds no path inside the band.

    Attributes:
        frame: The class.
        A: Rows of unit length in the free coefficients, shape (m, size).
        b: Right-hand sides, shape (m,).
        proof: The multipliers and what they show.
        rounds: Programmes solved.
    """

    frame: Frame
    A: Array = field(repr=False)
    b: Array = field(repr=False)
    proof: Farkas = field(repr=False)
    rounds: int


def band_rows(frame: Frame, band: Band, touch: Touch) -> tuple[Array, Array]:
    """A y ≤ b for the points given, floor rows first."""
    floor = _floor(band, *frame.z_rows(1, touch.floor))
    cap = _cap(band, touch.at, frame.z_rows(1, touch.cap), frame.z_rows(2, touch.cap))
    return np.concatenate([floor[0], cap[0]]), np.concatenate([floor[1], cap[1]])


def node_band_rows(frame: Frame, band: Band) -> tuple[Array, Array]:
    """Floor and cap at every inner node, the tangents along a straight z₃."""
    at = frame.start[2] + (frame.goal[2] - frame.start[2]) * frame.shape.breaks[1:-1]
    z2 = frame.z_rows_at_nodes(1)
    floor, cap = _floor(band, *z2), _cap(band, at, z2, frame.z_rows_at_nodes(2))
    return np.concatenate([floor[0], cap[0]]), np.concatenate([floor[1], cap[1]])


def _floor(band: Band, rows: Array, at: Array) -> tuple[Array, Array]:
    return -band.sign * rows, band.sign * at - band.floor


def _cap(
    band: Band, at: Array, z2: tuple[Array, Array], z3: tuple[Array, Array]
) -> tuple[Array, Array]:
    slope, offset = band.tangent(at)
    rows = band.sign * z2[0] - slope[:, None] * z3[0]
    return rows, offset + slope * z3[1] - band.sign * z2[1]


class _Rows:
    """The growing list of rows of one relaxation; the nodes' come first."""

    def __init__(self, frame: Frame, band: Band, extra: Touch | None) -> None:
        self.frame, self.band = frame, band
        self.A, self.b = node_band_rows(frame, band)
        self.nodes = len(self.b)
        self.blocks: list[Touch] = []
        if extra is not None:
            self.add(extra)

    def add(self, touch: Touch) -> None:
        A, b = band_rows(self.frame, self.band, touch)
        self.blocks.append(touch)
        self.A, self.b = np.concatenate([self.A, A]), np.concatenate([self.b, b])

    def active(self, multipliers: Array) -> Touch:
        """Points of the added rows that the solution leans on."""
        at, kept = self.nodes, NO_TOUCH
        for block in self.blocks:
            kept = kept.plus(block.only(multipliers[at : at + block.rows] > 0))
            at += block.rows
        return kept


def cut(
    frame: Frame,
    band: Band,
    programme: Programme,
    extra: Touch | None = None,
    max_rounds: int = 100,
    ceiling: float = np.inf,
) -> Best | Impossible | Above:
    """Solve one class at one travel.

    Args:
        frame: The class and its ends.
        band: The convex domain.
        programme: The objective, see `Programme`.
        extra: Points for rows beside the nodes'; any will do, those of a neighbour help.
        max_rounds: Programmes allowed.
        ceiling: Stop as soon as the bound exceeds this.

    Raises:
        StalledError: If the rounds run out, or the last of the feasible is too thin to be proven.
    """
    rows, radius = _Rows(frame, band, extra), radius_of(frame, band)
    relaxed, tighten, guess = None, 0.0, None
    for round_ in range(1, max_rounds + 1):
        answer = programme.solve(frame, rows.A, rows.b - tighten, radius, guess)
        if isinstance(answer, Farkas):
            if relaxed is not None:
                raise StalledError("feasible only within the tolerance of the cuts")
            return _impossible(rows, answer, round_)
        if relaxed is None and answer.bound > ceiling:
            return Above(answer.bound)
        guess = answer.y
        low, high = _excess(frame, band, guess, programme.tolerance, relaxed is not None)
        proven = max(low.proven, high.proven)
        if len(low.piece) + len(high.piece) == 0:
            relaxed = relaxed or answer
            tighten = 2 * max(tighten, programme.tolerance)
        if relaxed is not None and proven <= 0:
            active = rows.active(answer.multipliers)
            return Best(frame, guess, relaxed.bound, active, answer, round_, proven)
        rows.add(_touch_at(frame, guess, low, high))
    raise StalledError(f"cuts did not settle in {max_rounds} rounds")


def _impossible(rows: _Rows, proof: Farkas, rounds: int) -> Impossible:
    length = np.linalg.norm(rows.A, axis=1)
    return Impossible(rows.frame, rows.A / length[:, None], rows.b / length, proof, rounds)


def radius_of(frame: Frame, band: Band) -> float:
    """A bound on |y| of every path inside the band: 0 ≤ p ≤ top and Markov's inequality."""
    degree = frame.shape.degree + 1
    return float(degree**2 * frame.shape.pieces * band.top)


def _excess(
    frame: Frame, band: Band, y: Array, tolerance: float, proof: bool
) -> tuple[Excess, Excess]:
    _, z2, z3, *_ = frame.bernstein(y)
    return floor_excess(band, z2, tolerance, proof), cap_excess(band, z2, z3, tolerance, proof)


def _touch_at(frame: Frame, y: Array, low: Excess, high: Excess) -> Touch:
    pieces = frame.shape.pieces
    floor = (low.piece + low.local) / pieces
    cap = (high.piece + high.local) / pieces
    rows, at = frame.z_rows(2, cap)
    return Touch(floor, cap, rows @ y + at)
