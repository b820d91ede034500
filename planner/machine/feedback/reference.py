"""The course on the tracker's clock: feedforward, linear model and limits of each control period.

A motor's command issued at time t acts as if at t + shift (the sum of the machine's known delay and
lags, one for each motor). Reading k is taken at tₖ, and the commands that depend on it are issued
from tₖ + wait on. When all earlier commands have been executed, at sₖ = tₖ + wait + shift, the
motion deviates from the course by δqₖ, and a period later by

    δqₖ₊₁ = Aₖ δqₖ + Bₖ vₖ₋₁→ₖ + Eₖ ε

with v the correction, held over a period (or, where input rates are limited, linear from the
previous to the new one), and ε the relative errors of the passive coordinates' rates. A passive
joint is represented by the position to which its axis a will push it, a ∓ w with the lost motion w.
So a reversal of the drive moves it by 2w at once, and by 2δw more on a machine with δw more lost
motion: E has columns for δw, and the regulator prepares for a reversal once δw is known.

The file also has the linear-quadratic regulator along the course, the tracker's law where no limit
is active. The state is ξ = (δq, w, ε, δw): the deviation from the course, the correction of the
previous period, and, both constant, the rates' relative errors and the deviation of the lost
motion. The cost of a correction v over periods k … K−1 is

    Σ (δqᵀ Q δq + vᵀ R v) τ + (v − w)ᵀ S (v − w)  +  δq_Kᵀ G δq_K

(H. Kwakernaak, R. Sivan, *Linear Optimal Control Systems*, 1972, section 6.4). Errors of the path
coordinate cost nothing where it is the disk's angle: no sensor measures it, and backlash shifts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from planner.machine.feedback.course import Course, Timing
from planner.machine.feedback.estimate import Forecast
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.support.compiled_calls import Pointwise
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import TriangularSystem

LEFT_JOINT_RAD = float(np.deg2rad(0.05))
"""Distance from which an axis counts as having left its joint, rad."""

SWING_ROOM_RAD = float(np.deg2rad(1.0))
"""Angle by which θ₁ may leave the range of the run-up, rad. Without this limit the tracker's
corrections bring the arm up to 0.6 m nearer to a post than the nominal run-up."""

RESTING_SHARE = 1e-3
"""Largest speed of a resting drive as a fraction of its limit, less than a command's resolution."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The tracker's course of N coordinates, sampled in K periods of M ticks.

    Attributes:
        timing: The clock.
        limit: Largest |u| of the tracker's commands, (2,).
        rate: Largest |du/dt|, (2,); infinite without a limit.
        start: The course at the first reading, (N,).
        s: Times at which each period's effect on the path begins, then the end of the last, (K+1,),
            s.
        is_counted: Whether the period's effect begins after the start of the motion whose errors
            are measured, (K,).
        rests: Whether the drive rests while θ₁ swings, before the start of that motion, (K,).
        q: The course at times s, (K+1, N); passive joints where their axes would push them to.
        joints: Passive joints at times s, (K+1, N−2).
        feed: Mean input of the course in each tick, within the limit, (K, M, 2).
        last_ticks: Number of the tick, from the first reading on, at whose start the command of
            each motor ends, (2,).
        first_inputs: Mean inputs of the ticks before the first correction can act, (latency, 2).
        A: ∂δqₖ₊₁/∂δqₖ, (K, N, N).
        B_before: ∂δqₖ₊₁/∂v of the previous period, (K, N, 2); zero for held corrections.
        B: ∂δqₖ₊₁/∂v, (K, N, 2).
        E: ∂δqₖ₊₁/∂(ε, δw), (K, N, 2(N−2)).
        way: Direction in which each passive axis pushes its joint next, 1 or −1, (K+1, N−2).
        push: Distance by which the axis pushes its joint before the axis turns back, (K+1, N−2); if
            it does not reach the joint, minus the remaining gap.
        next_push: The same as `push` for the push after that, (K+1, N−2).
        lost_motion: Lost motion that the course allows for, (N−2, 1).
        low: Least correction, (K, 2).
        high: Greatest correction, (K, 2).
        rows: Unit rows (K, c, N) that give c limited distances in δqₖ₊₁.
        floor: Least values of the rows, (K, c).
        ceiling: Greatest values of the rows, (K, c).
    """

    timing: Timing
    limit: Array
    rate: Array
    start: Array
    s: Array
    is_counted: NDArray[np.bool_]
    rests: NDArray[np.bool_]
    q: Array
    joints: Array
    feed: Array
    last_ticks: NDArray[np.int64]
    first_inputs: Array
    A: Array
    B_before: Array
    B: Array
    E: Array
    way: Array
    push: Array
    next_push: Array
    lost_motion: Array
    low: Array
    high: Array
    rows: Array
    floor: Array
    ceiling: Array


def reference(
    course: Course,
    timing: Timing,
    forecast: Forecast,
    lost: Array,
    limit: Array,
    count: int,
    least_speed: float,
) -> Reference:
    """Sample a course on the tracker's clock.

    Args:
        course: The course.
        timing: The clock.
        forecast: The model of the nominal machine.
        lost: Lost motion of each passive joint that the course allows for, (N−2, 1).
        limit: Largest |u|, (2,).
        count: Number of periods K.
        least_speed: Least speed along the path, as a fraction of the course's speed.
    """
    problem = course.plan.problem
    system, tick, ticks = problem.system, timing.tick, timing.ticks
    issued = timing.begin + timing.wait + timing.period * np.arange(count + 1, dtype=np.float64)
    s = issued + timing.shift[0]
    edges = timing.begin + tick * np.arange(timing.latency + count * ticks + 1, dtype=np.float64)
    inputs = np.clip(np.diff(course.commanded_angles(edges), axis=0) / tick, -limit, limit)
    first, feed = inputs[: timing.latency], inputs[timing.latency :].reshape(count, ticks, 2)
    q = course.q(s)
    q[:, 1] = course.q(issued + timing.shift[1])[:, 1]
    begin = course.q(np.array(timing.begin))
    at_edges = _pushes(forecast, course.q(edges + timing.shift[0]), inputs * tick, lost)
    way, gap, push, next_push = (value[timing.latency :: ticks] for value in at_edges)
    joints = q[:, 2:].copy()
    q[:, 2:] -= way * gap
    middle = issued[:-1, None] + tick * (np.arange(ticks) + 0.5) + timing.shift[0]
    ramp = bool(np.any(np.isfinite(problem.limits.input_rate)))
    A, before, B, E = _model(system, course.q(middle), feed, tick, ramp)
    E = np.concatenate([E, np.zeros_like(E)], axis=2)
    passive = np.arange(2, system.size)
    E[:, passive, passive + len(passive) - 2] = way[:-1] - way[1:]
    is_counted = s[:-1] >= course.start
    low, high = _bounds(feed, limit, np.where(is_counted, least_speed, 0.0))
    rests = (s[1:] <= course.start) & np.all(feed[:, :, 0] == 0, axis=1)
    high[rests, 0], low[rests, 0] = RESTING_SHARE * limit[0], -RESTING_SHARE * limit[0]
    rows, floor, ceiling = _state_limits(problem, q[1:], s[1:] >= course.start, course.swing)
    last = np.ceil((course.end - timing.shift - timing.begin) / tick - 1e-6)
    return Reference(
        timing=timing,
        limit=limit,
        rate=problem.limits.input_rate,
        start=begin,
        s=s,
        is_counted=is_counted,
        rests=rests,
        q=q,
        joints=joints,
        feed=feed,
        last_ticks=last.astype(np.int64),
        first_inputs=first,
        A=A,
        B_before=before,
        B=B,
        E=E,
        way=way,
        push=push,
        next_push=next_push,
        lost_motion=lost,
        low=low,
        high=high,
        rows=rows,
        floor=floor,
        ceiling=ceiling,
    )


def _pushes(forecast: Forecast, q: Array, travel: Array, lost: Array) -> tuple[Array, ...]:
    """Find how each axis pushes its joint next: direction, gap before the push, distance.

    Args:
        forecast: The model of the nominal machine.
        q: The course at the edges of ticks, (m+1, N).
        travel: Travel of the motors in each tick, (m, 2), rad.
        lost: Lost motion of each axis, (N−2, 1).

    Returns:
        At the edges, (m+1, N−2): direction; gap; distance of the next push, and of the one after
        it (see `push` and `next_push` of `Reference`).
    """
    change = forecast.rates((q[:-1] + q[1:]) / 2, travel)[:, 2:]
    place, pushed = np.zeros((len(q), change.shape[1])), np.zeros_like(change)
    for k, step in enumerate(change):
        place[k + 1] = np.clip(place[k] + step, -lost[:, 0], lost[:, 0])
        pushed[k] = place[k] + step - place[k + 1]
    pushed = np.where(lost[:, 0] > 0, pushed, change)
    way, push, next_push = np.zeros_like(place), np.zeros_like(place), np.zeros_like(place)
    for i in range(place.shape[1]):
        moving = np.flatnonzero(pushed[:, i])
        last = moving[-1] if len(moving) else -1
        following = np.searchsorted(moving, np.arange(last + 1))
        way[: last + 1, i] = np.sign(pushed[moving, i])[following]
        way[last + 1 :, i] = way[last, i] if last >= 0 else 1.0
        off = lost[i, 0] - way[-1, i] * place[last + 1 :, i]
        if last >= 0 and np.max(off) > LEFT_JOINT_RAD:  # it leaves its joint for good
            way[last + 1 :, i] *= -1
            push[-1, i] = np.max(off) - 2 * lost[i, 0]
        for k in range(len(change) - 1, -1, -1):
            same = way[k, i] == way[k + 1, i]
            push[k, i] = abs(pushed[k, i]) + (push[k + 1, i] if same else 0.0)
            next_push[k, i] = next_push[k + 1, i] if same else push[k + 1, i]
    return way, lost[:, 0] - way * place, push, next_push


@lru_cache(maxsize=32)
def _derivatives(system: TriangularSystem) -> Pointwise:
    """Return a function of (q, u) for [∂q̇/∂q, ∂q̇/∂u, diagonal of the passive coordinates' q̇],
    shape (N, N + 2 + N − 2)."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    f = ca.vertcat(*system.rates_expr(q, u))
    diagonal = ca.diag(f)[:, 2:]
    slopes = ca.horzcat(ca.jacobian(f, q), ca.jacobian(f, u), diagonal)
    return Pointwise("deviation", [q, u], slopes)


def _model(
    system: TriangularSystem, q: Array, u: Array, tick: float, ramp: bool
) -> tuple[Array, Array, Array, Array]:
    """Return A, B_before, B and E of `Reference` by the midpoint rule, from q and u (K, M, ·) at
    the middle of ticks."""
    size, (count, ticks) = system.size, q.shape[:2]
    slopes = _derivatives(system)(q, u)
    effects = slopes.shape[-1] - size
    A = np.broadcast_to(np.eye(size), (count, size, size))
    before = np.zeros((count, size, effects))
    now = np.zeros((count, size, effects))
    for m in range(ticks):
        slope = slopes[:, m, :, :size]
        step = np.eye(size) + tick * slope + tick**2 / 2 * slope @ slope
        effect = (tick * np.eye(size) + tick**2 / 2 * slope) @ slopes[:, m, :, size:]
        share = (m + 0.5) / ticks if ramp else 1.0
        A, before = step @ A, step @ before + (1 - share) * effect
        now = step @ now + share * effect
    return A, before[..., :2], now[..., :2], (before + now)[..., 2:]


def _bounds(feed: Array, limit: Array, least_speed: Array) -> tuple[Array, Array]:
    """Return the least and greatest corrections (K, 2).

    The drive of the path coordinate keeps the course's direction and at least the least speed.
    Where the course stands, the drive may continue in that direction but not turn back.
    """
    low, high = -limit - feed.min(axis=1), limit - feed.max(axis=1)
    drive = feed[:, :, 0]
    least, most = drive.min(axis=1), drive.max(axis=1)
    way, spare = drive_direction(least, most), 1 - least_speed
    low[:, 0] = np.where(way > 0, np.maximum(low[:, 0], -spare * least), low[:, 0])
    high[:, 0] = np.where(way < 0, np.minimum(high[:, 0], -spare * most), high[:, 0])
    return low, high


def drive_direction(least: Array, most: Array) -> Array:
    """Return where the drive may turn in each period, (K,): 1 forward, −1 backward, 0 both ways.

    A period at rest takes the direction of the motions before and after the rest if both agree. At
    the course's start and end it takes that of the nearest motion.
    """
    way = np.where(least >= 0, 1.0, 0.0) - np.where(most <= 0, 1.0, 0.0)
    still = (least >= 0) & (most <= 0)
    moving = np.nonzero(~still)[0]
    if not len(moving):
        return way
    index = np.searchsorted(moving, np.nonzero(still)[0])
    after = moving[np.minimum(index, len(moving) - 1)]
    before = moving[np.maximum(index - 1, 0)]
    way[still] = np.where(way[after] == way[before], way[before], 0.0)
    return way


@lru_cache(maxsize=32)
def _second(system: TriangularSystem) -> Pointwise:
    """Return the function from coordinates to z₂ and its gradient, (N + 1,)."""
    q = ca.SX.sym("q", system.size)
    z2 = chained_form(system).z_expr(q)[1]
    return Pointwise("second", [q], ca.vertcat(z2, ca.jacobian(z2, q).T))


def _state_limits(
    problem: Problem, q: Array, begun: NDArray[np.bool_], swing: Array
) -> tuple[Array, Array, Array]:
    """Return the unit rows (K, c, N) with least and greatest values (K, c) at the course's q (K,
    N).

    There is one row for each coordinate with a limit, which before the start keeps θ₁ near the
    range `swing` (2,) of the run-up, and, if z₂ has a margin, one along the gradient of z₂
    (linearised, and not before the plan's start).
    """
    limits, count = problem.limits, len(q)
    most = np.repeat(limits.joint[None], count, axis=0)
    least = -most
    least[~begun, 1] = np.maximum(least[~begun, 1], swing[0] - SWING_ROOM_RAD)
    most[~begun, 1] = np.minimum(most[~begun, 1], swing[1] + SWING_ROOM_RAD)
    chosen = np.nonzero(np.isfinite(most).any(axis=0))[0]
    rows = np.broadcast_to(np.eye(q.shape[1])[chosen], (count, len(chosen), q.shape[1]))
    floor, ceiling = (least - q)[:, chosen], (most - q)[:, chosen]
    if limits.z2_margin is None:
        return rows, floor, ceiling
    out = _second(problem.system)(q)
    z2, gradient = problem.z2_sign * out[:, 0], problem.z2_sign * out[:, 1:]
    steep = np.maximum(np.linalg.norm(gradient, axis=1), 1e-9)
    bound = np.where(begun, (limits.z2_margin - z2) / steep, -np.inf)
    rows = np.concatenate([rows, (gradient / steep[:, None])[:, None]], axis=1)
    floor = np.concatenate([floor, bound[:, None]], axis=1)
    ceiling = np.concatenate([ceiling, np.full((count, 1), np.inf)], axis=1)
    return rows, floor, ceiling


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of errors and corrections in the cost that the regulator minimises.

    Attributes:
        path: Weight of each coordinate's deviation at each period's start, diagonal of Q, (K, N).
        goal: Weight of each coordinate's deviation at the end, diagonal of G, (N,).
        size: Weight of each period's corrections, diagonal of R, (K, 2).
        step: Weight of the corrections' changes in each period, diagonal of S, (K, 2).
    """

    path: Array
    goal: Array
    size: Array
    step: Array


@dataclass(frozen=True, eq=False)
class Regulator:
    """The optimal law without limits, v = −gain ξ, and the cost of deviating from it.

    Attributes:
        F: State matrix of ξₖ₊₁ = Fₖ ξₖ + Gₖ v, (K, n, n) with n = N + 2 + 2(N − 2).
        G: Input matrix, (K, n, 2).
        gain: Feedback gain, (K, 2, n).
        root: Scaling of deviations, (K, 2, 2): v = −gain ξ + root c costs |c|² more than the
            optimum.
    """

    F: Array
    G: Array
    gain: Array
    root: Array


def regulator(ref: Reference, weights: Weights) -> Regulator:
    """Return the linear-quadratic regulator along a course, by the backward Riccati recursion."""
    count, size = ref.A.shape[:2]
    F, G = _augment(ref)
    n = F.shape[-1]
    move = slice(size, size + 2)
    cost = np.zeros((n, n))
    cost[range(size), range(size)] = weights.goal
    gain, root = np.empty((count, 2, n)), np.empty((count, 2, 2))
    for k in range(count - 1, -1, -1):
        R, S = np.diag(weights.size[k]) * ref.timing.period, np.diag(weights.step[k])
        curvature = R + S + G[k].T @ cost @ G[k]
        cross = G[k].T @ cost @ F[k]
        cross[:, move] -= S
        gain[k] = np.linalg.solve(curvature, cross)
        root[k] = np.linalg.inv(np.linalg.cholesky(curvature)).T
        cost = F[k].T @ cost @ F[k] - cross.T @ gain[k]
        cost[range(size), range(size)] += weights.path[k] * ref.timing.period
        cost[move, move] += S
        cost = (cost + cost.T) / 2
    return Regulator(F, G, gain, root)


def _augment(ref: Reference) -> tuple[Array, Array]:
    count, size = ref.A.shape[:2]
    n = size + 2 + ref.E.shape[-1]
    F = np.zeros((count, n, n))
    F[:, :size, :size] = ref.A
    F[:, :size, size : size + 2] = ref.B_before
    F[:, :size, size + 2 :] = ref.E
    F[:, range(size + 2, n), range(size + 2, n)] = 1.0
    G = np.zeros((count, n, 2))
    G[:, :size] = ref.B
    G[:, [size, size + 1], [0, 1]] = 1.0
    return F, G
