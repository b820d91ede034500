"""A motion made better: variations of it are solved in turn; each that is better takes its place.

Random starts find good paths of many turns by luck. Most variations of a path that is good already
lead to one that is no worse, and sooner, since all but a stretch of it is a motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.ocp.guess import guess
from planner.ocp.mesh import uniform
from planner.ocp.solver import Solution
from planner.ocp.task import Task, stretched, transferred
from planner.ocp.variation import variation

FINEST, WORTH = 160, 0.01
"""Intervals up to which they are doubled, as long as the objective falls by this share."""

ROUND, IDLE = 12, 8
"""Variations until a finer mesh is tried, and without a notable gain until the end."""

REAL, NOTABLE = 1e-4, 2e-3
"""Gains (shares) from which on a variation takes the motion's place, and is notable."""

SAME, POOR, STEP = 1e-3, 0.1, 1.4
"""Variations that lead back (within the first share) grow by this factor; those that lead nowhere
or to what is worse by the second share shrink."""

SMALLEST, LARGEST = 0.2, 4.0


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion and how it was come by.

    Attributes:
        name: Of the start or the variation that led there.
        task: What it solves.
        solution: It.
        log: One entry a variation, JSON-ready.
        iterations: Iterations of the solver, over all of them.
    """

    name: str
    task: Task
    solution: Solution
    log: list[dict[str, Any]]
    iterations: int


def improved(best: Motion, tries: int, finest: int) -> Motion:
    """The best of a motion and of at most so many variations, on up to `finest` intervals.

    What is varied is the best so far.
    """
    rng = np.random.default_rng(0)
    name, size, idle = best.name, 1.0, 0
    for k in range(tries):
        step = f"variation {k + 1} of {name}"
        found = _varied(best, step, size, rng)
        gain = 1 - found.objective / best.solution.objective if found.ok else -np.inf
        size = float(np.clip(size * _factor(gain), SMALLEST, LARGEST))
        idle = 0 if gain > NOTABLE else idle + 1
        best = _noted(best, step, found)
        if idle >= IDLE or (k + 1) % ROUND == 0:
            closer = finer(best, finest)
            if closer.task is not best.task:
                idle = 0
            elif idle >= IDLE:
                return closer
            best = closer
    return best


def finer(best: Motion, finest: int) -> Motion:
    """The motion on twice as many intervals, where that is worth it."""
    intervals = 2 * len(best.task.mesh.widths)
    if intervals > finest:
        return best
    task = best.task.on(uniform(intervals))
    task = replace(task, build_time_s=task.build_time_s + best.task.build_time_s)
    solution = task.solve(transferred(best.task, best.solution.iterate, task), near=True)
    best = replace(best, iterations=best.iterations + solution.iterations)
    if not solution.ok or solution.objective > (1 - WORTH) * best.solution.objective:
        return best
    return replace(best, task=task, solution=solution)


def _varied(best: Motion, name: str, size: float, rng: np.random.Generator) -> Solution:
    job, iterate = best.task, best.solution.iterate
    motion = job.curve(iterate)
    seed = variation(name, job.problem, lambda s: motion.q(s * iterate.duration), size, rng)
    start = guess(job.problem, job.made, job.mesh, seed)
    return job.solve(stretched(start, iterate.duration))


def _factor(gain: float) -> float:
    if abs(gain) <= SAME:
        return STEP
    return 1 / STEP if gain < -POOR else 1.0


def _noted(best: Motion, name: str, found: Solution) -> Motion:
    entry = {
        "start": name,
        "status": found.status,
        "path_effort": None,
        "objective": found.objective if found.ok else None,
        "iterations": found.iterations,
    }
    best = replace(best, log=[*best.log, entry], iterations=best.iterations + found.iterations)
    if not found.ok or found.objective > (1 - REAL) * best.solution.objective:
        return best
    return replace(best, name=name, solution=found)
