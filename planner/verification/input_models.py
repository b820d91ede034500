"""Inputs of a trajectory as balls on sufficiently fine cells, for each kind of trajectory.

The inputs of a retimed path are functions of the path's own time σ, which has no formula in t: it
is the root of length(σ) = clock(t). The error of a polynomial g(t) near σ(t) is bounded by the
residual d = length(g) − clock: if Re length' ≥ m > 0 on the disc of radius η > |d|/m about g, then
length − clock is one-to-one there and, by Rouché's theorem, its only root is within |d|/m of g, on
the real line and on every ellipse. Then

    u = w σ̇,   du/dt = w' σ̇² + w σ̈,   σ̇ = ṡ/length',   σ̈ = (s̈ − length'' σ̇²)/length'

with w the path's inputs at σ, and s = clock(t). If the path stands still (length' = 0), there is no
bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from planner.plan.curves import Cells
from planner.plan.retimed import RetimedTrajectory
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory, Trajectory
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.chebyshev import from_bernstein
from planner.systems.chained_form import chained_form
from planner.systems.triangular_system import TriangularSystem
from planner.verification.balls import Ball, polynomial_balls, reciprocal
from planner.verification.enclosure import Enclosure, enclose, perturbed_motion
from planner.verification.functions import (
    Expression,
    UnboundedError,
    balls_on_cells,
    derivative,
    polynomials,
    refine_curve,
)
from planner.verification.models import (
    ROUNDING_FACTOR,
    ROUNDING_UNIT,
    Index,
    Model,
    evaluation,
    interpolation,
    least_values,
    nodes,
    slopes,
)

FINE_REMAINDER = 1e-10
"""Relative remainder of inputs and rates (see `Ball.relative_remainder`) at which a cell is fine
enough."""

NOISE_REMAINDER = 1e-3
"""Relative remainder below which a cell is kept if halving it last reduced the remainder by less
than half: the remainder is then due to rounding errors."""

FEWEST_CELLS = 4
COARSE_REMAINDER = 1e-4
"""Relative remainder above which a cell is divided into four parts at once, not into two."""

MOST_CELLS = 1500

REFINEMENT_ROUNDING = 1e-13
"""Relative rounding error of a path's inputs when they are represented on more pieces."""


CellChoice = Callable[[Enclosure], Index]
"""Function from an enclosed motion to a mask of the cells that are too coarse for a later use."""


def enclose_trajectory(
    trajectory: Trajectory, start: Array, coarse: CellChoice | None = None
) -> tuple[InputSource, Enclosure, list[Model]]:
    """Enclose the true motion under a trajectory's inputs.

    A retimed trajectory is enclosed along its path in the path's own time, since the timing leaves
    the sequence of states unchanged.

    Args:
        trajectory: A trajectory of a known kind.
        start: q(0), shape (N,).
        coarse: Selects further cells to divide; none by default.

    Returns:
        The inputs, the motion, and models of the trajectory's own coordinates.

    Raises:
        UnboundedError: If a trajectory of this kind or of this system cannot be bounded.
    """
    path = _path(trajectory)
    source = source_of(path)
    motion = resolve(source, start, coarse)
    if path is not trajectory:
        motion = perturbed_motion(path.system, motion, _omitted_inputs(trajectory, motion))
    if isinstance(path, StateTrajectory):
        return source, motion, polynomials(path.q_curve, motion.cells)
    assert isinstance(path, ChainedTrajectory)
    state = _inverse_of(path.system, tuple(path.branch.tolist()))
    return source, motion, motion.models(*state(balls_on_cells(path.z_curve, motion.cells)))


def _path(trajectory: Trajectory) -> Trajectory:
    """Return the path of a retimed trajectory, and any other trajectory unchanged.

    The path's curves are also divided at the breaks of the function `trajectory.length`.
    """
    if type(trajectory) is not RetimedTrajectory:
        return trajectory
    path, breaks = trajectory.path, trajectory.length.x
    _law(path)  # raises if the curves are unknown
    names = ("q_curve", "u_curve") if type(path) is StateTrajectory else ("z_curve", "v_curve")
    return replace(path, **{name: refine_curve(getattr(path, name), breaks) for name in names})  # type: ignore[type-var]


def _omitted_inputs(trajectory: Trajectory, motion: Enclosure) -> Array:
    """Bound the part of a path's inputs that a retimed motion may skip, (2,), in the inputs' units.

    The clock follows the length, so it skips any stretch of the path over which the length does not
    grow. If |u| ≤ M length' + η everywhere, the skipped inputs add up to at most η times the
    stretch. M is arbitrary; η is the least value for that M.
    """
    assert isinstance(trajectory, RetimedTrajectory)
    (rate,) = polynomials(trajectory.length, motion.cells, 1)
    pace, out = rate.c @ evaluation(rate.c.shape[1]).T, []
    mean = trajectory.length.c[-1, -1] / trajectory.length.x[-1]
    for ball, model in zip(motion.u, motion.models(*motion.u), strict=True):
        size = np.abs(ball.points.c)
        steep = float(np.max(size / pace, where=pace > 1e-3 * mean, initial=0.0))
        bound = rate.scaled(np.full(len(pace), 2 * steep))
        scale = np.full(2, max(float(np.mean(size)), 1e-12))
        both = [(1.0, bound + model, 0.0), (1.0, bound - model, 0.0)]
        bounds = least_values(both, motion.cells, scale)
        left = np.max([0.0, *(-x.guaranteed for x in bounds)])  # NaN stays NaN
        eta = float(left) + REFINEMENT_ROUNDING * float(np.max(size))
        out.append(eta if eta >= 0 else np.inf)
    return np.array(out)


@dataclass(frozen=True, eq=False)
class InputSource:
    """The inputs of a trajectory as functions that balls can bound.

    Attributes:
        trajectory: The trajectory with these inputs.
        inputs: Function from cells to balls of u₁ and u₂.
        slopes: Function from cells to balls of du₁/dt and du₂/dt.
        halvings: Largest number of halvings of a cell. Near a singularity halving reaches
            cells that have a bound; near a standstill of a retimed path it only narrows the part
            without a bound.
    """

    trajectory: Trajectory
    inputs: Callable[[Cells], list[Ball]]
    slopes: Callable[[Cells], list[Ball]]
    halvings: int = 24


def source_of(trajectory: Trajectory) -> InputSource:
    """Return the inputs of a trajectory, which may be given in q, in z, or as a retimed path.

    Raises:
        UnboundedError: If the trajectory is of another kind, or its chart has no expression.
    """
    if type(trajectory) is RetimedTrajectory:
        return _retimed_source(trajectory)
    curves, inputs, slopes = _law(trajectory)

    def read(cells: Cells, order: int) -> list[list[Ball]]:
        return [balls_on_cells(curve, cells, order) for curve in curves]

    return InputSource(
        trajectory,
        lambda cells: inputs(*read(cells, 0)),
        lambda cells: slopes(*read(cells, 0), *read(cells, 1)),
    )


def _retimed_source(trajectory: RetimedTrajectory) -> InputSource:
    curves, inputs, slopes = _law(trajectory.path)

    def read(cells: Cells, sigma: Ball, order: int) -> list[list[Ball]]:
        return [derivative_on_balls(curve, order, trajectory, cells, sigma) for curve in curves]

    def paced(cells: Cells) -> list[Ball]:
        sigma, pace, _ = path_times(trajectory, cells)
        return [u * pace for u in inputs(*read(cells, sigma, 0))]

    def rated(cells: Cells) -> list[Ball]:
        sigma, pace, bend = path_times(trajectory, cells)
        path_inputs = read(cells, sigma, 0)
        pairs = zip(inputs(*path_inputs), slopes(*path_inputs, *read(cells, sigma, 1)), strict=True)
        return [du * pace * pace + u * bend for u, du in pairs]

    return InputSource(trajectory, paced, rated, halvings=8)


Law = Callable[..., list[Ball]]


def _law(path: Trajectory) -> tuple[list[Bernstein], Law, Law]:
    """Return a path's curves, and functions from balls of the curves to inputs and input slopes.

    The first function maps the curves to the inputs; the second maps the curves and their
    derivatives to the inputs' slopes.

    Raises:
        UnboundedError: If the path is of another kind, or of a subclass, which may evaluate its
            curves differently.
    """
    if type(path) is StateTrajectory:
        return [path.u_curve], lambda u: u, lambda _, du: du
    if type(path) is ChainedTrajectory:
        return [path.z_curve, path.v_curve], *feedback_law(path.system, tuple(path.branch.tolist()))
    if isinstance(path, RetimedTrajectory):
        raise UnboundedError("a path that is retimed twice")
    raise UnboundedError(f"trajectories of kind '{path.kind}'")


State = Callable[[list[Ball]], list[Ball]]
"""Function from balls of the chained coordinates z to balls of the coordinates q."""


@lru_cache(maxsize=32)
def _inverse_of(system: TriangularSystem, branch: tuple[float, ...]) -> State:
    """Return the map from chained coordinates z to q on one branch, as a function on balls."""
    z = ca.SX.sym("z", system.size)
    q = chained_form(system).q_expr(z, ca.DM(branch))
    return _inverse_by_links(system, branch) if q is None else Expression([z], q)


def _inverse_by_links(system: TriangularSystem, branch: tuple[float, ...]) -> State:
    """Return the map z → q of a chart that is solved link by link, from the last coordinate back.

    zᵢ depends on no coordinate before qᵢ, and is monotonic in qᵢ on the whole branch.
    """
    size, form, signs = system.size, chained_form(system), np.array(branch)
    q = ca.SX.sym("q", size)
    chain = form.z_expr(q)
    slopes = ca.vertcat(*(ca.jacobian(chain[i], q[i]) for i in range(size)))
    value, slope = Expression([q], chain), Expression([q], slopes)

    def state(z: list[Ball]) -> list[Ball]:
        points = np.stack([ball.points.c for ball in z], axis=-1)
        c = form.q(points, signs).transpose(2, 0, 1) @ interpolation().T
        guess = polynomial_balls(c, 0 * c[:, :, 0])
        states = {0: z[0], size - 1: z[-1]}
        for i in range(size - 2, 0, -1):
            gap = value.entry(i, [{**states, i: guess[i]}], {}) - z[i]

            def steep(x: Ball, i: int = i) -> Ball:
                return slope.entry(i, [{**states, i: x}], {})

            states[i], _ = root(guess[i], gap, steep, np.sign(steep(guess[i]).c))
        return [states[i] for i in range(size)]

    return state


@lru_cache(maxsize=32)
def feedback_law(system: TriangularSystem, branch: tuple[float, ...]) -> tuple[Law, Law]:
    """Return the inputs u as a function of (z, v), and du/dt as a function of (z, v, ż, v̇).

    z and v are the coordinates and inputs of the chained form; the functions are for balls.
    """
    n = system.size
    z, v, dz, dv = (ca.SX.sym(name, k) for name, k in (("z", n), ("v", 2), ("dz", n), ("dv", 2)))
    u = chained_form(system).inputs_expr(z, v, ca.DM(branch))
    if u is not None:
        rate = ca.jtimes(u, z, dz) + ca.jtimes(u, v, dv)
        return Expression([z, v], u), Expression([z, v, dz, dv], rate)
    q, state = ca.SX.sym("q", n), _inverse_of(system, branch)
    turn = ca.jacobian(chained_form(system).z_expr(q)[1], q)
    drift = turn[0, 2:] @ ca.vertcat(*system.slopes_expr(q))
    u = ca.vertcat(v[0] / system.drive_expr(q), (v[1] - drift * v[0]) / turn[0, 1])
    rate = ca.jtimes(u, q, ca.vertcat(*system.rates_expr(q, u))) + ca.jtimes(u, v, dv)
    of, slope_of = Expression([q, v], u), Expression([q, v, dv], rate)
    return lambda z, v: of(state(z), v), lambda z, v, _, dv: slope_of(state(z), v, dv)


def root(
    guess: Ball, gap: Ball, steep: Callable[[Ball], Ball], side: Array | float = 1.0
) -> tuple[Ball, Ball]:
    """Enclose a function's root near a guess and the function's slope there; unbounded if unproven.

    Args:
        guess: A polynomial, taken as exact.
        gap: The function's value at the guess.
        steep: Computes the function's slope on a ball.
        side: Sign of the slope.
    """
    defect, near = (np.abs(gap.c) + gap.reach) * ROUNDING_FACTOR, steep(guess)
    trust = 2 * defect / (side * near.c - near.reach)
    slope = steep(guess.widen(trust))
    least = side * slope.c - slope.reach
    error = np.where(least > 0, defect / least * ROUNDING_FACTOR, np.inf)
    proven = (error < trust) | (error == 0)
    slope = slope.widen(np.where(proven, 0.0, np.inf))
    return guess.widen(np.where(proven, error, np.inf)), slope


def resolve(
    source: InputSource, start: Array | None = None, coarse: CellChoice | None = None
) -> Enclosure:
    """Enclose inputs on cells that are fine enough for rounding accuracy, or as fine as allowed.

    Args:
        source: Source of the inputs.
        start: q(0), shape (N,); if given, the motion and its rates are enclosed too.
        coarse: Selects further cells to divide, as in `enclose_trajectory`.
    """
    cells = Cells.of(source.trajectory.breaks)
    if len(cells.piece) < FEWEST_CELLS:
        cells, _ = cells.split()
    u = source.inputs(cells)
    before = {stage: np.full(len(cells.piece), np.inf) for stage in ("inputs", "rates", "values")}
    for _ in range(source.halvings):
        motion, stage = Enclosure(cells, [], u), "inputs"
        bad, rough = _cells_to_divide(u, before[stage])
        if start is not None and not np.any(bad):
            motion, stage = enclose(source.trajectory, cells, u, start), "rates"
            bad, rough = _cells_to_divide(motion.rates, before[stage])
        if coarse is not None and not np.any(bad):
            stage, bad, rough = "values", coarse(motion), np.full(len(bad), np.inf)
        if not np.any(bad) or len(bad) + np.sum(bad) > MOST_CELLS:
            break
        cells, origin = cells.split(np.where(bad, np.where(rough > COARSE_REMAINDER, 4, 2), 1))
        before[stage] = np.where(bad, rough, before[stage])
        before = {stage: kept[origin] for stage, kept in before.items()}
        fresh = bad[origin]
        new = source.inputs(cells.select(fresh))
        u = [old.replace_rows(origin, fresh, x) for old, x in zip(u, new, strict=True)]
    if start is not None and not motion.q:
        return enclose(source.trajectory, motion.cells, motion.u, start)
    return motion


def _cells_to_divide(balls: list[Ball], before: Array) -> tuple[Index, Array]:
    """Return which cells to divide, and the relative remainder of each cell, both (C,).

    `before` is the relative remainder of the cell from which each cell was made.
    """
    rough = np.max([x.relative_remainder for x in balls], axis=0)
    fine = (rough <= FINE_REMAINDER) | ((rough < NOISE_REMAINDER) & (rough > 0.5 * before))
    return ~fine, rough  # type: ignore[return-value, unused-ignore]  # NumPy 2.5's np.max


def path_times(trajectory: RetimedTrajectory, cells: Cells) -> tuple[Ball, Ball, Ball]:
    """Return balls of σ, dσ/dt and d²σ/dt² on the cells, with σ the own time of a retimed path."""
    length, clock = trajectory.length, trajectory.clock
    times = trajectory.sigma(cells.times(nodes())) @ interpolation().T
    (guess,) = polynomial_balls(times[None], np.zeros((1, len(times))))

    def along(order: int, sigma: Ball) -> Ball:
        return derivative_on_balls(length, order, trajectory, cells, sigma)[0]

    (s,), (speed,), (gain,) = (balls_on_cells(clock, cells, order) for order in range(3))
    sigma, steep = root(guess, along(0, guess) - s, lambda x: along(1, x))
    over = reciprocal(steep)
    pace = speed * over
    return sigma, pace, (gain - along(2, sigma) * pace * pace) * over


def derivative_on_balls(
    curve: Bernstein, order: int, trajectory: RetimedTrajectory, cells: Cells, sigma: Ball
) -> list[Ball]:
    """Return balls of a derivative of a path's curve at the path times `sigma`.

    `order` is the order of the derivative; every cell of the clock lies in one piece of the curve.
    """
    b, slip = derivative(curve, order)
    stations = trajectory.stations
    middle = (stations[cells.piece] + stations[cells.piece + 1]) / 2
    piece = np.clip(np.searchsorted(curve.x, middle, side="right") - 1, 0, len(curve.x) - 2)
    left, width = curve.x[piece, None], np.diff(curve.x)[piece, None]
    x = (sigma + Ball(-left, 0 * left, 0 * left)).scaled(2 / width) - 1.0
    x = x.widen(4 * ROUNDING_UNIT * x.size)
    matrix = from_bernstein(len(b))
    grown = (len(b) + 4) * np.sum(np.abs(matrix)) * ROUNDING_UNIT
    slips = (slip + grown * np.max(np.abs(b), axis=0))[piece]
    return composite(b.transpose(2, 1, 0)[:, piece] @ matrix.T, slips.T[..., None], x)


def composite(c: Array, slip: Array, x: Ball) -> list[Ball]:
    """Return the balls of k polynomials p(x) = Σ cⱼ Tⱼ(x) of a ball x, from c (k, C, width).

    The errors of p's coefficients sum to `slip` (k, C, 1). The rest is δ²/2 max|p''|. All points
    within δ of c lie in the ellipse about [−1, 1] with the greater half axis a = max(|c|, 1) + δ,
    where |Tⱼ| ≤ Tⱼ(a). Clenshaw's sums have errors of at most 8 width² units of Σ |cⱼ| Tⱼ(a).
    """
    width, last = c.shape[2], np.zeros(c.shape)
    last[..., -1] = 1.0
    slope, bend = c @ slopes(width, 1).T, c @ slopes(width, 2).T
    far = (np.maximum(np.abs(x.c), 1.0) + x.reach) * ROUNDING_FACTOR
    size, steepest, bent, top = _clenshaw(np.abs(np.stack([c, slope, bend, last])), far)
    value, steep = _clenshaw(np.stack([c, slope]), x.c)
    loose = 8 * width**2 * ROUNDING_UNIT
    rest = x.reach**2 / 2 * (bent + width**4 * slip * top) * (1 + loose)
    wrong = loose * (size + x.reach * steepest) + slip * top * (1 + width**2 * x.reach)
    r = (np.abs(steep) * x.r + (rest + wrong) * (1 + loose)) * ROUNDING_FACTOR
    return [Ball(*parts) for parts in zip(value, steep * x.b, r, strict=True)]


def _clenshaw(c: Array, x: Array) -> Array:
    """Return Σ cₖ Tₖ(x) by Clenshaw's method, shape (…, C, E).

    On each of C cells, `c` (…, C, width) has the coefficients, and `x` (C, E) has E places.
    """
    later = last = np.zeros((*c.shape[:-1], x.shape[-1]))
    twice = 2 * x
    for k in range(c.shape[-1] - 1, 0, -1):
        later, last = c[..., k, None] + twice * later - last, later
    return np.asarray(c[..., 0, None] + x * later - last)
