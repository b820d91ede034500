"""A trajectory's inputs as models on cells fine enough, for each kind of trajectory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from planner.certificate import series
from planner.certificate.cells import Cells, joined, joined_models, polynomials, slopes
from planner.certificate.composed import at, clocked
from planner.certificate.evaluate import Evaluator, UnboundedError
from planner.certificate.model import Model, interpolated
from planner.certificate.motion import rates_of
from planner.chained import chained_form
from planner.retimed import RetimedTrajectory
from planner.systems.base import Array, TriangularSystem
from planner.trajectory import ChainedTrajectory, StateTrajectory, Trajectory

FINE = 1e-10
"""Remainder of inputs and rates, relative to their size or one, below which a cell is kept."""

NOISE = 1e-3
"""Remainder below which a cell hardly better than its parent is kept: the rest is rounding."""

FEWEST_CELLS = 16
MOST_CELLS = 1500


@dataclass(frozen=True, eq=False)
class Source:
    """Inputs of a trajectory that models can bound.

    Attributes:
        trajectory: Whose they are.
        inputs: From cells to models of u₁ and u₂.
        slopes: From cells to models of du₁/dt and du₂/dt.
        halvings: Times a cell may be halved. Near a singularity halving reaches what can be
            bounded; near a standstill of a retimed path it only narrows what cannot.
    """

    trajectory: Trajectory
    inputs: Callable[[Cells], list[Model]]
    slopes: Callable[[Cells], list[Model]]
    halvings: int = 24


def source_of(trajectory: Trajectory) -> Source:
    """The inputs of a trajectory of states or of chained coordinates.

    Raises:
        UnboundedError: If the trajectory is of another kind, or its chart has no expression.
    """
    if isinstance(trajectory, StateTrajectory):
        curve = trajectory.u_curve
        return Source(trajectory, lambda c: polynomials(curve, c), lambda c: slopes(curve, c))
    if isinstance(trajectory, ChainedTrajectory):
        return _chained(trajectory)
    if isinstance(trajectory, RetimedTrajectory):
        return _retimed(trajectory)
    raise UnboundedError(f"trajectories of kind '{trajectory.kind}'")


def _chained(path: ChainedTrajectory) -> Source:
    inputs, rates = _feedback_of(path)
    z, v = path.z_curve, path.v_curve

    def curves(cells: Cells) -> list[list[Model]]:
        return [polynomials(z, cells), polynomials(v, cells)]

    return Source(
        path,
        lambda cells: inputs(*curves(cells)),
        lambda cells: rates(*curves(cells), slopes(z, cells), slopes(v, cells)),
    )


def _retimed(trajectory: RetimedTrajectory) -> Source:
    path = trajectory.path

    def inputs(cells: Cells, sigma: Model) -> list[Model]:
        if isinstance(path, StateTrajectory):
            return at(path.u_curve, 0, trajectory, cells, sigma)
        return _feedback_of(path)[0](*_curves(path, (0,), trajectory, cells, sigma))

    def bends(cells: Cells, sigma: Model) -> list[Model]:
        if isinstance(path, StateTrajectory):
            return at(path.u_curve, 1, trajectory, cells, sigma)
        return _feedback_of(path)[1](*_curves(path, (0, 1), trajectory, cells, sigma))

    def paced(cells: Cells) -> list[Model]:
        own = clocked(trajectory, cells)
        return [u * own.pace for u in inputs(cells, own.sigma)]

    def rated(cells: Cells) -> list[Model]:
        own = clocked(trajectory, cells)
        pairs = zip(inputs(cells, own.sigma), bends(cells, own.sigma), strict=True)
        return [du * own.pace * own.pace + u * own.bend for u, du in pairs]

    if isinstance(path, RetimedTrajectory):
        raise UnboundedError("a path that is retimed twice")
    return Source(trajectory, paced, rated, halvings=8)


def _feedback_of(path: Trajectory) -> tuple[Evaluator, Evaluator]:
    assert isinstance(path, ChainedTrajectory)
    return _feedback(path.system, tuple(path.branch.tolist()))


def _curves(
    path: Trajectory, orders: Sequence[int], by: RetimedTrajectory, cells: Cells, sigma: Model
) -> list[list[Model]]:
    """z and v, then their derivatives if asked for, at models of the path's own time."""
    assert isinstance(path, ChainedTrajectory)
    return [at(c, k, by, cells, sigma) for k in orders for c in (path.z_curve, path.v_curve)]


@lru_cache(maxsize=32)
def _feedback(system: TriangularSystem, branch: tuple[float, ...]) -> tuple[Evaluator, Evaluator]:
    """u of (z, v), and du/dt of (z, v, ż, v̇), on one branch."""
    n = system.size
    z, v, dz, dv = (ca.SX.sym(name, k) for name, k in (("z", n), ("v", 2), ("dz", n), ("dv", 2)))
    u = chained_form(system).inputs_expr(z, v, ca.DM(branch))
    if u is None:
        raise UnboundedError(f"the inverse chart of system '{system.kind}', which is numerical")
    return Evaluator([z, v], u), Evaluator(
        [z, v, dz, dv], ca.jtimes(u, z, dz) + ca.jtimes(u, v, dv)
    )


@lru_cache(maxsize=32)
def inverse_of(system: TriangularSystem, branch: tuple[float, ...]) -> Evaluator:
    """q of z on one branch, for systems whose `source_of` exists."""
    z = ca.SX.sym("z", system.size)
    return Evaluator([z], chained_form(system).q_expr(z, ca.DM(branch)))


def resolve(source: Source) -> tuple[Cells, list[Model], Array]:
    """Cells on which inputs and rates are known to rounding, or as fine as may be.

    Returns:
        The cells in order of time, models of the inputs, and q at the nodes, (C, WIDTH, N).
    """
    open_ = Cells.of(source.trajectory.breaks)
    while len(open_.piece) < FEWEST_CELLS:
        open_ = open_.halved()
    before = np.full(len(open_.piece), np.inf)
    kept: list[tuple[Cells, list[Model], Array]] = []
    total = 0
    for step in range(source.halvings + 1):
        u = source.inputs(open_)
        q = source.trajectory.q(open_.times(series.nodes()))
        badness = np.where(np.isfinite(q).all(axis=(1, 2)), _badness(source, u, q), np.inf)
        hopeless = ~np.isfinite(q).all(axis=(1, 2))
        noise = (badness < NOISE) & (badness > 0.5 * before)
        done = (badness <= FINE) | noise | hopeless
        if step == source.halvings or total + 2 * np.sum(~done) > MOST_CELLS:
            done[:] = True
        kept.append((open_.only(done), [m.only(done) for m in u], q[done]))
        total += int(np.sum(done))
        if np.all(done):
            break
        before = np.tile(badness[~done], 2)
        open_ = open_.only(~done).halved()
    cells = joined([c for c, _, _ in kept])
    order = cells.order()
    models = [joined_models([u[i] for _, u, _ in kept]).only(order) for i in range(2)]
    return cells.only(order), models, np.concatenate([q for *_, q in kept])[order]


def _badness(source: Source, u: list[Model], q: Array) -> Array:
    """Greatest remainder of inputs and rates on each cell."""
    p = [Model(interpolated(np.nan_to_num(x)), np.zeros(len(x))) for x in np.moveaxis(q, -1, 0)]
    models = [*u, *rates_of(source.trajectory.system)(p, u)]
    with np.errstate(invalid="ignore"):
        shares = [m.r / np.maximum(m.norm, 1.0) for m in models]
    return np.asarray(np.max(np.where(np.isnan(shares), np.inf, shares), axis=0))
