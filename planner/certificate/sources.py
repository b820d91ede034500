"""A trajectory's inputs as balls on cells fine enough, for each kind of trajectory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from planner.certificate.balls import Ball
from planner.certificate.cells import Cells, on
from planner.certificate.composed import at, clocked
from planner.certificate.evaluate import Expression, UnboundedError
from planner.certificate.model import Index
from planner.certificate.motion import Motion, enclose
from planner.chained import chained_form
from planner.retimed import RetimedTrajectory
from planner.systems.base import Array, TriangularSystem
from planner.trajectory import ChainedTrajectory, StateTrajectory, Trajectory

FINE = 1e-10
"""Remainder of inputs and rates, relative to their size or one, below which a cell is kept."""

NOISE = 1e-3
"""Remainder below which a cell hardly better than its parent is kept: the rest is rounding."""

FEWEST_CELLS = 4
COARSE = 1e-4
"""Remainder above which a cell is divided in four at once."""

MOST_CELLS = 1500


@dataclass(frozen=True, eq=False)
class Source:
    """Inputs of a trajectory that balls can bound.

    Attributes:
        trajectory: Whose they are.
        inputs: From cells to balls of u₁ and u₂.
        slopes: From cells to balls of du₁/dt and du₂/dt.
        halvings: Times a cell may be halved. Near a singularity halving reaches what can be
            bounded; near a standstill of a retimed path it only narrows what cannot.
    """

    trajectory: Trajectory
    inputs: Callable[[Cells], list[Ball]]
    slopes: Callable[[Cells], list[Ball]]
    halvings: int = 24


def source_of(trajectory: Trajectory) -> Source:
    """The inputs of a trajectory of states or of chained coordinates.

    Raises:
        UnboundedError: If the trajectory is of another kind, or its chart has no expression.
    """
    if type(trajectory) is StateTrajectory:  # a subclass may evaluate in its own way
        curve = trajectory.u_curve
        return Source(trajectory, lambda c: on(curve, c), lambda c: on(curve, c, 1))
    if type(trajectory) is ChainedTrajectory:
        return _chained(trajectory)
    if type(trajectory) is RetimedTrajectory:
        return _retimed(trajectory)
    raise UnboundedError(f"trajectories of kind '{trajectory.kind}'")


def _chained(path: ChainedTrajectory) -> Source:
    inputs, rates = _feedback_of(path)
    z, v = path.z_curve, path.v_curve

    def curves(cells: Cells) -> list[list[Ball]]:
        return [on(z, cells), on(v, cells)]

    return Source(
        path,
        lambda cells: inputs(*curves(cells)),
        lambda cells: rates(*curves(cells), on(z, cells, 1), on(v, cells, 1)),
    )


def _retimed(trajectory: RetimedTrajectory) -> Source:
    path = trajectory.path

    def inputs(cells: Cells, sigma: Ball) -> list[Ball]:
        if isinstance(path, StateTrajectory):
            return at(path.u_curve, 0, trajectory, cells, sigma)
        return _feedback_of(path)[0](*_curves(path, (0,), trajectory, cells, sigma))

    def bends(cells: Cells, sigma: Ball) -> list[Ball]:
        if isinstance(path, StateTrajectory):
            return at(path.u_curve, 1, trajectory, cells, sigma)
        return _feedback_of(path)[1](*_curves(path, (0, 1), trajectory, cells, sigma))

    def paced(cells: Cells) -> list[Ball]:
        own = clocked(trajectory, cells)
        return [u * own.pace for u in inputs(cells, own.sigma)]

    def rated(cells: Cells) -> list[Ball]:
        own = clocked(trajectory, cells)
        pairs = zip(inputs(cells, own.sigma), bends(cells, own.sigma), strict=True)
        return [du * own.pace * own.pace + u * own.bend for u, du in pairs]

    if isinstance(path, RetimedTrajectory):
        raise UnboundedError("a path that is retimed twice")
    return Source(trajectory, paced, rated, halvings=8)


def _feedback_of(path: Trajectory) -> tuple[Expression, Expression]:
    assert isinstance(path, ChainedTrajectory)
    return _feedback(path.system, tuple(path.branch.tolist()))


def _curves(
    path: Trajectory, orders: Sequence[int], by: RetimedTrajectory, cells: Cells, sigma: Ball
) -> list[list[Ball]]:
    """z and v, then their derivatives if asked for, at balls of the path's own time."""
    assert isinstance(path, ChainedTrajectory)
    return [at(c, k, by, cells, sigma) for k in orders for c in (path.z_curve, path.v_curve)]


@lru_cache(maxsize=32)
def _feedback(system: TriangularSystem, branch: tuple[float, ...]) -> tuple[Expression, Expression]:
    """u of (z, v), and du/dt of (z, v, ż, v̇), on one branch."""
    n = system.size
    z, v, dz, dv = (ca.SX.sym(name, k) for name, k in (("z", n), ("v", 2), ("dz", n), ("dv", 2)))
    u = chained_form(system).inputs_expr(z, v, ca.DM(branch))
    if u is None:
        raise UnboundedError(f"the inverse chart of system '{system.kind}', which is numerical")
    return Expression([z, v], u), Expression(
        [z, v, dz, dv], ca.jtimes(u, z, dz) + ca.jtimes(u, v, dv)
    )


@lru_cache(maxsize=32)
def inverse_of(system: TriangularSystem, branch: tuple[float, ...]) -> Expression:
    """q of z on one branch, for systems whose `source_of` exists."""
    z = ca.SX.sym("z", system.size)
    return Expression([z], chained_form(system).q_expr(z, ca.DM(branch)))


def resolve(source: Source, start: Array | None = None) -> Motion:
    """Inputs on cells where they are known to rounding, or as fine as may be.

    Args:
        source: Of the inputs.
        start: With it also the motion from there, whose rates must be known as well.
    """
    cells = Cells.of(source.trajectory.breaks)
    if len(cells.piece) < FEWEST_CELLS:
        cells, _ = cells.split(np.full(len(cells.piece), 4))
    u, before = source.inputs(cells), np.full(len(cells.piece), np.inf)
    for _ in range(source.halvings):
        bad, rough = _unsettled(u, before)
        motion = Motion(cells, [], u)
        if start is not None and not np.any(bad):
            motion = enclose(source.trajectory, cells, u, start)
            bad, rough = _unsettled(motion.rates, before)
        if not np.any(bad) or len(bad) + np.sum(bad) > MOST_CELLS:
            break
        cells, origin = cells.split(np.where(bad, np.where(rough > COARSE, 4, 2), 1))
        fresh, before = bad[origin], np.where(bad, rough, np.inf)[origin]
        new = source.inputs(cells.only(fresh))
        u = [old.updated(origin, fresh, x) for old, x in zip(u, new, strict=True)]
    return motion


def _unsettled(balls: list[Ball], before: Array) -> tuple[Index, Array]:
    """Which cells should be divided, and how rough they are; before is what they were."""
    rough = np.max([x.rough for x in balls], axis=0)
    fine = (rough <= FINE) | ((rough < NOISE) & (rough > 0.5 * before))
    return ~fine, rough
