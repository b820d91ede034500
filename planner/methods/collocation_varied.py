"""With a free duration: the best of many starts, bettered by variations of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from planner.methods.collocation_answer import Answer, best_along
from planner.ocp.guess import Seed
from planner.ocp.improve import FINEST, Motion, finer, improved
from planner.ocp.search import Search, one_way, same_path, search
from planner.ocp.task import Task
from planner.schema.methods import CollocationOptions

FEW, OFTEN = 3, 2
"""Starts that are enough where each takes long; times that the shortest path is found which are
enough among so many times as many starts."""

LONG_SEARCH, BRIEF = 3000, 300
"""Iterations over all starts from which on they count as taking long; iterations granted to each
once a motion is known."""

TIMED = 6
"""Paths that are timed, the shortest first: most often the fastest is among them."""

MUCH = 0.08
"""Gain by a finer mesh (a share) from which on it is used for all starts."""


def varied(
    job: Task, first: Search, guesses: Sequence[Seed], options: CollocationOptions
) -> Answer | None:
    """The best of many starts and of its variations; None if the first path leads nowhere.

    The guesses are for the starts after the first, which are tried on a finer mesh where the first
    path gains much by one.
    """
    best = best_along(job, first)
    if best is None or one_way(best.solution.iterate):
        return best
    finest = FINEST if options.intervals == "auto" else 0
    start = Motion(best.start, job, best.solution, [], best.iterations)
    closer = finer(start, finest)
    if closer.solution.objective > (1 - MUCH) * start.solution.objective:
        closer = replace(start, iterations=closer.iterations)
    best = replace(best, task=closer.task, solution=closer.solution, iterations=closer.iterations)
    settings, brief = job.settings, min(options.max_iterations, BRIEF)
    job = replace(best.task, settings=replace(settings, max_iterations=brief))
    if options.starts > 1:
        others = search(job, guesses, 2 * options.starts - 1, True, _sated)
        shortest = replace(others, found=others.found[:TIMED])
        best = _better(best, best_along(job, shortest), others)
    if one_way(best.solution.iterate):
        return best
    start = finer(Motion(best.start, job, best.solution, [], best.iterations), finest)
    found = improved(start, options.variations, finest)
    task = replace(found.task, settings=settings)
    return Answer(found.name, task, found.solution, best.log + found.log, found.iterations)


def _sated(result: Search) -> bool:
    """Whether more starts are not worth it: the shortest path comes back, or all take long."""
    if result.iterations > LONG_SEARCH and len(result.found) >= FEW:
        return True
    if len(result.found) < OFTEN * FEW:
        return False
    shortest = min(result.found, key=lambda path: path.solution.objective)
    again = [path for path in result.found if same_path(shortest.solution.objective, path)]
    return len(again) >= FEW


def _better(best: Answer, other: Answer | None, paths: Search) -> Answer:
    """The better one, with what both took."""
    more, log = (other.iterations, other.log) if other else (paths.iterations, paths.log)
    better = other is not None and other.solution.objective < best.solution.objective
    chosen = other if other is not None and better else best
    return replace(chosen, log=best.log + log, iterations=best.iterations + more)
