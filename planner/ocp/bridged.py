"""Motions grown from paths that keep the kinematics, where no first guess leads anywhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from planner.bridge import Bridge, bridges
from planner.ocp.held import can_hold, follow, held
from planner.ocp.ladder import climbed
from planner.ocp.layout import Iterate
from planner.ocp.solver import ACCEPTED_RESIDUAL, Solution
from planner.ocp.task import Task
from planner.ocp.timing import Timed, hasty, timed

PATIENCE = 400
"""Iterations granted at least: the paths are long, and the start is already a motion."""

MOST_SOLVED = 300
"""Intervals beyond which a path is kept as it is."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """A path and what its timing made of it.

    Attributes:
        name: For reports.
        task: The job on the path's own mesh.
        timed: The outcome.
        iterations: Iterations of all solvers, those that closed the path's gaps included.
    """

    name: str
    task: Task
    timed: Timed
    iterations: int


def crossings(job: Task, attempts: int, accuracy: float) -> Iterator[Crossing]:
    """Timed motions along a path by way of shorter arms, then along random ones, as they are found.

    A path that is too long for a solver, or that it cannot better, is kept as it is.
    """
    for bridge in _paths(job, attempts):
        own, path = follow(job, bridge.chain)
        outcome = None
        if len(own.mesh.widths) <= MOST_SOLVED or not can_hold(job):
            outcome = _timed(own, path)
        if (outcome is None or not outcome.solution.ok) and can_hold(job):
            own, outcome = _as_it_is(job, bridge, accuracy) or (own, outcome)
        if outcome is not None:
            yield Crossing(bridge.name, own, outcome, bridge.iterations + outcome.iterations)


def _paths(job: Task, attempts: int) -> Iterator[Bridge]:
    lifted = climbed(job)
    if lifted is not None:
        yield lifted
    yield from bridges(job.problem, attempts)


def _as_it_is(job: Task, bridge: Bridge, accuracy: float) -> tuple[Task, Timed] | None:
    """The path kept, or where the duration asked for is too short for it, that and the fastest."""
    kept = held(job, bridge.chain, accuracy)
    if kept is not None:
        return kept[0], Timed(kept[1], None, 0)
    kept = held(hasty(job), bridge.chain, accuracy) if job.problem.duration else None
    if kept is None:
        return None
    own = kept[0].asking(job.problem, job.objective)
    return own, Timed(replace(kept[1], ok=False), kept[1], 0)


def _timed(own: Task, path: Iterate) -> Timed:
    settings = own.settings
    patience = max(settings.max_iterations, PATIENCE)
    solver = "ipopt" if settings.solver == "auto" else settings.solver
    patient = replace(settings, max_iterations=patience, solver=solver)
    outcome = timed(replace(own, settings=patient), path)
    return replace(outcome, solution=_kept(outcome.solution))


def _kept(solution: Solution) -> Solution:
    if solution.ok or solution.residual > ACCEPTED_RESIDUAL:
        return solution
    return replace(solution, ok=True, status=f"{solution.status} (a motion, not the best)")
