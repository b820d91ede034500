"""Paths of long arms by way of shorter ones: rung by rung a joint is put in front.

The arm of the last few joints finds its path by the search for paths; each joint more is made to
drive what is behind it (`planner.methods.collocation.long_arms.ladder`), which always succeeds
where stretches are short. The path is then timed; one that is too long for a solver, or that it
cannot better, is kept as it is.

A path of an arm from a path of the arm without its first joint.

With joint 1 at rest at θ₁ the drive moves all joints after the second, and φ, cosθ₁ times as fast
as it does in the shorter arm, and θ₂ cos³θ₁ k₂ times as fast as u₁. So driving at two angles of
joint 1 in turn moves the shorter arm by any drive and any turn of its own first joint, whatever
their ratio: along any path of the shorter arm, as closely as the stretches are short.

Sources: the reduction of one stage at a time is that of Lafferriere and Sussmann, A differential
geometric approach to motion planning (Nonholonomic Motion Planning, Kluwer 1993).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.methods.collocation.candidates import seeds
from planner.methods.collocation.long_arms.bridges import (
    ChainEnds,
    Index,
    PieceChain,
    close_gaps,
    ends_of,
)
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    follow,
    has_only_limits,
)
from planner.methods.collocation.path import path_task, search, solve_timing
from planner.methods.collocation.solvers import LADDER_ITERATIONS, strategy
from planner.methods.collocation.task import (
    ACCEPTED_RESIDUAL,
    Solution,
    Task,
    stretch_to,
    task,
)
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.form import Form
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.support import progress
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

ENOUGH_PATHS = 6
"""Paths of the arm of the last joints that are enough."""

LARGEST_GAPS = (0.12, 0.05, 0.02)
"""Largest gaps, rad, that a joint in front may leave; smaller where only a part of them closes."""

MOST_SHORTENED = 5000
"""Most pieces of a path that is shortened."""

FREE_LIMIT_SHARE = 0.1
"""Share of the joint limits that is kept free a rung, for what the rungs above add. The best path
runs along its limits; with 0.02 what joint 1 adds broke them by 0.2 to 0.5 rad where joints have
40 degrees, and no nearest chain was left."""

MOST_SOLVED_INTERVALS = 300
"""Intervals beyond which a path is kept as it is."""


def find_arm_path(job: Task) -> tuple[PieceChain, int] | None:
    """A path within the joint limits, and the number of joints of the arm that it began with.

    z2, discs and waypoints are not looked at. None where the system is no arm, or there is none.
    """
    system = job.problem.system
    if not isinstance(system, Manipulator) or system.n < 3 or not has_only_limits(job):
        return None
    progress.tell("looking for a path by way of shorter arms")
    return _lift_shorter_path(job)


def time_arm_path(job: Task, chain: PieceChain, accuracy: float) -> tuple[Task, Solution] | None:
    """The motion along a path, its duration free, on the path's own mesh; None if there is none."""
    progress.tell("timing that path")
    own, path = follow(job, chain)
    solution = _solve_timing(own, path) if len(own.mesh.widths) <= MOST_SOLVED_INTERVALS else None
    if solution is None or not solution.ok:
        return exact_motion(job, chain, accuracy)
    return own, solution


def _solve_timing(own: Task, path: Iterate) -> Solution:
    """The path's timing; a last iterate that is a motion is one, if not the best."""
    settings = own.settings
    patient = replace(
        settings, max_iterations=max(settings.max_iterations, LADDER_ITERATIONS["timing"])
    )
    last = solve_timing(replace(own, settings=patient), path)
    if last.ok or last.residual > ACCEPTED_RESIDUAL:
        return last
    return replace(last, ok=True, status=f"{last.status} (a motion, not the best)")


def _lift_shorter_path(job: Task) -> tuple[PieceChain, int] | None:
    """The path, and the number of joints of the arm it began with."""
    problem = job.problem
    short = _shorter_arm_task(job)
    below = _search_path(short)
    if below is None and short.problem.system.size > 3:
        below = _lift_shorter_path(short)
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
    """The path, or the one of least effort next to it if that takes less driving and turning."""
    own, iterate = follow(job, path)
    if len(own.mesh.widths) > MOST_SHORTENED:
        return path
    settings = replace(own.settings, max_iterations=LADDER_ITERATIONS["shortening"])
    effort = path_task(replace(own, settings=settings))
    assert effort.problem.duration is not None
    found = effort.solve(stretch_to(iterate, effort.problem.duration))
    shorter, _ = close_gaps(job.problem.system, chain_of(effort, found), ends)
    return shorter if shorter is not None and _length(shorter) < _length(path) else path


def _length(path: PieceChain) -> float:
    return float(np.sum(np.max(np.abs(path.u), axis=1)))


def _search_path(job: Task) -> tuple[PieceChain, int] | None:
    """The shortest path that a few guesses lead to, as `_lift_shorter_path`.

    None too where it is a path on its coarse mesh only.
    """
    guesses = strategy(job.made, job.settings).guesses
    settings = replace(job.settings, max_iterations=LADDER_ITERATIONS["guess"])
    job = path_task(replace(job, settings=settings))
    *_, paths = search(job, seeds("auto", guesses), ENOUGH_PATHS, simple=True)
    if not paths.solved:
        return None
    system, coarse = job.problem.system, chain_of(job, paths.distinct[0].solution)
    chain, _ = close_gaps(system, coarse, ChainEnds.of(job.problem))
    return None if chain is None else (chain, system.size - 1)


def _shorter_arm_task(job: Task) -> Task:
    """The job of the arm without its first joint."""
    problem, form = job.problem, job.made.form
    assert isinstance(problem.system, Manipulator)
    start, goal = (np.delete(q, 1) for q in (problem.start, problem.goal))
    joint = np.delete(ChainEnds.of(problem, 1 - FREE_LIMIT_SHARE).limit, 1)
    limits = replace(problem.limits, joint=joint, user=joint)
    given = replace(problem, start=start, goal=goal, user_goal=goal, limits=limits)
    short = replace(given, system=problem.system.shorter())
    plain = Form(form.intervals, form.scheme_kind, form.degree)
    return task(short, job.objective, plain, job.mesh, InputDemands(), job.settings)


OTHER_ANGLE = np.deg2rad(60.0)
"""The other angle of joint 1, beside zero: near it the sum of drives and turns is least."""

LONGEST_STRETCH, HALVINGS = 0.8, 12
"""Longest stretch, turn and drive added, rad, and times that it may be halved."""

NEGLIGIBLE_RAD = 1e-9
"""Turns and drives, rad, that are left out."""


def lift(system: Manipulator, path: PieceChain, ends: ChainEnds, gap: float) -> PieceChain:
    """The path of joints 2 … n, made by all of them; with gaps.

    Args:
        system: The arm, n ≥ 3.
        path: Of `system.shorter()`.
        ends: Of the arm.
        gap: Largest gap, rad, that is left, and four times what limits may be broken by; where
            either is larger, stretches are cut in half.
    """
    known = np.append(0.0, np.cumsum(np.sum(np.abs(path.u), axis=1)))
    edges = np.linspace(0.0, known[-1], 1 + max(1, int(np.ceil(known[-1] / LONGEST_STRETCH))))
    for _ in range(HALVINGS):
        chain, stretch = _lifted_chain(system, path, known, ends, edges)
        missed = np.max(np.abs(chain.gap), axis=1)
        over = np.max(np.abs(chain.q[1:] - chain.gap) - ends.limit, axis=1)
        wide = np.zeros(len(edges) - 1, dtype=bool)
        np.logical_or.at(wide, stretch, np.maximum(missed, 4 * over) > gap)
        if not np.any(wide):
            break
        edges = np.sort(np.concatenate([edges, (edges[:-1] + edges[1:])[wide] / 2]))
    return chain


def _lifted_chain(
    system: Manipulator, path: PieceChain, known: Array, ends: ChainEnds, edges: Array
) -> tuple[PieceChain, Index]:
    """The chain for stretches between these lengths of path, and the stretch of each piece.

    `known` are the lengths at the path's own nodes.
    """
    places, moves = _stretches(system.shorter(), path, known, edges)
    u, before = _drives(system, moves, ends)
    q = np.insert(places, 1, before, axis=1)
    last = np.insert(places[-1], 1, ends.goal[1])
    return _pieces(system, q, u, last)


def _stretches(
    short: Manipulator, path: PieceChain, known: Array, edges: Array
) -> tuple[Array, Array]:
    """Places between the stretches, (S+1, n), drive and turn in each, (S, 2)."""
    sums = np.vstack([np.zeros(2), np.cumsum(path.u, axis=0)])
    at = np.stack([np.interp(edges, known, column) for column in sums.T], axis=-1)
    piece = np.clip(np.searchsorted(known, edges[:-1], side="right") - 1, 0, len(path.u) - 1)
    places = ends_of(short, path.q[piece], at[:-1] - sums[piece])
    return np.vstack([places, path.q[-1]]), np.diff(at, axis=0)


def _drives(system: Manipulator, moves: Array, ends: ChainEnds) -> tuple[Array, Array]:
    """Turn, drive, turn and drive in each stretch, shape (S+1, 4, 2), and θ₁ before each.

    The last entry is the turn to the goal.
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
    """Angles of joint 1 and drives at them, the nearer angle first.

    Σ xₖ cosαₖ = drive and Σ xₖ cos³αₖ = turn; one angle does where the ratio allows.
    """
    least = np.cos(other) ** 2
    if least * drive**2 <= turn * drive <= drive**2 and drive:
        share = np.sqrt(turn / drive)
        return [(float(np.copysign(np.arccos(share), other)), drive / share)]
    far = (drive - turn) / (np.cos(other) * (1 - least))
    both = [(0.0, drive - far * np.cos(other)), (other, far)]
    return both if abs(angle) < abs(other) / 2 else both[::-1]


def _pieces(system: Manipulator, q: Array, u: Array, last: Array) -> tuple[PieceChain, Index]:
    """One piece for each turn and drive; what lies between it and the next place is a gap."""
    before = [q]
    for part in range(u.shape[1] - 1):
        before.append(ends_of(system, before[-1], u[:, part]))
    kept = np.max(np.abs(u), axis=2) > NEGLIGIBLE_RAD
    at, moved = np.stack(before, axis=1)[kept], u[kept]
    nodes = np.vstack([at, last])
    stretch = np.minimum(np.nonzero(kept)[0], len(u) - 2)
    return PieceChain(nodes, moved, nodes[1:] - ends_of(system, at, moved)), stretch
