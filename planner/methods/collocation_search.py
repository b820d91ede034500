"""Collocation's search: paths from several starts, each then timed, and the best of them kept."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from planner.errors import NoPlanError
from planner.methods.collocation_answer import Answer, along, best_along
from planner.methods.collocation_refusals import no_path, not_converged, too_short
from planner.methods.collocation_seeds import NAMES, planned_seeds
from planner.methods.collocation_varied import varied
from planner.ocp.backends import SHORT_CHAIN
from planner.ocp.guess import Seed, seeds
from planner.ocp.look import clears
from planner.ocp.polish import Polished, patiently, polish
from planner.ocp.search import Search, search
from planner.ocp.solver import Solution
from planner.ocp.task import Task, can_jump, stretched, task, transferred
from planner.ocp.timing import HASTE, hasty
from planner.problem import Problem
from planner.schema.methods import CollocationOptions

GUESSES, LONG_CHAIN_GUESSES = 16, 2
"""Guesses tried before random paths are, up to four joints and beyond."""

BRIDGES = 4
"""Random paths tried."""

RESOLVED = 1e-4
"""Difference at the end, rad, between a motion and its interpolant up to which it is believed."""


def searched(job: Task, options: CollocationOptions) -> Answer:
    """Paths from several seeds, each then timed; the best of them."""
    enough = options.starts if options.start in ("auto", "wander") else 1
    simple = options.start == "auto" and not job.problem.obstacles
    guesses = _seeds(job.problem, options)[: _guesses(job, options)]
    paths = search(job, guesses, 1 if _variable(job, options) else enough, simple)
    if not paths.found:
        return _bridged(job, paths, None, options)
    if _variable(job, options):
        if answer := varied(job, paths, _others(job, paths, options), options):
            return answer
        paths = search(job, guesses, enough, simple)
    outcomes, log, iterations = along(job, paths)
    solved = [k for k, outcome in enumerate(outcomes) if outcome.solution.ok]
    clear = [k for k in solved if clears(job, outcomes[k].solution)]
    if solved and not clear:
        raise no_path(job, paths, options)
    if solved:
        k = min(clear, key=lambda k: outcomes[k].solution.objective)
        return Answer(paths.found[k].seed, job, outcomes[k].solution, log, iterations)
    k = int(np.argmin([outcome.shortest_s for outcome in outcomes]))
    quick = outcomes[k].quick
    if quick is None or not quick.ok:
        return _bridged(job, paths, outcomes[k].solution, options)
    answer = Answer(paths.found[k].seed, job, quick, log, iterations)
    return _hurried(answer, _fastest(answer, options), options)


def _variable(job: Task, options: CollocationOptions) -> bool:
    """Whether a motion found is bettered by variations."""
    free = job.problem.duration is None and _bridgeable(job.problem)
    return options.start == "auto" and options.variations > 0 and free


def _others(job: Task, first: Search, options: CollocationOptions) -> list[Seed]:
    """Guesses after the first that led to a path: twice as many as until then, or few if long."""
    tried = {entry["start"] for entry in first.log}
    others = [seed for seed in _seeds(job.problem, options) if seed.name not in tried]
    most = _guesses(job, options)
    return others[: (2 * most if most > LONG_CHAIN_GUESSES else most) - len(tried)]


def by_path(job: Task) -> Answer | None:
    """A long chain's straight line: as in a search first its path, then its timing."""
    answer = best_along(job, search(job, seeds("straight")[:1], 1))
    return answer if answer is not None and clears(job, answer.solution) else None


def _seeds(problem: Problem, options: CollocationOptions) -> list[Seed]:
    """First guesses in the order in which they are tried: a line, others' plans, the rest."""
    start = options.start
    planned = planned_seeds(problem, start) if start in ("auto", *NAMES) else []
    if start in NAMES and planned:
        return planned
    first, *others = seeds("auto" if start in NAMES else start, options.attempts)
    return [first, *planned, *others]


def _guesses(job: Task, options: CollocationOptions) -> int:
    """Guesses worth trying: for long chains few lead anywhere, and each takes long to fail."""
    if options.start != "auto" or not _bridgeable(job.problem):
        return options.attempts
    most = GUESSES if job.problem.system.size <= SHORT_CHAIN else LONG_CHAIN_GUESSES
    return min(options.attempts, most)


def _bridgeable(problem: Problem) -> bool:
    """Whether random paths are of use; they know nothing of z2, discs and waypoints."""
    return not (problem.obstacles or problem.waypoints) and problem.limits.z2_margin is None


def _bridged(
    job: Task, paths: Search, last: Solution | None, options: CollocationOptions
) -> Answer:
    """Where no guess leads to a motion: from random motions of both ends."""
    from planner.ocp.bridged import crossings  # slow to import, and seldom needed

    log, shortest = [*paths.log], None
    wanted = options.start == "auto" and _bridgeable(job.problem)
    for found in crossings(job, BRIDGES, options.accuracy) if wanted else ():
        solution, iterations = found.timed.solution, paths.iterations + found.iterations
        objective = solution.objective if solution.ok else None
        log.append({"start": found.name, "status": solution.status, "objective": objective})
        if solution.ok:
            return Answer(found.name, found.task, solution, log, iterations)
        if shortest is None or found.timed.shortest_s < shortest.timed.shortest_s:
            shortest = found
    quick = shortest.timed.quick if shortest else None
    if shortest is None or quick is None or not quick.ok:
        if last is not None:
            raise not_converged(job, last, options, "the paths found")
        raise no_path(job, paths, options)
    answer = Answer(shortest.name, shortest.task, quick, log, paths.iterations)
    return _hurried(answer, _hastened(answer, options), options)


def resolved(answer: Answer, options: CollocationOptions) -> tuple[Answer, Polished]:
    """The answer on a mesh fine enough to believe it, or another where it is no motion on any."""
    done = _polished(answer, options)
    if done.error <= RESOLVED or not (other := _elsewhere(answer, options)):
        return answer, done
    return other, _polished(other, options)


def _polished(answer: Answer, options: CollocationOptions) -> Polished:
    return polish(answer.task, answer.solution, options.accuracy, options.refinements)


def _elsewhere(answer: Answer, options: CollocationOptions) -> Answer | None:
    """Another answer, where one turned out to be no motion however fine the mesh; None if none."""
    problem = answer.task.problem
    if options.start != "auto" or options.refinements == 0 or not _bridgeable(problem):
        return None
    paths = Search([], None, answer.log, 0.0, answer.iterations)
    return _bridged(answer.task, paths, answer.solution, options)


def _hurried(answer: Answer, fastest: Polished, options: CollocationOptions) -> Answer:
    """The answer from the fastest motion found, if need be that motion, slower; or a refusal."""
    job, wanted = answer.task, answer.task.problem.duration
    assert wanted is not None
    if fastest.error > RESOLVED:
        raise not_converged(job, answer.solution, options, "the paths found")
    motion = fastest.solution.iterate
    if motion.duration * HASTE > wanted:
        raise too_short(job, fastest, options)
    own = fastest.task.asking(job.problem, job.objective)
    for finer in (job.on(fastest.task.mesh), own):
        start = transferred(fastest.task, motion, finer)
        solution = patiently(finer).solve(stretched(start, wanted))
        if solution.ok:
            return replace(answer, task=finer, solution=solution)
    slower = own.judged(stretched(motion, wanted))
    if motion.duration > wanted or not slower.ok:
        raise too_short(job, fastest, options)
    return replace(answer, task=own, solution=slower)


def _fastest(answer: Answer, options: CollocationOptions) -> Polished:
    """The fastest motion that a free duration finds; the answer's own where that is faster."""
    free, wanted = _jumping(hasty(answer.task), options), answer.task.problem.duration
    assert wanted is not None
    found = []
    if _variable(free, options):
        with suppress(NoPlanError):
            found.append(resolved(searched(free, options), options)[1])
    if not any(done.error <= RESOLVED and _duration(done) <= wanted for done in found):
        found.append(_hastened(answer, options))
    return min(found, key=lambda done: (done.error > RESOLVED, _duration(done)))


def _hastened(answer: Answer, options: CollocationOptions) -> Polished:
    """The answer's motion as fast as it can be, on a mesh fine enough to believe it."""
    return _polished(replace(answer, task=hasty(answer.task)), options)


def _duration(done: Polished) -> float:
    return done.solution.iterate.duration


def _jumping(job: Task, options: CollocationOptions) -> Task:
    """The task with inputs that may jump, where they may: the fastest ones do."""
    if options.input != "auto" or not can_jump(job):
        return job
    form = replace(job.made.form, input="constant")
    return task(job.problem, job.objective, form, job.mesh, job.rest, job.settings)
