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

FAR = 1e6
"""Bound on |y|, the root mean square of dz₂/dτ, of the paths considered where z₂ has no bounds."""


@dataclass(frozen=True)
class Programme:
    """One objective over linear rows.

    Attributes:
        name: What is minimised.
        solve: From (frame, A, b, radius, guess) to the least over A y ≤ b, |y| ≤ radius.
        tolerance: Excess over the band (in z₂) below which cutting stops; what `solve` resolves.
        strict: Whether the path must be proven inside the band, or within the tolerance of it.
    """

    name: str
    solve: Callable[[Frame, Array, Array, float, Array | None], Optimum | Farkas]
    tolerance: float
    strict: bool = True


@dataclass(frozen=True)
class Touch:
    """What rows stand for: p(τ) ≥ floor, or p(τ) ≤ the cap's tangent at some z₃.

    Attributes:
        tau: Path fractions, shape (m,).
        at: z₃ where the tangent touches, shape (m,); NaN for the floor.
    """

    tau: Array
    at: Array

    def only(self, keep: NDArray[np.bool_]) -> Touch:
        """Those kept."""
        return Touch(self.tau[keep], self.at[keep])

    def plus(self, other: Touch) -> Touch:
        """These, then the others."""
        return Touch(np.append(self.tau, other.tau), np.append(self.at, other.at))


NO_TOUCH = Touch(np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class Best:
    """The optimum of a class at one travel, from below and above.

    Attributes:
        frame: The class.
        y: The path, proven inside the band.
        bound: What no path of the class can be below, as the programme measures it.
        touch: The rows beside the nodes' that the path leans on.
        A: Rows of the last programme, shape (m, size).
        b: Its right-hand sides, tightened, shape (m,).
        final: Its answer, with its engine.
        rounds: Programmes solved.
        proven: Greatest possible excess over the band between the nodes; ≤ 0.
    """

    frame: Frame
    y: Array
    bound: float
    touch: Touch
    A: Array = field(repr=False)
    b: Array = field(repr=False)
    final: Optimum = field(repr=False)
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
        touch: What each row stands for.
        A: Rows of unit length in the free coefficients, shape (m, size).
        b: Right-hand sides, shape (m,).
        proof: The multipliers and what they show.
        rounds: Programmes solved.
    """

    frame: Frame
    touch: Touch = field(repr=False)
    A: Array = field(repr=False)
    b: Array = field(repr=False)
    proof: Farkas = field(repr=False)
    rounds: int


def band_rows(frame: Frame, band: Band, touch: Touch) -> tuple[Array, Array]:
    """A y ≤ b for what is given, in its order."""
    if not band.complete:
        A, c = frame.z_rows(1, touch.tau)
        return -band.sign * A, band.sign * c - band.floor
    pairs = [frame.z_rows(i, touch.tau) for i in (1, 2)]
    return _rows(band, touch.at, *pairs)


def node_band_rows(frame: Frame, band: Band) -> tuple[Touch, Array, Array]:
    """Floor, then cap, at every inner node, the tangents along a straight z₃; where they exist."""
    nodes = frame.shape.breaks[1:-1]
    if not band.complete:
        rows = len(nodes) if np.isfinite(band.floor) else 0
        A, c = (part[:rows] for part in frame.z_rows_at_nodes(1))
        touch = Touch(nodes[:rows], np.full(rows, np.nan))
        return touch, -band.sign * A, band.sign * c - band.floor
    z3 = frame.start[2] + (frame.goal[2] - frame.start[2]) * nodes
    touch = Touch(np.tile(nodes, 2), np.concatenate([np.full(len(nodes), np.nan), z3]))
    twice = [
        (np.tile(A, (2, 1)), np.tile(c, 2))
        for A, c in (frame.z_rows_at_nodes(1), frame.z_rows_at_nodes(2))
    ]
    return touch, *_rows(band, touch.at, *twice)


def _rows(
    band: Band, at: Array, z2: tuple[Array, Array], z3: tuple[Array, Array]
) -> tuple[Array, Array]:
    floor = np.isnan(at)
    slope, offset = band.tangent(np.where(floor, z3[1], at))
    slope = np.where(floor, 0.0, slope)
    side = np.where(floor, -band.sign, band.sign)
    A = side[:, None] * z2[0] - slope[:, None] * z3[0]
    limit = np.where(floor, -band.floor, offset + slope * z3[1])
    return A, limit - side * z2[1]


class _Rows:
    """The growing list of rows of one relaxation; the nodes' come first."""

    def __init__(self, frame: Frame, band: Band, extra: Touch) -> None:
        self.frame, self.band = frame, band
        self.touch, self.A, self.b = node_band_rows(frame, band)
        self.nodes = len(self.b)
        self.add(extra)

    def add(self, touch: Touch) -> None:
        A, b = band_rows(self.frame, self.band, touch)
        self.touch = self.touch.plus(touch)
        self.A, self.b = np.concatenate([self.A, A]), np.concatenate([self.b, b])

    def active(self, multipliers: Array) -> Touch:
        """The added rows that a solution leans on."""
        return self.touch.only((multipliers > 0) & (np.arange(len(self.b)) >= self.nodes))


def cut(
    frame: Frame,
    band: Band,
    programme: Programme,
    extra: Touch = NO_TOUCH,
    max_rounds: int = 100,
    ceiling: float = np.inf,
) -> Best | Impossible | Above:
    """Solve one class at one travel.

    Args:
        frame: The class and its ends.
        band: The convex domain.
        programme: The objective, see `Programme`.
        extra: Rows beside the nodes'; any will do, those of a neighbour help.
        max_rounds: Programmes allowed.
        ceiling: Stop as soon as the bound exceeds this.

    Raises:
        StalledError: If the rounds run out, or the last of the feasible is too thin to be proven.
    """
    rows, radius = _Rows(frame, band, extra), radius_of(frame, band)
    relaxed, tighten, guess = None, 0.0, None
    for round_ in range(1, max_rounds + 1):
        b = rows.b - tighten
        answer = programme.solve(frame, rows.A, b, radius, guess)
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
        if relaxed is not None and (proven <= 0 or not programme.strict):
            touch = rows.active(answer.multipliers)
            bound = relaxed.bound
            return Best(frame, guess, bound, touch, rows.A, b, answer, round_, proven)
        rows.add(_touch_at(frame, guess, low, high))
    raise StalledError(f"cuts did not settle in {max_rounds} rounds")


def radius_of(frame: Frame, band: Band) -> float:
    """A bound on |y| of every path inside the band: 0 ≤ p ≤ top and Markov's inequality.

    Where the band has no top there is none, and paths beyond `FAR` are left out of account.
    """
    if not band.complete:
        return FAR
    degree = frame.shape.degree + 1
    return float(degree**2 * frame.shape.pieces * band.top)


def _impossible(rows: _Rows, proof: Farkas, rounds: int) -> Impossible:
    length = np.linalg.norm(rows.A, axis=1)
    A, b = rows.A / length[:, None], rows.b / length
    return Impossible(rows.frame, rows.touch, A, b, proof, rounds)


def _excess(
    frame: Frame, band: Band, y: Array, tolerance: float, proof: bool
) -> tuple[Excess, Excess]:
    _, z2, z3, *_ = frame.bernstein(y)
    low = floor_excess(band, z2, tolerance, proof)
    return low, cap_excess(band, z2, z3, tolerance, proof)


def _touch_at(frame: Frame, y: Array, low: Excess, high: Excess) -> Touch:
    pieces = frame.shape.pieces
    floor = (low.piece + low.local) / pieces
    cap = (high.piece + high.local) / pieces
    rows, at = frame.z_rows(2, cap)
    return Touch(np.append(floor, cap), np.append(np.full(len(floor), np.nan), rows @ y + at))
