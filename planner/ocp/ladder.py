"""Paths of long arms by way of shorter ones: rung by rung a joint is put in front.

The arm of the last few joints finds its path by the search for paths; each joint more is made to
drive what is behind it (`planner.bridge.lift`), which always succeeds where stretches are short.
The path is then timed; one that is too long for a solver, or that it cannot better, is kept as it
is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner import progress
from planner.bridge import lifted
from planner.bridge.closing import Chain, Ends, closed
from planner.ocp.backends import RUNGS, way
from planner.ocp.bounds import Asked
from planner.ocp.form import Form
from planner.ocp.guess import seeds
from planner.ocp.held import can_hold, chain_of, follow, held
from planner.ocp.layout import Iterate
from planner.ocp.search import path_task, search
from planner.ocp.solver import ACCEPTED_RESIDUAL
from planner.ocp.task import Task, offer_chain, stretched, task
from planner.ocp.timing import Timed, hasty, timed
from planner.systems.manipulator import Manipulator

ENOUGH = 6
"""Paths of the arm of the last joints that are enough."""

GAPS = (0.12, 0.05, 0.02)
"""Largest gaps, rad, that a joint in front may leave; smaller where only a part of them closes."""

MOST_SHORTENED = 5000
"""Most pieces of a path that is shortened."""

DRAWN_IN = 0.02
"""Share of the joint limits that is kept free a rung, for what the rungs above add."""

MOST_SOLVED = 300
"""Intervals beyond which a path is kept as it is."""


@dataclass(frozen=True, eq=False)
class Climbed:
    """A path by way of shorter arms, and what its timing made of it.

    Attributes:
        name: For reports.
        task: The job on the path's own mesh.
        timed: The outcome.
    """

    name: str
    task: Task
    timed: Timed


def climbed(job: Task, accuracy: float) -> Climbed | None:
    """A motion within all limits; None where the system is no arm, or there is none.

    z2, discs and waypoints are not looked at.
    """
    system = job.problem.system
    if not isinstance(system, Manipulator) or system.n < 3 or not can_hold(job):
        return None
    progress.tell("looking for a path by way of shorter arms")
    found = _by_shorter(job)
    if found is None:
        return None
    chain, joints = found
    offer_chain(job, chain)
    progress.tell("timing that path")
    own, path = follow(job, chain)
    outcome = _timed(own, path) if len(own.mesh.widths) <= MOST_SOLVED else None
    if outcome is None or not outcome.solution.ok:
        own, outcome = _as_it_is(job, chain, accuracy) or (own, outcome)
    if outcome is None:
        return None
    return Climbed(f"lifted from {joints} joints", own, outcome)


def _timed(own: Task, path: Iterate) -> Timed:
    """The path's timing; a last iterate that is a motion is one, if not the best."""
    settings = own.settings
    patient = replace(settings, max_iterations=max(settings.max_iterations, RUNGS["timing"]))
    outcome = timed(replace(own, settings=patient), path)
    last = outcome.solution
    if last.ok or last.residual > ACCEPTED_RESIDUAL:
        return outcome
    status = f"{last.status} (a motion, not the best)"
    return replace(outcome, solution=replace(last, ok=True, status=status))


def _as_it_is(job: Task, chain: Chain, accuracy: float) -> tuple[Task, Timed] | None:
    """The path kept, or where the duration asked for is too short for it, that and the fastest."""
    kept = held(job, chain, accuracy)
    if kept is not None:
        return kept[0], Timed(kept[1], None)
    kept = held(hasty(job), chain, accuracy) if job.problem.duration else None
    if kept is None:
        return None
    own = kept[0].asking(job.problem, job.objective)
    return own, Timed(replace(kept[1], ok=False), kept[1])


def _by_shorter(job: Task) -> tuple[Chain, int] | None:
    """The path, and the number of joints of the arm it began with."""
    problem = job.problem
    below = _path(_below(job))
    if below is None:
        return None
    path, joints = below
    assert isinstance(problem.system, Manipulator)
    ends = Ends.of(problem)
    for gap in GAPS:
        whole, share = closed(problem.system, lifted(problem.system, path, ends, gap), ends)
        if whole is not None:
            return _shortened(job, whole, ends), joints
        if share == 0:
            break
    return None


def _shortened(job: Task, path: Chain, ends: Ends) -> Chain:
    """The path, or the one of least effort next to it if that takes less driving and turning."""
    own, iterate = follow(job, path)
    if len(own.mesh.widths) > MOST_SHORTENED:
        return path
    settings = replace(own.settings, max_iterations=RUNGS["shortening"])
    effort = path_task(replace(own, settings=settings))
    assert effort.problem.duration is not None
    found = effort.solve(stretched(iterate, effort.problem.duration))
    shorter, _ = closed(job.problem.system, chain_of(effort, found), ends)
    return shorter if shorter is not None and _length(shorter) < _length(path) else path


def _length(path: Chain) -> float:
    return float(np.sum(np.max(np.abs(path.u), axis=1)))


def _path(job: Task) -> tuple[Chain, int] | None:
    found = _searched(job)
    if found is not None:
        return found
    return _by_shorter(job) if job.problem.system.size > 3 else None


def _searched(job: Task) -> tuple[Chain, int] | None:
    """The shortest path that a few guesses lead to, as `_by_shorter`.

    None too where it is a path on its coarse mesh only.
    """
    guesses = way(job.made, job.settings).guesses
    settings = replace(job.settings, max_iterations=RUNGS["guess"])
    job = path_task(replace(job, settings=settings))
    paths = search(job, seeds("auto", guesses), ENOUGH, simple=True)
    if not paths.found:
        return None
    system, coarse = job.problem.system, chain_of(job, paths.found[0].solution)
    chain, _ = closed(system, coarse, Ends.of(job.problem))
    return None if chain is None else (chain, system.size - 1)


def _below(job: Task) -> Task:
    """The job of the arm without its first joint."""
    problem, form = job.problem, job.made.form
    assert isinstance(problem.system, Manipulator)
    start, goal = (np.delete(q, 1) for q in (problem.start, problem.goal))
    joint = np.delete(Ends.of(problem, 1 - DRAWN_IN).limit, 1)
    limits = replace(problem.limits, joint=joint)
    short = replace(problem, system=problem.system.shorter(), start=start, goal=goal, limits=limits)
    plain = Form(form.intervals, form.scheme_kind, form.degree)
    return task(short, job.objective, plain, job.mesh, Asked(), job.settings)
