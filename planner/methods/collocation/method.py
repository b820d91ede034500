"""Direct collocation in joint coordinates: optimal plans that need no chart.

The file turns options into a plan, plans a neighbouring problem with an existing plan as the first
guess, and answers with the best motion if time is up before the search has ended.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError, NoPlanError, TimeLimitError, Violation
from planner.methods.collocation.best import Candidate, Exactness, Record, polish
from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.discs import thicknesses, uncovered
from planner.methods.collocation.guesses import routes
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    has_only_limits,
)
from planner.methods.collocation.pipeline import (
    Pipeline,
    Stages,
    collocation_task,
    search_intervals,
)
from planner.methods.collocation.refusals import NAME, iterate_plan, no_goal, refusal
from planner.methods.collocation.task import Solution, Task
from planner.methods.collocation.transcription.form import Mesh
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.plan import Plan, mark_cut_short
from planner.problem.feasibility import why_too_short
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress
from planner.support.deadline import Span, TimeUpError, time_advice
from planner.systems.vehicles import Trailers
from planner.verification.verify import verify

CUT_SHORT = "ended the search; this is the best motion found so far"

THICK_SHARE, THICK_WORK_S = 0.5, 15.0
"""Largest share of the remaining time, and most work, s (`planner.support.deadline.spend`), for a
search with thickened discs, which may find nothing."""


def plan_collocation(problem: Problem, options: CollocationOptions) -> Plan:
    """Plan the motion of least effort or time among motions that keep every limit.

    The plan's q(t) is the scheme's polynomial; its u(t) is linear or constant in each interval. For
    the search see `planner.methods.collocation.pipeline`. `notes["stage"]` names the stage that
    found the plan, `notes["start"]` its first guess, `notes["tried"]` the result of each guess. If
    time is up before the search has ended, the best motion so far is refined: the plan's status is
    "time_limit", or "interrupted" after Ctrl-C, and `notes["ended_early"]` says why.

    Motions are searched without discs first, then among those that the motion found meets: one that
    clears all discs is the best there is. Without a motion in the given duration there is none
    among discs either; the slower motions, which say how much is missing, need all discs.

    Among thin discs motions are searched with thickened discs; the best is then solved again with
    thinner and thinner discs. So the objective does not grow when a single disc shrinks.

    Raises:
        InputError: If the options contradict each other or the problem.
        TimeLimitError: If time is up before a motion is found.
        InfeasibleError: If the duration is proven too short for any motion; the error gives the
            shortest duration found.
        NotConvergedError: If no motion is found, or every motion found takes longer.
    """
    posts, part = uncovered(problem.obstacles), replace(problem, obstacles=())
    stages: Stages = "all"
    records = list[Record]()
    with (
        progress.progress_listener(None),
        # One search for whoever stops it, or the next would begin.
        deadline.time_limit(
            options.time_limit_s, has_answer=lambda: any(each.holds() for each in records)
        ),
    ):
        while part.obstacles != posts:
            try:
                plan = replace(_plan_beside(part, options, records, "first"), problem=problem)
            except NoPlanError:
                stages = "all" if problem.duration is None else "last"
                break
            met = {id(disc) for disc in part.obstacles}
            met |= {id(violation.demand) for violation in verify(plan).violations}
            discs = tuple(disc for disc in posts if id(disc) in met)
            if discs == part.obstacles:
                return plan
            part = replace(problem, obstacles=discs)
        plan = _plan_beside(replace(problem, obstacles=posts), options, records, stages)
        return replace(plan, problem=problem)


def _plan_beside(
    problem: Problem, options: CollocationOptions, records: list[Record], stages: Stages
) -> Plan:
    """Plan among the discs of this problem.

    `records` are those of this problem's searches afterwards; for `stages` see `Pipeline`.
    """
    records.clear()
    plans = list[Plan]()
    possible = bool(problem.obstacles) and why_too_short(problem) is None
    for each, is_searched in thicknesses(problem) if possible else []:
        for plan in [plans[0], None] if plans else [None]:
            with (
                suppress(NoPlanError, TimeUpError),
                deadline.time_share(THICK_SHARE),
                deadline.work_limit(THICK_WORK_S, "the limit of work for thicker discs") as span,
            ):
                if plan is not None:
                    plans += _shrink(plan, each, options)
                elif is_searched:
                    plans.append(_plan_from(each, options, None, records, stages))
        plans = [plan for plan in plans if plan.status in ("solved", "interrupted")]
        plans.sort(key=lambda plan: plan.objective)
    if plans:
        plan = replace(plans[0], problem=problem)
        return mark_cut_short(plan, span, CUT_SHORT) if span.ended_by else plan
    return _plan_from(problem, options, None, records, stages)


def _shrink(plan: Plan, problem: Problem, options: CollocationOptions) -> Iterator[Plan]:
    """Yield the optimum near a plan of the problem with thicker discs, unless none is found."""
    origin = {key: plan.notes[key] for key in ("stage", "start", "tried")}
    for motion in _near_motions(problem.within_reach(), options, plan):
        if motion.solution.ok:
            done = polish(motion, options.accuracy, options.refinements)
            if done.exactness >= Exactness.ACCEPTED:
                done = replace(done, start=plan.notes["start"])
                yield plan_of(problem, done, origin, options)


def _plan_from(
    problem: Problem,
    options: CollocationOptions,
    warm: Plan | None,
    records: list[Record],
    stages: Stages = "all",
) -> Plan:
    """Plan for discs as they are, from first guesses or from the plan `warm`.

    The search adds its record to `records`; for `stages` see `Pipeline`. A motion that backs
    trailers is planned from the goal to the start: the other way no simulation follows it.
    """
    turned, other = warm and warm.backwards, problem.exchanged()
    if other and _lies_behind(problem) and (turned or not warm):
        try:
            return _plan_from(other, options, turned, records).exchanged(problem)
        except NoPlanError as error:
            if isinstance(error, TimeLimitError):
                raise
    reached = problem.within_reach()
    ways = routes(reached)
    if not ways:
        raise no_goal(problem)
    near = () if warm is None else _near_motions(reached, options, warm)
    records.append(record := Record(options.accuracy))
    search = Pipeline(ways, options, record, near, stages)
    with (
        deadline.time_limit(options.time_limit_s),
        deadline.time_limit(None, has_answer=record.holds) as span,
    ):
        try:
            candidate = max(search.run(), key=lambda each: each.rank, default=None)
            if candidate is None and span.was_reached and record.holds():
                raise deadline.TimeUpError  # it cut the refinement of a motion short
        except deadline.TimeUpError:
            if warm is not None and not record.holds():
                raise
            candidate = _finish_best(record, span, problem, options)
        if candidate is None:
            raise refusal(problem, record, options)
        notes = {"stage": candidate.stage, "tried": record.log}
        plan = plan_of(problem, candidate, notes, options)
        return mark_cut_short(plan, span, CUT_SHORT) if span.was_reached else plan


def _lies_behind(problem: Problem) -> bool:
    """Return whether trailers must be backed to the goal, seen from the headings at both ends."""
    x, y, heading = np.array([problem.start, problem.goal])[:, [0, -1, -2]].T
    ahead = np.diff(x) * np.sum(np.cos(heading)) + np.diff(y) * np.sum(np.sin(heading))
    return isinstance(problem.system, Trailers) and bool(ahead < 0)


def _finish_best(
    record: Record, span: Span, problem: Problem, options: CollocationOptions
) -> Candidate:
    """Return the best candidate when time is up, refined in the time reserved for that.

    Raises:
        TimeLimitError: If no motion has been found.
    """
    with suppress(TimeUpError):
        record.make_exact()
    motions = [each for each in record.candidates.values() if each.solution.ok]
    done = [polish(each, options.accuracy, options.refinements) for each in motions]
    if done:
        candidate = max(done, key=lambda each: each.rank)
        return replace(candidate, start="the best found by then", stage="time limit")
    far, last, violations = progress.current_progress(), None, list[Violation]()
    if failed := record.candidates.get(Exactness.FAILED):
        last, violations = iterate_plan(problem, failed, options)
    came = "" if far is None else f" after {far.solves} solves (the search was {far.doing})"
    nearest = "; the closest attempt breaks:" if violations else ""
    error = TimeLimitError(
        f"{span.why} ended the search before it had found a motion{came}",
        source=problem.source,
        list_head=nearest,
        plan=last,
        violations=violations,
        advice=time_advice(),
    )
    error.status = "interrupted" if span.ended_by else error.status
    raise error


def plan_of(
    problem: Problem, candidate: Candidate, notes: dict[str, Any], options: CollocationOptions
) -> Plan:
    """Make the plan of a refined candidate."""
    job, solution, search = candidate.task, candidate.solution, progress.current_progress()
    assert search is not None
    trajectory = job.curve(solution.iterate)
    value = solution.objective
    # The transcription takes the mean of the closeness over its own points, and adds the spread.
    if "closeness" in job.objective.terms or options.spread_weight > 0:
        value = job.objective.value(trajectory) or value
    return Plan(
        problem=problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=trajectory,
        objective=value,
        aim=job.objective,
        solve_time_s=search.seconds - job.build_time_s,
        build_time_s=job.build_time_s,
        iterations=search.iterations,
        notes={
            "start": candidate.start,
            **notes,
            **chosen_goal(job.problem, solution.iterate),
            "largest_residual": solution.residual,
            **candidate.notes,
        },
    )


def chosen_goal(problem: Problem, iterate: Iterate) -> dict[str, Any]:
    """Return the end of a plan, for the plan's notes, if the goal leaves coordinates free; else {}.

    The end is given by all joints in degrees, or by user coordinates with their names.
    """
    if not problem.free:
        return {}
    system = problem.system
    if system.has_user_coordinates:
        end = system.user(iterate.nodes[-1, : system.size]).tolist()
        return {"goal": {c.name: x for c, x in zip(system.user_coordinates, end, strict=True)}}
    return {"goal_theta_deg": np.rad2deg(iterate.nodes[-1, 1 : problem.system.size]).tolist()}


def replan_collocation(problem: Problem, options: CollocationOptions, warm: Plan) -> Plan:
    """Plan as `plan_collocation`, but start from a plan of another problem of the same system.

    The plan `warm` may come from any method and have any start, goal, duration and limits; the
    nearer it is, the faster the search. The answer is the optimum near `warm`: other first guesses
    are tried only if this fails. A plan of collocation also supplies its mesh. If `warm` has the
    same ends, its motion at the required speed is the first result, which the answer may improve.

    Raises:
        InputError: If the plan belongs to another system or cannot be executed.
        TimeLimitError, InfeasibleError, NotConvergedError: As for `plan_collocation`.
    """
    refuse_start(problem, warm)
    with progress.progress_listener(None):
        return _plan_from(problem, options, warm, [])


def refuse_start(problem: Problem, warm: Plan) -> None:
    """Raise InputError for a plan that cannot serve as a first guess of a problem."""
    if warm.problem.system != problem.system:
        raise InputError(
            f"warm is a plan of another system ({warm.problem.source}); it"
            " must be of the same system",
            source=problem.source,
        )
    if not warm.executable:
        raise InputError(
            f"the plan given as warm leaves the chart's domain ({warm.status}),"
            " so it has no joint angles to start from; give a verified plan",
            source=problem.source,
        )


def _near_motions(problem: Problem, options: CollocationOptions, warm: Plan) -> Iterator[Candidate]:
    """Yield the motion of plan `warm` if it has the problem's ends, then the optimum near it."""
    is_compatible = warm.method == NAME and options.intervals == "auto" and not problem.waypoints
    mesh = Mesh(warm.t / warm.duration) if is_compatible else search_intervals(problem)
    job = collocation_task(problem, options, mesh)
    if is_compatible and warm.notes.get("limits_inside", False):
        job = job.with_inner_rows()
    start = _resample(job, warm)
    same = warm.problem.start.tolist() == problem.start.tolist()
    same = same and np.array_equal(warm.problem.goal, problem.goal, equal_nan=True)
    if same and (motion := _own_motion(job, start, options.accuracy)):
        yield Candidate(*motion, "warm", "warm start")
    yield Candidate(job, job.solve_near(start), "warm", "warm start")


def _own_motion(job: Task, start: Iterate, accuracy: float) -> tuple[Task, Solution] | None:
    """Return a plan's motion on the task's mesh, or else on its own mesh; None if limits break."""
    motion = job.judge(start)
    if motion.ok:
        return (job, motion) if clears(job, motion) else None
    return exact_motion(job, chain_of(job, motion), accuracy) if has_only_limits(job) else None


def _resample(job: Task, warm: Plan) -> Iterate:
    """Sample a plan on the task's mesh, plus a line so that it leads from the start to the goal."""
    problem, mesh, T = job.problem, job.mesh, warm.duration
    duration = problem.duration or T
    inside = mesh.at(job.nlp.form.scheme.points)
    s = np.append(mesh.edges, inside)
    states, last = warm.q(s * T), len(mesh.edges) - 1
    first, final = problem.start - states[0], problem.goal - states[last]
    final[np.isnan(final)] = 0.0
    path = states + first + s[:, None] * (final - first)
    nodes, points = path[: last + 1], path[last + 1 :]
    return Iterate(
        duration=duration,
        nodes=nodes,
        points=points.reshape(*inside.shape, -1),
        inputs=warm.u(job.nlp.form.input_places(mesh) * T) * (T / duration),
    )
