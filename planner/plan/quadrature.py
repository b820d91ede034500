"""Functions of time as Chebyshev series on cells, and integration of the motion under an input.

A function is stored by its values at the Chebyshev–Lobatto points of every cell, shape (P, C, …):
points first, so that one small matrix acts on all cells at once. No planning method uses these
points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.plan.curves import Cells, join_cells
from planner.plan.trajectory import Trajectory
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Pieces
from planner.support.calculus.chebyshev import (
    apply,
    from_series,
    integration,
    points,
    resampling,
    series_slopes,
    to_series,
)
from planner.systems.triangular_system import TriangularSystem

POINTS = 16
"""Number of points per cell; rates up to degree 15 are integrated exactly."""

CONTROL_POINTS = 29
"""Number of points per cell at which the input is read and integrated again as a check (control
points). Only the ends coincide with the first 16. Curves of higher degree get degree + 1 points."""

INPUT_TOLERANCE = 1e-7
"""Difference between input and series at the control points, as a share of the input's greatest
value, above which a cell is split: a tenth of `JUMP_TOLERANCE` and of the tolerance of limits."""

LESSER_INPUT_SHARE = 0.01
"""Least scale of an input's error, as a share of the larger input: rounding in the chart's inverse
is about 1e-9 of the larger input."""

SAMPLES = 33
"""Number of samples per cell for extremes: twice the extremes of a series of degree 15."""

CLOSE_SAMPLES = 129
"""Number of samples of a cell that may contain the greatest value. From a maximum to the nearest
sample the argument of the fastest term, cos 15θ, changes by at most a fifth of a radian, so
Newton's method converges."""

NEWTON_STEPS = 3
"""Number of Newton steps from a sample to a maximum; two leave an error of 1e-9 rad."""

EXTREME_TOLERANCE = 1e-12
"""Possible gain over the best value, as a share of the function's size, up to which a maximum is
not searched for."""

TAIL_TOLERANCE = 1e-11
"""Largest tail (last coefficients of a series) of a cell that is fine enough, as a share of the
function's size there, or of one if that is larger."""

NOISE_TAIL = 1e-8
"""Largest tail that counts as rounding of the input if splitting does not reduce the tail."""

MOST_SPLITS = 20
"""Largest number of successive splits into four. The smallest cell is 1e-12 of its piece, in which
floats still distinguish 4,000 times."""

MOST_CELLS = 4000
"""Largest number of cells added to the pieces. A singular start needs 100; a noisy input would be
split without end."""

MOST_ROUNDS = 4
"""Largest number of integrations. Each after the first splits all cells in four, so the cells of
the last are a 64th of the first."""

SWEEP_TOLERANCE = 1e-14
"""Change of q at which fixed-point sweeps end, as a share of q's size, or of one if that is larger:
a few rounding units."""

LOST = 1.0
"""Change of q in a sweep, rad or m, above which sweeps that do not converge have lost the motion:
those without correction do where q grows or shrinks by a large factor."""

MOST_SWEEPS = 60
"""Largest number of sweeps with Newton's correction. If each rate reads only earlier coordinates, N
+ 1 sweeps without correction suffice."""

JUMP_TOLERANCE = 1e-6
"""Step between two cells, relative to the function's size, above which it is a jump. Inputs near
the edge of the chart and retimed inputs have errors of about 1e-7, which depend on the processor;
an input may also exceed its limit by 1e-6."""

Values = Callable[[Array, Array], Array]
"""Functions of q (P, C, N) and u (P, C, 2) to values (P, C, F) that the cells must resolve."""


@dataclass(frozen=True, eq=False)
class Reading:
    """A trajectory's q (16, C, N) and u (16, C, 2) at the points of the cells."""

    cells: Cells
    q: Array
    u: Array


def read_trajectory(trajectory: Trajectory, *values: Values, start: Cells | None = None) -> Reading:
    """Return q and u on cells that are split until they resolve the given functions.

    A cell on which a function is not finite is not split further.

    Args:
        trajectory: The trajectory to read.
        *values: Functions to resolve; by default the input.
        start: Cells to begin with; by default the trajectory's pieces.
    """
    functions = values or (input_values,)
    open_ = Cells.of(trajectory.breaks) if start is None else start
    before = np.full(len(open_.piece), np.inf)
    readings: list[Reading] = []
    kept_cells, most = 0, MOST_CELLS + len(open_.piece)
    for step in range(MOST_SPLITS + 1):
        deadline.check_stopped()
        q, u = trajectory.piece_values(open_.piece, open_.fractions(points(POINTS)))
        tail = tails(np.concatenate([f(q, u) for f in functions], axis=-1))
        rough = (tail > TAIL_TOLERANCE) & ((tail > NOISE_TAIL) | (tail < 0.2 * before))
        kept_cells += int(np.sum(~rough))
        if step == MOST_SPLITS or not np.any(rough) or kept_cells + 4 * np.sum(rough) > most:
            readings.append(Reading(open_, q, u))
            break
        readings.append(Reading(open_.select(~rough), q[:, ~rough], u[:, ~rough]))
        before = np.repeat(tail[rough], 4)
        open_ = open_.select(rough).split()[0]
    if len(readings) == 1:
        return readings[0]
    cells = join_cells([k.cells for k in readings])
    order = np.lexsort((cells.low, cells.piece))
    q, u = (np.concatenate([getattr(k, name) for k in readings], axis=1)[:, order] for name in "qu")
    return Reading(cells.select(order), q, u)


def input_values(_: Array, u: Array) -> Array:
    """Return the input, as a function to resolve."""
    return u


def tails(values: Array) -> Array:
    """Return each cell's tail for functions (16, C, F), shape (C,); NaN where not finite.

    The tail is the largest of the functions' last three Chebyshev coefficients, relative to the
    function's greatest value in the cell, or to one if that is larger.
    """
    last = apply(to_series(POINTS)[-3:], values)
    with np.errstate(invalid="ignore"):
        share = np.max(np.abs(last), axis=0) / np.maximum(np.max(np.abs(values), axis=0), 1.0)
    return np.asarray(np.max(share, axis=-1))


@dataclass(frozen=True, eq=False)
class IntegratedMotion:
    """The motion q(t) under an input, by integration of the system's rates.

    Attributes:
        cells: The cells on which the motion is stored.
        q: Coordinates, shape (16, C, N).
        u: Inputs, shape (16, C, 2).
        error: Estimate of the largest error of q, in the coordinates' units; NaN where the input or
            the rates are not finite.
        gap: Largest |q of the trajectory − q| over the 16 points and the control points, and its
            time.
        unresolved_input: Largest difference between the input and its series at the control points,
            relative to the input's greatest value, and its time. Above `INPUT_TOLERANCE` only if
            splitting cells did not help.
        unresolved_values: The same for further functions, relative to the greatest value or one.
    """

    cells: Cells
    q: Array
    u: Array
    error: float
    gap: tuple[float, float]
    unresolved_input: tuple[float, float] = (0.0, 0.0)
    unresolved_values: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def series(self) -> Array:
        """Chebyshev coefficients of q, shape (16, C, N)."""
        return apply(to_series(POINTS), self.q)

    def samples(self) -> tuple[Array, Array]:
        """Return x (33,) in [−1, 1], and q (33, C, N) at these points of every cell."""
        return 2 * points(SAMPLES) - 1, apply(resampling(POINTS, SAMPLES), self.q)

    def q_in_cells(self, cell: Pieces, x: Array) -> Array:
        """Return q (…, R, N) at x (…, R) in [−1, 1] of the cells with indices (R,)."""
        return _values_in_cells(self.series[:, cell], x)

    def input_distance(self, other: IntegratedMotion) -> float:
        """Return the largest difference between another motion's input and this motion's series.

        The difference is relative to the input's greatest value.

        Args:
            other: The same trajectory, read on other cells; compared inside these cells.
        """
        cells, share = self.cells, other.cells.fractions(points(POINTS)[1:-1])
        # Number the pieces in steps of two, so that no piece ends where the next begins.
        begins, places = 2 * cells.piece + cells.low, 2 * other.cells.piece + share
        cell = np.searchsorted(begins, places, side="right") - 1
        x = np.clip(2 * (share - cells.low[cell]) / cells.size[cell] - 1, -1.0, 1.0)
        series = apply(to_series(POINTS), self.u)[:, cell.ravel()]
        u = _values_in_cells(series, x.ravel()).reshape(*x.shape, 2)
        return float(np.max(_share_of_peak(np.abs(other.u[1:-1] - u), self.u)))

    def q_at_time(self, t: float) -> Array:
        """Return the coordinates (N,) at the time t, s."""
        begins = self.cells.time(np.arange(len(self.cells.piece)), np.array(-1.0))
        cell = np.maximum(np.searchsorted(begins, [t], side="right") - 1, 0)
        x = np.clip(2 * (t - begins[cell]) / self.cells.width[cell] - 1, -1.0, 1.0)
        return np.asarray(self.q_in_cells(cell, x)[0])


def _values_in_cells(series: Array, x: Array) -> Array:
    """Return the values (…, R, N) at x (…, R) in [−1, 1] of series (16, R, N)."""
    basis = np.cos(np.arange(POINTS) * np.arccos(x)[..., None])
    return np.asarray(np.einsum("...rk,krn->...rn", basis, series))


def _share_of_peak(distances: Array, u: Array) -> Array:
    """Return the larger of both inputs' distances (…, 2), each relative to the peak of that input
    in u (16, C, 2)."""
    peaks = np.max(np.abs(u), axis=(0, 1))
    least = max(LESSER_INPUT_SHARE * np.max(peaks), 1e-12)
    return np.asarray(np.max(distances / np.maximum(peaks, least), axis=-1))


def integrate(
    trajectory: Trajectory,
    start: Array,
    tolerance: float = 1e-7,
    *values: Values,
    system: TriangularSystem | None = None,
    cells: Cells | None = None,
) -> IntegratedMotion:
    """Return the motion from `start` (N,) under a trajectory's input, by integration.

    Args:
        trajectory: Trajectory whose u(t) is integrated and whose q(t) is only a first guess.
        start: q(0).
        tolerance: If the estimated error is larger, all cells are split and the motion integrated
            again.
        *values: Further functions that the cells must resolve; their values should be about one.
        system: The system whose rates are integrated; by default the trajectory's own.
        cells: Cells that resolve the motion; they are split further only for the input and the
            values. By default the trajectory's pieces are split as needed.
    """
    system = system or trajectory.system
    for _ in range(MOST_ROUNDS if cells is None else 1):
        reading, (q_there, u_there), unresolved = _read_and_control(
            trajectory, system, values, cells
        )
        width, known = reading.cells.width[:, None], np.isfinite(reading.q)
        q = _fixed_point(system, start, width, np.where(known, reading.q, start), reading.u)
        rates = system.rates(q, reading.u)
        tail = np.sum(width * np.max(np.abs(apply(to_series(POINTS)[-3:], rates)), axis=0), axis=0)
        # the same integral at other points, using the interpolated motion
        between = again = apply(resampling(POINTS, len(q_there)), q)
        for _ in range(2):  # twice, so that an error spreads to coordinates whose rates read it
            again = _integral(start, width, system.rates(again, u_there))
        error = float(np.max(np.abs(again - between)) + np.max(tail))
        gaps = [np.max(np.abs(a - b), axis=-1) for a, b in ((reading.q, q), (q_there, between))]
        gap = _worst(reading.cells, gaps[int(np.argmax([np.max(g) for g in gaps]))])
        motion = IntegratedMotion(reading.cells, q, reading.u, error, gap, *unresolved)
        if not motion.error > tolerance or len(reading.cells.piece) > MOST_CELLS:
            break  # accurate, not finite, or noise: splitting would not help
        cells = reading.cells.split()[0]
    return motion


def _read_and_control(
    trajectory: Trajectory, system: TriangularSystem, values: Sequence[Values], start: Cells | None
) -> tuple[Reading, tuple[Array, Array], tuple[tuple[float, float], tuple[float, float]]]:
    """Return q and u on cells that resolve input and values at the control points too; q (P, C, N)
    and u (P, C, 2) there; and `unresolved_input` and `unresolved_values` of `IntegratedMotion`.

    Cells on which the input or the values differ from their series at these points are split.
    """
    count = max(CONTROL_POINTS, trajectory.degree + 1)
    for _ in range(MOST_ROUNDS):
        reading = read_trajectory(trajectory, input_values, system.rates, *values, start=start)
        cells, hidden = reading.cells, np.zeros((count, len(reading.cells.piece)))
        q, u = trajectory.piece_values(cells.piece, cells.fractions(points(count)))
        between = apply(resampling(POINTS, count), reading.u)
        distances = _share_of_peak(np.abs(u - between), reading.u)
        for function in values:
            read_values, between = function(reading.q, reading.u), function(q, u)
            gap = np.abs(between - apply(resampling(POINTS, count), read_values))
            share = np.max(gap / np.maximum(np.max(np.abs(read_values)), 1.0), axis=-1)
            hidden = np.maximum(hidden, share)
        rough = np.max(np.maximum(distances, hidden), axis=0) > INPUT_TOLERANCE
        split = rough & (cells.size > 0.25**MOST_SPLITS)
        if not np.any(split) or len(cells.piece) > MOST_CELLS:
            break
        start = cells.split(np.where(split, 4, 1))[0]
    return reading, (q, u), (_worst(cells, distances), _worst(cells, hidden))


def _worst(cells: Cells, distances: Array) -> tuple[float, float]:
    """Return the largest of differences (P, C) at Chebyshev–Lobatto points, and its time."""
    point, cell = np.unravel_index(np.argmax(distances), distances.shape)
    when = cells.time(np.array(cell), 2 * points(len(distances))[point] - 1)
    return float(distances[point, cell]), float(when)


def _integral(start: Array, width: Array, rates: Array) -> Array:
    parts = apply(integration(len(rates)), rates) * width
    ends = np.cumsum(parts[-1], axis=0)
    parts[:, 1:] += ends[:-1]
    return np.asarray(parts + start)


def _fixed_point(system: TriangularSystem, start: Array, width: Array, q: Array, u: Array) -> Array:
    """Return the solution q (16, C, N) of q = start + ∫ rates(q, u), by fixed-point iteration.

    The sweeps converge if rates read only earlier coordinates. If a rate reads its own or a later
    coordinate, Newton's method then corrects q at the start of each cell.
    """
    guess, change = q, np.inf
    for _ in range(system.size + 1):
        deadline.check_stopped()
        new = _integral(start, width, system.rates(q, u))
        change, q = float(np.max(np.abs(new - q))), new
        if not change > SWEEP_TOLERANCE * max(1.0, float(np.max(np.abs(q)))):
            return q
    q, change = q if change < LOST else guess, np.inf
    growth = apply(integration(POINTS), _jacobian(system, q, u)) * width[..., None]
    transition = growth[-1] + np.eye(system.size)
    for _ in range(MOST_SWEEPS):
        deadline.check_stopped()
        integrals = apply(integration(POINTS), system.rates(q, u)) * width
        miss = q[0] + integrals[-1]
        miss[:-1] -= q[0, 1:]
        shift = np.zeros_like(miss)
        shift[0] = start - q[0, 0]
        for c in range(1, len(shift)):
            shift[c] = miss[c - 1] + transition[c - 1] @ shift[c - 1]
        new = q[0] + integrals + shift + (growth @ shift[..., None])[..., 0]
        before, change, q = change, float(np.max(np.abs(new - q))), new
        small = SWEEP_TOLERANCE * max(1.0, float(np.max(np.abs(q))))
        if not change > small or change > max(LOST, before):
            return q
    return q


def _jacobian(system: TriangularSystem, q: Array, u: Array) -> Array:
    """Return ∂(rates)/∂q by central differences, flattened to shape (16, C, N, N)."""
    step = 1e-6
    nudged = q[..., None, :] + step * np.eye(system.size)
    back = q[..., None, :] - step * np.eye(system.size)
    u = np.broadcast_to(u[..., None, :], (*nudged.shape[:-1], 2))
    columns = (system.rates(nudged, u) - system.rates(back, u)) / (2 * step)
    return np.asarray(np.swapaxes(columns, -1, -2))


def growth(trajectory: Trajectory) -> tuple[float, float]:
    """Return the logarithms of the factors by which a volume of states grows along a motion: from
    start to goal, and from the worst place to the goal.

    They are integrals of the trace of ∂q̇/∂q (Liouville's formula), which is zero for arms, cars
    and other systems whose rates read only earlier coordinates, negative where trailers are pulled,
    and positive where they are backed. NaN if inputs or rates are not finite.
    """
    cells = Cells.of(trajectory.breaks)
    q, u = trajectory.piece_values(cells.piece, cells.fractions(points(POINTS)))
    trace = np.trace(_jacobian(trajectory.system, q, u), axis1=-2, axis2=-1)
    grown = np.append(0.0, np.cumsum(apply(integration(POINTS)[-1:], trace)[0] * cells.width))
    return float(grown[-1]), float(grown[-1] - np.min(grown))


def greatest(cells: Cells, values: Array) -> tuple[Array, Array]:
    """Return the greatest value of functions (16, C, F) over all cells, and its time, both (F,).

    In the angle θ with x = cos θ a series is a sum of cosines with |d²/dθ²| ≤ Σ k²|cₖ|. So a
    maximum exceeds the nearest sample by at most this bound times the squared sample distance over
    eight. Cells that may exceed all samples are sampled more densely. From each dense sample that
    may be next to the greatest value, Newton's method finds the maximum. The result is NaN where a
    function is not finite.
    """
    series, samples = apply(to_series(POINTS), values), apply(resampling(POINTS, SAMPLES), values)
    order = np.arange(POINTS)[:, None]
    bend = apply(np.asarray(order.T**2.0), np.abs(series))[0]
    tops, best = np.max(samples, axis=0), np.max(samples, axis=(0, 1))
    with np.errstate(invalid="ignore"):
        enough = best + EXTREME_TOLERANCE * np.max(np.abs(values), axis=(0, 1))
        may = tops + bend * _hidden_height(SAMPLES) > enough
        may[np.argmax(tops, axis=0), np.arange(len(best))] = True  # at least one per function
        cell, which = np.nonzero(may)
        series = series[:, cell, which]
        closer = from_series(POINTS, CLOSE_SAMPLES) @ series
        np.maximum.at(enough, which, np.max(closer, axis=0))
        may = closer + bend[cell, which] * _hidden_height(CLOSE_SAMPLES) > enough[which]
        may[np.argmax(closer, axis=0), np.arange(len(cell))] = True
    sample, row = np.nonzero(may)
    series, theta = series[:, row], np.pi * (1 - sample / (CLOSE_SAMPLES - 1))
    steep, bent = order * series, order**2 * series
    for _ in range(NEWTON_STEPS):
        slope = -np.sum(steep * np.sin(order * theta), axis=0)
        curve = -np.sum(bent * np.cos(order * theta), axis=0)
        step = np.divide(-slope, curve, out=np.zeros_like(theta), where=curve < 0)
        theta = theta + np.clip(step, -np.pi / CLOSE_SAMPLES, np.pi / CLOSE_SAMPLES)
    reached = np.sum(series * np.cos(order * theta), axis=0)
    last = np.lexsort((reached, which[row]))[np.cumsum(np.bincount(which[row])) - 1]
    value = np.where(np.isnan(best), np.nan, reached[last])
    return value, cells.time(cell[row[last]], np.cos(theta[last]))


def largest(cells: Cells, values: Array) -> Array:
    """Return the greatest absolute value of functions (16, C, F) over all cells, (F,)."""
    value, _ = greatest(cells, np.concatenate([values, -values], axis=-1))
    return np.asarray(np.max(value.reshape(2, -1), axis=0))


def jumps(values: Array) -> NDArray[np.bool_]:
    """Return whether functions (16, C, F) jump between cells, by over `JUMP_TOLERANCE` of their
    size."""
    size = np.maximum(np.max(np.abs(values), axis=(0, 1)), 1e-12)
    gaps = np.abs(values[0, 1:] - values[-1, :-1])
    return np.asarray(np.any(gaps > JUMP_TOLERANCE * size, axis=0))


def slopes(cells: Cells, values: Array) -> Array:
    """Return the time derivatives of functions (16, C, F) at the same points.

    Differentiation multiplies a coefficient by up to 15² and divides it by the cell's width, so
    rounding in the last coefficients would dominate the slope in a short cell. Trailing
    coefficients below ten times the largest of the last three are therefore dropped.
    """
    series = apply(to_series(POINTS), values)
    size = np.abs(series)
    above = size > 10 * np.max(size[-3:], axis=0)
    shape = np.logical_or.accumulate(above[::-1])[::-1]
    slope = apply(series_slopes(POINTS), np.where(shape, series, 0.0))
    return np.asarray(np.where(np.isnan(values), np.nan, slope) / cells.width[:, None])


def _hidden_height(count: int) -> float:
    """Return how far f(θ) on 0 ≤ θ ≤ π may rise above `count` even samples if |f''(θ)| ≤ 1."""
    return (np.pi / (count - 1)) ** 2 / 8
