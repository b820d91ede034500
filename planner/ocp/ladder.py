"""Paths of long arms by way of shorter ones: rung by rung a joint is put in front.

The arm of the last few joints finds its path by the search for paths; each joint more is made to
drive what is behind it (`planner.bridge.lift`), which always succeeds where stretches are short.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.bridge import Bridge, lifted
from planner.bridge.closing import Chain, Ends, closed
from planner.ocp.backends import SHORT_CHAIN
from planner.ocp.form import Form
from planner.ocp.guess import seeds
from planner.ocp.held import chain_of, follow
from planner.ocp.improve import FINEST, Motion, improved
from planner.ocp.search import path_task, search
from planner.ocp.task import Task, stretched, task
from planner.systems.manipulator import Manipulator

GUESSES, ITERATIONS, ENOUGH = 16, 300, 6
"""Guesses for the arm of the last joints, iterations granted to each, and paths that are enough."""

VARIATIONS = 20
"""Variations of its path: each turn of it costs the arms above many."""

GAPS = (0.12, 0.05, 0.02)
"""Largest gaps, rad, that a joint in front may leave; smaller where they cannot be closed."""

MOST_SHORTENED, SHORTENING = 5000, 100
"""Most pieces of a path that is shortened, and iterations granted for it."""

DRAWN_IN = 0.02
"""Share of the joint limits that is kept free a rung, for what the rungs above add."""


def climbed(job: Task) -> Bridge | None:
    """A path within the joint limits, or None where the system is no arm or there is none.

    Limits on inputs are left to the timing; z₂, discs and waypoints are not looked at.
    """
    system = job.problem.system
    if not isinstance(system, Manipulator) or system.n < 3:
        return None
    found = _by_shorter(job)
    return None if found is None else Bridge(f"lifted from {found[2]} joints", *found[:2])


def _by_shorter(job: Task) -> tuple[Chain, int, int] | None:
    """The path, iterations and the number of joints of the arm it began with."""
    problem = job.problem
    below = _path(_below(job))
    if below is None:
        return None
    path, iterations, joints = below
    assert isinstance(problem.system, Manipulator)
    ends = Ends.of(problem)
    for gap in GAPS:
        whole, made = closed(problem.system, lifted(problem.system, path, ends, gap), ends, 1.0)
        iterations += made
        if whole is not None:
            return _shortened(job, whole, ends), iterations, joints
    return None


def _shortened(job: Task, path: Chain, ends: Ends) -> Chain:
    """The path, or the one of least effort next to it if that takes less driving and turning."""
    own, iterate = follow(job, path)
    if len(own.mesh.widths) > MOST_SHORTENED:
        return path
    settings = replace(own.settings, max_iterations=SHORTENING, solver="ipopt")
    effort = path_task(replace(own, settings=settings))
    assert effort.problem.duration is not None
    found = effort.solve(stretched(iterate, effort.problem.duration))
    shorter, _ = closed(job.problem.system, chain_of(effort, found), ends, 1.0)
    return shorter if shorter is not None and _length(shorter) < _length(path) else path


def _length(path: Chain) -> float:
    return float(np.sum(np.max(np.abs(path.u), axis=1)))


def _path(job: Task) -> tuple[Chain, int, int] | None:
    size = job.problem.system.size
    found = _searched(job) if size <= SHORT_CHAIN else None
    if found is not None:
        return found
    return _by_shorter(job) if size > 3 else None


def _searched(job: Task) -> tuple[Chain, int, int] | None:
    """The path a few guesses lead to, and variations of it; as `_by_shorter`.

    None too where it is a path on its coarse mesh only.
    """
    settings = replace(job.settings, max_iterations=ITERATIONS)
    job = path_task(replace(job, settings=settings))
    paths = search(job, seeds("auto")[:GUESSES], ENOUGH, simple=True)
    if not paths.found:
        return None
    first = paths.found[0]
    best = improved(Motion(first.seed, job, first.solution, [], 0), VARIATIONS, FINEST)
    system, coarse = job.problem.system, chain_of(best.task, best.solution)
    chain, made = closed(system, coarse, Ends.of(job.problem), 1.0)
    iterations = paths.iterations + best.iterations + made
    return None if chain is None else (chain, iterations, system.size - 1)


def _below(job: Task) -> Task:
    """The job of the arm without its first joint."""
    problem, form = job.problem, job.made.form
    assert isinstance(problem.system, Manipulator)
    start, goal = (np.delete(q, 1) for q in (problem.start, problem.goal))
    joint = np.delete(Ends.of(problem, 1 - DRAWN_IN).limit, 1)
    limits = replace(problem.limits, joint=joint)
    short = replace(problem, system=problem.system.shorter(), start=start, goal=goal, limits=limits)
    plain = Form(form.intervals, form.scheme_kind, form.degree)
    return task(short, job.objective, plain, job.mesh, False, job.settings)
