"""After the solve: limits kept between the nodes, and a mesh fine enough for the true motion."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import INTERPOLANT, Look, excess, look
from planner.methods.collocation.long_arms.held import can_hold, chain_of, held
from planner.methods.collocation.task import Solution, Task, transferred
from planner.methods.collocation.transcription.bounds import everywhere
from planner.methods.collocation.transcription.form import Mesh
from planner.support import progress
from planner.support.deadline import TimeUpError, time_share
from planner.verification.verify import LIMIT_TOLERANCE

EVENNESS = 0.35
"""Least density of a refined mesh, relative to its greatest."""

LARGEST_MESH = 2000
TIGHTENING_TRIES = 6

REFINING = 0.6
"""Share of the time that is left which refining may take; then what there is by then is held."""

ELSEWHERE = 0.01
"""Share of the greatest excess over a limit by which it is drawn in where it is kept so far: a
motion that gives way in one place moves a little in all."""


@dataclass(frozen=True, eq=False)
class Polished:
    """A solution, the task it belongs to now, and what was done to it.

    Attributes:
        task: With its final mesh and limits drawn in.
        solution: The answer.
        error: Largest difference at the end between true motion and interpolant, over coordinates.
        inside: Whether limits are kept between the nodes too, as exactly as `verify` asks.
        notes: JSON-ready.
        iterations: Iterations of the solver.
    """

    task: Task
    solution: Solution
    error: float
    inside: bool
    notes: dict[str, Any]
    iterations: int


def polish(task: Task, solution: Solution, accuracy: float, refinements: int) -> Polished:
    """Refine the mesh until the re-simulated end is accurate, then draw limits in where needed.

    Limits drawn in move the motion, which may want a finer mesh then; so both are gone through
    until neither has anything to do, or the refinements are used up.

    Limits are kept between the edges by solving again with them at the collocation points too, then
    with limits drawn in by what is still broken, at first little elsewhere, then everywhere alike.
    A motion may give way by less than that, so that what is broken is drawn in twice in the second
    round, thrice in the third.

    Where time is up, what is refined by then is made a motion as
    `planner.methods.collocation.long_arms.held` does.
    """
    iterations, rounds, left, built = 0, 0, refinements, task.build_time_s
    meshes = [len(task.mesh.widths)]
    seen = look(task, solution)
    try:
        with time_share(REFINING):
            while True:
                while left > 0 and not seen.fine(accuracy):
                    progress.tell("refining the mesh")
                    own = task.on(_finer(task, seen, accuracy))
                    better = own.solve(transferred(task, solution.iterate, own), near=True)
                    iterations += better.iterations
                    built += own.build_time_s
                    left -= 1
                    if not better.ok:
                        left = 0
                        break
                    task, solution, seen = own, better, look(own, better)
                    meshes.append(len(task.mesh.widths))
                coarse = refinements > 0 and not seen.fine(accuracy)
                if coarse and (kept := _held(task, solution, accuracy)):
                    left = 0
                    (task, solution), seen = kept, look(*kept)
                    meshes.append(len(task.mesh.widths))
                rounds = tries = 0
                over = excess(task, seen.iterate, seen.curves)
                while over.any() and tries < TIGHTENING_TRIES:
                    progress.tell("keeping limits between the nodes")
                    tries += 1
                    if not task.made.form.inner:
                        own = task.inside()
                        built += own.build_time_s
                    else:
                        rounds += 1
                        more = everywhere(over, ELSEWHERE if rounds == 1 else 1.0, times=rounds)
                        own = replace(task, drawn=task.drawn + more)
                    better = own.solve_near(solution.iterate)
                    iterations += better.iterations
                    task = own
                    if not better.ok:
                        break
                    solution, seen = better, look(task, better)
                    over = excess(task, seen.iterate, seen.curves)
                if left == 0 or seen.fine(accuracy):
                    break
    except TimeUpError:
        with suppress(TimeUpError):
            task, solution = _held(task, solution, accuracy) or (task, solution)
        meshes.append(len(task.mesh.widths))
        seen = look(task, solution)
        over = excess(task, seen.iterate, seen.curves)
    parts = [part for required in task.held for part in required.parts]
    inside = bool((over <= LIMIT_TOLERANCE * np.array([part.scale for part in parts])).all())
    most = zip(parts, task.drawn.max(axis=0).tolist(), strict=True)
    drawn = {"rounds": rounds, **{part.label: amount for part, amount in most if amount}}
    inner = task.made.form.inner
    notes = {"intervals": meshes, "limits_inside": inner, "limits_drawn_in": drawn}
    task = replace(task, build_time_s=built)
    return Polished(task, solution, seen.end_error, inside, notes, iterations)


def _held(task: Task, solution: Solution, accuracy: float) -> tuple[Task, Solution] | None:
    """The path as it is, where no solver gets from it to the best of a finer mesh."""
    return held(task, chain_of(task, solution), accuracy) if can_hold(task) else None


def _finer(task: Task, seen: Look, accuracy: float) -> Mesh:
    """Intervals as dense as the errors ask for, at most three times as many, and evenly graded.

    The errors are those of the motion that begins with the interval. They shrink with its width to
    the power 2d - 1 at the nodes, all together, and d + 1 inside it. At the nodes they are weighed
    by what becomes of them at the end: ten thousand times as much where trailers are pushed, and at
    least what chance makes of so many. The next solution may move where this one rests, so that no
    interval is much wider than another.
    """
    d, widths = task.made.form.degree, task.mesh.widths
    own = np.abs(task.motion_apart(seen.iterate) - seen.curves[0]).max(axis=2)
    nodes = own[:, -1]
    growth = max(np.sqrt(len(widths)), seen.end_error / max(np.max(nodes), 1e-16))
    at_nodes = (nodes * growth / accuracy) ** (1 / (2 * d - 1))
    inside = (own.max(axis=1) / (INTERPOLANT * accuracy)) ** (1 / (d + 1))
    density = np.maximum(at_nodes, inside) / widths
    density = np.maximum(density, EVENNESS * np.max(density))
    wanted = int(np.ceil(1.1 * np.sum(density * widths)))
    count = min(max(wanted, len(widths) * 5 // 4), 3 * len(widths), LARGEST_MESH)
    covered = np.concatenate([[0.0], np.cumsum(density * widths)])
    edges = np.interp(np.linspace(0, covered[-1], count + 1), covered, task.mesh.edges)
    edges[0], edges[-1] = 0.0, 1.0
    return task.mesh.snapped(edges)
