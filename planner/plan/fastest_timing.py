"""The fastest timing of a path under limits on inputs and their rates: a convex program.

Let s be the length of `arc_length`, w(s) the inputs per unit of ds/dt, and b = (ds/dt)², so that
b' = 2 d²s/dt². Inputs and rates are |wᵢ| √b and |wᵢ' b + wᵢ b'/2|; the rates are linear in b, and
the time ∫ ds/√b is convex in b. So with b linear between nodes the program has one optimum
(Verscheure et al., IEEE Trans. Automatic Control 54(10), 2009, for robot arms).

A backward and a forward pass over the nodes, as toppra's, would take 0.4 of the programs' time, a
sixth of what `retime` takes. On plans of our methods it gives the same clock; on 120 random paths
it is 2e-6 slower in the median and 1e-4 at most with 400 intervals, 2e-3 at most with 50, since the
largest b at a node is not always part of the fastest clock. So the programs stay.

toppra solves the same problem, but it has wheels only for Linux on x86-64 (0.6.10) and needs a
compiler elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize_scalar

from planner.errors import InputError, NotConvergedError
from planner.plan.measures import slowing_factor
from planner.plan.quadrature import JUMP_TOLERANCE
from planner.plan.retimed import LENGTH_TOLERANCE, Inverse, Norm, RetimedTrajectory, arc_length
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory, Trajectory
from planner.problem.conditions import Limits
from planner.problem.requirements.requirement import Requirement
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.chebyshev import DEGREE, Grid

_RATE_POINTS = [0, DEGREE // 2, DEGREE]
"""Indices of the Chebyshev points of each interval at which the program limits the rates."""

_MOST_ROUNDS = 5
_LIMIT_TOLERANCE = 1e-5
"""Share by which inputs and rates may exceed their limits anywhere before the limits are tightened
there and the program is solved again. Slowing the whole motion removes the rest."""

_CORNER_TOLERANCE = JUMP_TOLERANCE / 2
"""Change of direction at a node, in units of the limits, above which the node is a corner, where
the motion stops. At smaller changes the inputs' step is too small to count as a jump."""

_STRAIGHT_TOLERANCE = 1e-6
"""Total change of direction, in units of the limits, below which a path counts as straight."""


@dataclass(frozen=True)
class PathIntervals:
    """A path that is divided into intervals of its length.

    Attributes:
        nodes: Lengths at the nodes, shape (M+1,).
        stations: Times of the original path at the nodes, shape (M+1,).
        stops: Whether the motion must stop at each node, shape (M+1,): at corners, and at both ends
            if it starts and ends at rest.
        w: Inputs per unit of ds/dt at each interval's Chebyshev points, shape (M, D, 2).
        dw: dw/ds at the same points.
    """

    nodes: Array
    stations: Array
    stops: NDArray[np.bool_]
    w: Array
    dw: Array


def cut_path(
    path: Trajectory, length: Bernstein, scale: Array, intervals: int, rest: bool
) -> PathIntervals:
    """Return a path divided into about `intervals` intervals, finer where its direction changes.

    Args:
        path: The path.
        length: Length of the path over the path's own time, from `arc_length`.
        scale: Scale of each input, shape (2,), as for `arc_length`.
        intervals: Approximate number of intervals.
        rest: Whether the motion starts and ends at rest.
    """
    edges = np.append(length.c[0], length.c[-1, -1])
    rough = _directions(path, length, Grid(edges))
    turning = np.sum(np.linalg.norm(np.diff(rough / scale, axis=1), axis=-1), axis=1)
    share = np.diff(edges) / edges[-1] + turning / max(float(np.sum(turning)), _STRAIGHT_TOLERANCE)
    counts = np.maximum(2, np.ceil(0.5 * intervals * share)).astype(int)
    corners = _stop_nodes(rough / scale, rest)
    unit = [_graded_grid(n, *ends) for n, ends in zip(counts, pairwise(corners), strict=True)]
    cuts = [a + (b - a) * x[:-1] for (a, b), x in zip(pairwise(edges), unit, strict=True)]
    nodes = np.concatenate([*cuts, edges[-1:]])
    grid = Grid(nodes)
    w = _directions(path, length, grid)
    # Inside a piece of the length the path is smooth, even where its direction changes fast.
    stops = _stop_nodes(w / scale, rest) & np.isin(nodes, edges)
    k = np.minimum(np.searchsorted(edges, nodes, side="right") - 1, len(edges) - 2)
    sigma = Inverse(length)(nodes, length.x[k], length.x[k + 1])
    edge = np.minimum(np.searchsorted(edges, nodes), len(edges) - 1)
    stations = np.where(edges[edge] == nodes, length.x[edge], sigma)  # exact at the breaks
    return PathIntervals(nodes, stations, stops, w, grid.derivative(w))


def _stop_nodes(w: Array, rest: bool) -> NDArray[np.bool_]:
    """Return whether a motion with directions w (M, D, 2) must stop at each node, shape (M+1,)."""
    jump = np.linalg.norm(w[1:, 0] - w[:-1, -1], axis=-1) > _CORNER_TOLERANCE
    return np.concatenate([[rest], jump, [rest]])


def _graded_grid(count: int, first: bool, last: bool) -> Array:
    """Return points from 0 to 1, shape (count+1,), denser near an end where the motion stops.

    Near a stop the length grows with the square of time.
    """
    x = np.linspace(0.0, 1.0, count + 1)
    if first and last:
        return np.asarray(x**2 * (3 - 2 * x))
    if first:
        return np.asarray(x**2)
    return np.asarray(1 - (1 - x) ** 2) if last else x


def fastest_clock(stretch: PathIntervals, top: Array, rate: Array) -> Bernstein:
    """Return the fastest clock s(t), piecewise quadratic.

    The program limits the rates at three points of each interval. A limit that is exceeded between
    the points is tightened in that interval, and the program is solved again.

    Args:
        stretch: The divided path.
        top: Limits on |u|, shape (2,); infinite without a limit.
        rate: Limits on |du/dt|, shape (2,); infinite without a limit.

    Raises:
        NotConvergedError: If the solver stops without a solution.
    """
    b = np.zeros(len(stretch.nodes))
    fast, tight = np.tile(top, (len(stretch.w), 1)), np.tile(rate, (len(stretch.w), 1))
    for _ in range(_MOST_ROUNDS):
        b = _solve(stretch, fast, tight)
        inside = _interpolate(b)
        speed = np.max(np.abs(stretch.w) * np.sqrt(inside)[..., None], axis=1) / top
        excess = np.max(np.abs(_rates(stretch, b)), axis=1) / rate
        if max(np.max(speed), np.max(excess)) <= 1 + _LIMIT_TOLERANCE:
            break
        fast, tight = fast / np.maximum(speed, 1.0), tight / np.maximum(excess, 1.0)
    return _clock(stretch.nodes, b)


def _directions(path: Trajectory, length: Bernstein, grid: Grid) -> Array:
    """Return the inputs w per unit of ds/dt at the grid's points (lengths s), shape (M, D, 2).

    The ends of each piece are evaluated slightly inside the piece.
    """
    left, right = grid.breaks[:-1, None], grid.breaks[1:, None]
    nudge = 1e-7 * (right - left)
    s = np.clip(grid.times, left + nudge, right - nudge)
    k = np.searchsorted(length.c[0], s, side="right") - 1
    inverse = Inverse(length)
    sigma = inverse(s, length.x[k], length.x[k + 1])
    return np.asarray(path.u(sigma) / inverse.slope(sigma)[..., None])


def _rates(stretch: PathIntervals, b: Array) -> Array:
    """Return du/dt at the Chebyshev points of every interval, shape (M, D, 2)."""
    slope = np.diff(b) / (2 * np.diff(stretch.nodes))
    return np.asarray(stretch.dw * _interpolate(b)[..., None] + stretch.w * slope[:, None, None])


def _interpolate(b: Array) -> Array:
    """Return b at the Chebyshev points, (M, D), interpolated linearly between the nodes (M+1,)."""
    return np.asarray(b[:-1, None] + np.diff(b)[:, None] * Grid(np.array([0.0, 1.0])).times[0])


def _ceiling(stretch: PathIntervals, top: Array) -> Array:
    """Return the largest b at each node that respects the input limits (M, 2) of both adjacent
    intervals."""
    with np.errstate(divide="ignore"):
        left, right = (np.min((top / np.abs(stretch.w[:, k])) ** 2, axis=-1) for k in (0, -1))
    return np.asarray(np.minimum(np.append(left, np.inf), np.append(np.inf, right)))


def _solve(stretch: PathIntervals, top: Array, rate: Array) -> Array:
    """Return the optimal b at the nodes, (M+1,), for limits (M, 2) in each interval.

    The time is convex in b. So its tangent at any b gives a linear program, whose optimum bounds
    the least time from below. Any positive weights find the largest b at all nodes at once, if
    there is one; nearly always there is, and the second program proves it. Else the way to each
    program's answer is searched for the least time (Frank and Wolfe, Naval Research Logistics
    Quarterly 3(1-2), 1956).
    """
    step, free = np.diff(stretch.nodes), np.flatnonzero(~stretch.stops)
    ceiling, scale = _ceiling(stretch, top)[free], _scale(stretch, top, rate)[free]
    rows = _rate_rows(stretch, rate)[:, free] @ sparse.diags(scale)
    size = np.maximum(np.abs(rows).max(axis=1).toarray()[:, 0], np.finfo(float).tiny)
    rows = sparse.diags(1 / size) @ rows
    limits = {"A_ub": sparse.vstack([rows, -rows]).tocsc(), "b_ub": np.tile(1 / size, 2)}
    bounds = np.stack([np.zeros(len(free)), ceiling / scale], axis=1)

    def largest(weights: Array) -> Array:
        answer = linprog(
            -weights / np.max(weights), **limits, bounds=bounds, options={"presolve": False}
        )
        if answer.x is None:
            raise NotConvergedError(
                f"retiming: the solver stopped with {answer.message}",
                advice="fewer or more intervals",
            )
        b = np.zeros(len(stretch.nodes))
        b[free] = np.maximum(np.minimum(answer.x * scale, ceiling), _LEAST_SHARE * scale)
        return b

    def time(b: Array) -> float:
        return float(np.sum(2 * step / (np.sqrt(b[:-1]) + np.sqrt(b[1:]))))

    b = largest(np.ones(len(free)))
    for _ in range(_MOST_TANGENTS):
        root = np.sqrt(b)
        pull = step / (root[:-1] + root[1:]) ** 2
        slope = (np.append(pull, 0) + np.append(0, pull))[free] / root[free]  # -d time / db
        new = largest(slope * scale)
        if slope @ (new - b)[free] <= _GAP * time(b):
            break
        share = minimize_scalar(
            lambda share, b=b, new=new: time(b + share * (new - b)), bounds=(0, 1), method="bounded"
        )
        b = b + share.x * (new - b)
    return b


_GAP = 1e-6
"""The search ends when no b could save more than this share of the time."""

_MOST_TANGENTS = 20
_LEAST_SHARE = 1e-12
"""Least b where the motion does not stop, in units of `_scale`: it must go on."""


def _rate_rows(stretch: PathIntervals, rate: Array) -> Any:
    """Return the matrix (rows, M+1) that takes b to the rates in units of their limits (M, 2)."""
    step, count = np.diff(stretch.nodes), len(stretch.w)
    places = np.tile(np.arange(count), 2), np.arange(2 * count) - np.repeat([0, count - 1], count)
    blocks = []
    for point, fraction in zip(_RATE_POINTS, (0.0, 0.5, 1.0), strict=True):
        for i in np.flatnonzero(np.all(np.isfinite(rate), axis=0)):
            turn, gain = stretch.dw[:, point, i], stretch.w[:, point, i] / (2 * step)
            left, right = turn * (1 - fraction) - gain, turn * fraction + gain
            entries = np.concatenate([left / rate[:, i], right / rate[:, i]])
            blocks.append(sparse.csr_matrix((entries, places), shape=(count, count + 1)))
    rows: Any = sparse.vstack(blocks).tocsc()
    return rows


def _scale(stretch: PathIntervals, top: Array, rate: Array) -> Array:
    """Return about the largest b that each node can have, (M+1,), between the stops."""
    with np.errstate(divide="ignore"):
        pull = np.max(np.min(rate[:, None] / np.abs(stretch.w), axis=(1, 2)))
    stops = stretch.nodes[stretch.stops]
    far = np.min(np.abs(stretch.nodes[:, None] - stops), axis=1, initial=stretch.nodes[-1])
    return np.asarray(np.minimum(_ceiling(stretch, top), 2 * pull * far))


def _clock(nodes: Array, b: Array) -> Bernstein:
    """Return s(t) with ds/dt = √b at the nodes and constant acceleration between them."""
    speed, step = np.sqrt(b), np.diff(nodes)
    times = 2 * step / (speed[:-1] + speed[1:])
    c = np.stack([nodes[:-1], nodes[:-1] + speed[:-1] * times / 2, nodes[1:]])
    return Bernstein(c, np.concatenate([[0.0], np.cumsum(times)]))


def _without_pauses(path: Trajectory, scale: Array, norm: Norm) -> tuple[Trajectory, Bernstein]:
    """Return the path without the pieces in which it stands still, and its length.

    A pause takes no time in the fastest timing.

    Raises:
        InputError: If the path does not move.
    """
    while True:
        length = arc_length(path, scale, norm)
        moves = np.diff(length(path.breaks)) > LENGTH_TOLERANCE * length.c[-1, -1]
        if not np.any(moves):
            raise InputError("the plan does not move, so there is no motion to retime")
        if np.all(moves) or not isinstance(path, ChainedTrajectory | StateTrajectory):
            return path, length
        curves = ((name, part) for name, part in vars(path).items() if isinstance(part, Bernstein))
        moved: dict[str, Any] = {name: curve.only(moves) for name, curve in curves}
        path = replace(path, **moved)


InputMask = NDArray[np.bool_]


def fastest_motion(
    path: Trajectory,
    limits: Limits,
    requirements: Sequence[Requirement],
    moving: InputMask,
    rest: bool = False,
    intervals: int = 400,
) -> tuple[RetimedTrajectory, dict[str, Any]]:
    """Return the fastest timing of a path within limits on inputs and their rates, not verified.

    Args:
        path: A trajectory with inputs at all times; if retimed, its original path is used.
        limits: Limits on inputs and their rates; each moving input must have at least one.
        requirements: Requirements for which the whole motion is slowed: slightly for limits on
            inputs and rates, which the clock respects already; as needed for others.
        moving: Which inputs move, shape (2,).
        rest: Whether inputs are zero at both ends; needs rate limits.
        intervals: Number of intervals of the program, if rates are limited.

    Returns:
        The motion and notes. The note `slowed_for_other_limits` is the factor by which other limits
        slowed the motion, whose timing is then not the fastest under those limits.

    Raises:
        InputError: If the path does not move.
        NotConvergedError: If the program is not solved, or an input would jump although a
            requirement other than `limits` limits its rate.
    """
    while isinstance(path, RetimedTrajectory):
        path = path.path
    if np.any(np.isfinite(limits.input_rate[moving])):
        scale = np.where(np.isfinite(limits.input), limits.input, limits.input_rate)
        scale = np.where(moving & np.isfinite(scale), scale, 1.0)
        path, length = _without_pauses(path, scale, "euclid")
        stretch = cut_path(path, length, scale, intervals, rest)
        clock = fastest_clock(stretch, limits.input, limits.input_rate)
        trajectory = RetimedTrajectory(path, length, clock, stretch.stations)
        notes: dict[str, Any] = {"stops": int(np.sum(stretch.stops[1:-1]))}
    else:
        path, length = _without_pauses(path, np.where(moving, limits.input, 1.0), "max")
        edges = np.append(length.c[0], length.c[-1, -1])
        clock = Bernstein(np.stack([edges[:-1], edges[1:]]), edges)
        trajectory, notes = RetimedTrajectory(path, length, clock, length.x), {}
    factor = slowing_factor(requirements, trajectory)
    if np.isinf(factor):
        raise NotConvergedError(
            "the fastest timing within the input limits makes an input jump, but another"
            " requirement limits its rate",
            advice=f"a limit in {' and '.join(dict.fromkeys(limits.rate_keys))}, with which the"
            " inputs do not jump",
        )
    if factor > CLOCK_SLOWING:
        notes = {**notes, "slowed_for_other_limits": factor}
    return (trajectory.slowed(factor) if factor > 1 else trajectory), notes


CLOCK_SLOWING = 1.01
"""Largest slowing factor that only corrects the clock's small excess over its own limits. A larger
factor comes from another limit, under which the timing is not the fastest."""
