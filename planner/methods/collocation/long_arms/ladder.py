"""Paths of long arms from paths of shorter arms: each step ("rung") adds a joint in front.

The usual search finds a path for the arm of the last few joints. Then each further joint is made to
drive the joints behind it, which always succeeds if the path is cut into short enough stretches.
The path is then timed. A path that is too long for a solver, or that the solver cannot improve, is
used unchanged.

One rung turns a path of the arm without its first joint into a path of the arm. With joint 1 at
rest at θ₁ the drive moves φ and all joints after the second cosθ₁ times as fast as in the shorter
arm, and θ₂ cos³θ₁ k₂ times as fast as u₁. So driving at two angles of joint 1 in turn moves the
shorter arm by any drive and any turn of its own first joint, in any ratio: it follows any path of
the shorter arm, the more closely the shorter the stretches are.


Source of the reduction of one stage at a time: Lafferriere and Sussmann, A differential
geometric approach to motion planning (Nonholonomic Motion Planning, Kluwer 1993).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.methods.collocation.guesses import seeds
from planner.methods.collocation.long_arms.bridges import (
    ChainEnds,
    Index,
    PieceChain,
    close_gaps,
    ends_of,
)
from planner.methods.collocation.long_arms.exact_motion import chain_of, follow, has_only_limits
from planner.methods.collocation.path import Enough, path_task, search, solve_timing
from planner.methods.collocation.solvers import LADDER_ITERATIONS, strategy
from planner.methods.collocation.task import ACCEPTED_RESIDUAL, Solution, Task, stretch_to, task
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.form import Form
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.support import progress
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

ENOUGH_PATHS = 6
"""Number of paths to find for the arm of the last joints."""

LARGEST_GAPS = (0.12, 0.05, 0.02)
"""Largest gaps that a joint in front may leave, rad, tried in turn until the gaps close."""

MAX_PIECES = 5000
"""Largest number of intervals of a path that is shortened."""

FREE_LIMIT_SHARE = 0.1
"""Share of the joint limits that each rung leaves free for the motions that later rungs add. With
0.02 the motions of joint 1 broke limits of 40 degrees by 0.2 to 0.5 rad."""

MOST_SOLVED_INTERVALS = 300
"""Largest number of intervals of a path that is optimised."""


def has_ladder(job: Task) -> bool:
    """Return whether `find_arm_path` serves a task: it is of an arm of at least three joints, and
    has only limits on joints and inputs (see `has_only_limits`)."""
    system = job.problem.system
    return isinstance(system, Manipulator) and system.n >= 3 and has_only_limits(job)


def find_arm_path(job: Task) -> tuple[PieceChain, int] | None:
    """Find a path by way of shorter arms; return the path and the shortest arm's number of joints.

    The result is None if no path is found, or if `has_ladder` is False.
    """
    if not has_ladder(job):
        return None
    progress.tell("looking for a path by way of shorter arms")
    return lift_shorter_path(job)


def time_arm_path(job: Task, chain: PieceChain) -> tuple[Task, Solution] | None:
    """Return a task on the path's mesh, and the best motion near the path.

    The result is None if the path has more intervals than `MOST_SOLVED_INTERVALS`, or if no motion
    is found.
    """
    progress.tell("timing that path")
    path_job, path = follow(job, chain)
    if len(path_job.mesh.widths) > MOST_SOLVED_INTERVALS:
        return None
    solution = _solve_timing(path_job, path)
    return (path_job, solution) if solution.ok else None


def _solve_timing(job: Task, path: Iterate) -> Solution:
    """Solve the timing of a path; a last iterate that is a motion also counts as a solution."""
    most = max(job.settings.max_iterations, LADDER_ITERATIONS["timing"])
    patient = replace(job.settings, max_iterations=most)
    last = solve_timing(replace(job, settings=patient), path)
    if last.ok or last.residual > ACCEPTED_RESIDUAL:
        return last
    return replace(last, ok=True, status=f"{last.status} (a motion, not the best)")


def lift_shorter_path(job: Task) -> tuple[PieceChain, int] | None:
    """Find a path of an arm from a path of the arm without its first joint.

    The shorter arm's path is searched from guesses or else, in the same way, found from a path of
    an even shorter arm.

    Returns:
        The path, and the number of joints of the arm whose path was searched; or None.
    """
    problem = job.problem
    short = _shorter_arm_task(job)
    below = _search_path(short)
    if below is None and short.problem.system.size > 3:
        below = lift_shorter_path(short)
    if below is None:
        return None
    path, joints = below
    assert isinstance(problem.system, Manipulator)
    ends = ChainEnds.of(problem)
    for gap in LARGEST_GAPS:
        whole, share = close_gaps(problem.system, lift(problem.system, path, ends, gap), ends)
        if whole is not None:
            return _shorten(job, whole, ends), joints
        if share == 0:
            break
    return None


def _shorten(job: Task, path: PieceChain, ends: ChainEnds) -> PieceChain:
    """Return the path of least effort near a path if it is shorter, else the given path."""
    path_job, iterate = follow(job, path)
    if len(path_job.mesh.widths) > MAX_PIECES:
        return path
    settings = replace(path_job.settings, max_iterations=LADDER_ITERATIONS["shortening"])
    effort = path_task(replace(path_job, settings=settings))
    assert effort.problem.duration is not None
    solution = effort.solve(stretch_to(iterate, effort.problem.duration))
    shorter, _ = close_gaps(job.problem.system, chain_of(effort, solution), ends)
    return shorter if shorter is not None and _length(shorter) < _length(path) else path


def _length(path: PieceChain) -> float:
    return float(np.sum(np.max(np.abs(path.u), axis=1)))


def _search_path(job: Task) -> tuple[PieceChain, int] | None:
    """Return the shortest path found from a few guesses, and the arm's number of joints.

    The result is None if no path is found, or if the gaps of its coarse mesh cannot be closed.
    """
    guesses = strategy(job.nlp, job.settings).guesses
    settings = replace(job.settings, max_iterations=LADDER_ITERATIONS["guess"])
    job = path_task(replace(job, settings=settings))
    paths = search(job, seeds("auto", guesses), Enough(ENOUGH_PATHS, simple=True))
    if not paths.solved:
        return None
    system, coarse = job.problem.system, chain_of(job, paths.distinct[0].solution)
    chain, _ = close_gaps(system, coarse, ChainEnds.of(job.problem))
    return None if chain is None else (chain, system.size - 1)


def _shorter_arm_task(job: Task) -> Task:
    """Return the task of the arm without its first joint, with the same ends and tighter limits."""
    problem, form = job.problem, job.nlp.form
    assert isinstance(problem.system, Manipulator)
    start, goal = (np.delete(q, 1) for q in (problem.start, problem.goal))
    joint = np.delete(ChainEnds.of(problem, 1 - FREE_LIMIT_SHARE).limit, 1)
    keys = problem.limits.joint_keys[1:]
    limits = replace(problem.limits, joint=joint, user=joint, joint_keys=keys, user_keys=keys)
    given = replace(problem, start=start, user_goal=goal, limits=limits)
    short = replace(given, system=problem.system.shorter())
    plain = Form(form.intervals, form.scheme_kind, form.degree)
    return task(short, job.objective, plain, job.mesh, InputDemands(), job.settings)


OTHER_ANGLE = np.deg2rad(60.0)
"""Second angle of joint 1 at which the drive turns, besides zero, rad; here its ways are least."""

LONGEST_STRETCH, HALVINGS = 0.8, 12
"""Largest |drive| + |turn of joint 1| in a stretch of the shorter path, rad; most halvings."""

NEGLIGIBLE_RAD = 1e-9
"""Size, rad, below which a turn or a drive is left out."""


def lift(system: Manipulator, path: PieceChain, ends: ChainEnds, gap: float) -> PieceChain:
    """Return a path of all n joints, with gaps, along which joints 2 … n follow a given path.

    Args:
        system: The arm, n ≥ 3.
        path: The path of `system.shorter()`.
        ends: Ends and limits of the arm.
        gap: Largest gap to leave, rad; limits may be exceeded by a quarter of this gap. Stretches
            with a larger gap or excess are halved.
    """
    length = np.append(0.0, np.cumsum(np.sum(np.abs(path.u), axis=1)))
    edges = np.linspace(0.0, length[-1], 1 + max(1, int(np.ceil(length[-1] / LONGEST_STRETCH))))
    for _ in range(HALVINGS):
        places, moves = _stretches(system.shorter(), path, length, edges)
        u, before = _drives(system, moves, ends)
        q, last = np.insert(places, 1, before, axis=1), np.insert(places[-1], 1, ends.goal[1])
        chain, stretch = _pieces(system, q, u, last)
        missed = np.max(np.abs(chain.gap), axis=1)
        excess = np.max(np.abs(chain.q[1:] - chain.gap) - ends.limit, axis=1)
        wide = np.zeros(len(edges) - 1, dtype=bool)
        np.logical_or.at(wide, stretch, np.maximum(missed, 4 * excess) > gap)
        if not np.any(wide):
            break
        edges = np.sort(np.concatenate([edges, (edges[:-1] + edges[1:])[wide] / 2]))
    return chain


def _stretches(
    short: Manipulator, path: PieceChain, length: Array, edges: Array
) -> tuple[Array, Array]:
    """Return the coordinates between S stretches, (S+1, n), and drive and turn in each, (S, 2)."""
    sums = np.vstack([np.zeros(2), np.cumsum(path.u, axis=0)])
    values = np.stack([np.interp(edges, length, column) for column in sums.T], axis=-1)
    piece = np.clip(np.searchsorted(length, edges[:-1], side="right") - 1, 0, len(path.u) - 1)
    places = ends_of(short, path.q[piece], values[:-1] - sums[piece])
    return np.vstack([places, path.q[-1]]), np.diff(values, axis=0)


def _drives(system: Manipulator, moves: Array, ends: ChainEnds) -> tuple[Array, Array]:
    """Return the inputs (turn, drive, turn, drive) of each stretch, (S+1, 4, 2), and θ₁ before it.

    The last entry of the inputs is the turn to the goal. θ₁ has the shape (S+1,).
    """
    angle, out = ends.start[1], np.zeros((len(moves) + 1, 4, 2))
    before = np.empty(len(moves) + 1)
    rate = system.k_g * system.K[0]
    other = min(OTHER_ANGLE, 0.9 * ends.limit[1]) * (np.copysign(1.0, angle))
    for k, (drive, turn) in enumerate(moves):
        before[k] = angle
        for part, (at, driven) in enumerate(_angles_and_drives(drive, turn / rate, angle, other)):
            out[k, 2 * part, 1], out[k, 2 * part + 1, 0] = at - angle, driven
            angle = at
    before[-1], out[-1, 0, 1] = angle, ends.goal[1] - angle
    return out, before


def _angles_and_drives(
    drive: float, turn: float, angle: float, other: float
) -> list[tuple[float, float]]:
    """Return angles αₖ of joint 1 with a drive xₖ at each, the nearer angle first.

    Angles and drives satisfy Σ xₖ cosαₖ = drive and Σ xₖ cos³αₖ = turn; one angle is enough if the
    ratio of turn to drive allows.
    """
    least = np.cos(other) ** 2
    if least * drive**2 <= turn * drive <= drive**2 and drive:
        share = np.sqrt(turn / drive)
        return [(float(np.copysign(np.arccos(share), other)), drive / share)]
    far = (drive - turn) / (np.cos(other) * (1 - least))
    both = [(0.0, drive - far * np.cos(other)), (other, far)]
    return both if abs(angle) < abs(other) / 2 else both[::-1]


def _pieces(system: Manipulator, q: Array, u: Array, last: Array) -> tuple[PieceChain, Index]:
    """Make a chain with a piece for each turn and drive; return also the stretch of each piece."""
    before = [q]
    for part in range(u.shape[1] - 1):
        before.append(ends_of(system, before[-1], u[:, part]))
    kept = np.max(np.abs(u), axis=2) > NEGLIGIBLE_RAD
    at, moved = np.stack(before, axis=1)[kept], u[kept]
    nodes = np.vstack([at, last])
    stretch = np.minimum(np.nonzero(kept)[0], len(u) - 2)
    return PieceChain(nodes, moved, nodes[1:] - ends_of(system, at, moved)), stretch
