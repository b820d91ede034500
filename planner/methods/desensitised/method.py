"""Plans with the least response to errors of inputs, start and constants, traded against effort.

The file has, in this order: the plan; the collocation problem with the errors and their sizes; the
first guesses; and the refusals before and after the search.

The response has a local optimum for each side of the straight line and each number of reversals. So
the first guesses are an easy plan, and motions in which the second coordinate leaves the straight
line to either side and the first input reverses.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from planner.errors import InfeasibleError, InputError, NotConvergedError, Violation
from planner.methods.collocation.best import Candidate, Exactness, polish
from planner.methods.collocation.guesses import Excursion, Seed, sign_of
from planner.methods.collocation.method import chosen_goal, plan_collocation, refuse_start
from planner.methods.collocation.pipeline import input_kind
from planner.methods.collocation.solvers import Settings
from planner.methods.collocation.task import (
    ACCEPTED_RESIDUAL,
    Solution,
    Task,
    iterate_of_inputs,
    task,
)
from planner.methods.collocation.transcription.augmented import Augmented, backs_off
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.form import Form, uniform
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.methods.refusal import looser_limits
from planner.plan.measures import Objective, effort, turns
from planner.plan.plan import Plan, mark_cut_short
from planner.plan.trajectory import Trajectory
from planner.problem.feasibility import format_value
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.tables.method_options import CollocationOptions, DesensitisedOptions
from planner.support import progress
from planner.support.arrays import Array
from planner.support.deadline import TimeUpError, time_limit, time_share
from planner.systems.linearisation import ErrorParameter, parameters
from planner.systems.triangular_system import TriangularSystem
from planner.verification.verify import verify

NAME = "desensitised"

CUT_SHORT = "ended a part of the search; a longer one may find a better plan"

EASY_PLAN_SHARE = 0.5
"""Fraction of a limited time that the search for the plan of least effort may take."""

REFINEMENTS = 4
"""Largest number of mesh refinements."""


def plan_desensitised(
    problem: Problem, options: DesensitisedOptions, near: Plan | None = None
) -> Plan:
    """Minimise a weighted sum of the response to the design errors and the effort.

    Motion and response are one collocation problem
    (`planner.methods.collocation.transcription.augmented`). It is solved from the plan of least
    effort and from motions with other courses of q₂, since optima are local. The best solution is
    returned; `notes["start"]` names its first guess, `notes["tried"]` lists all first guesses.
    Unless `reversal` is on, φ reverses only where the plan of least effort does, since the response
    leaves out the backlash and shaft torsion that each reversal costs.

    Args:
        problem: The problem.
        options: Weights, standard deviations of the errors, and form of the collocation.
        near: A plan of this or a similar problem, used instead of all other starts: for example a
            neighbour on a trade-off curve, or the plan for a nearby goal.

    Raises:
        InputError: If a spread does not fit the system, options contradict each other, or the plan
            to start from is of another system.
        InfeasibleError: If the start is closer to a limit than the back-off requires.
        NotConvergedError: If no motion is found.
    """
    began = time.perf_counter()
    # The plan of least effort alone is not an answer.
    with time_limit(None, has_answer=lambda: False) as span:
        if near is not None:
            refuse_start(problem, near)
        job = desensitised_task(problem.within_reach(), options)
        _refuse_no_room(job)
        if near is None:
            plain = CollocationOptions(rest=options.rest, intervals=options.intervals)
            with time_share(EASY_PLAN_SHARE):
                easy = plan_collocation(problem, plain)
        else:
            easy = near
        if not options.reversal:
            turned = turns(easy.trajectory)
            first = easy.q(turned[0] if len(turned) else easy.duration)[0] - easy.q(0.0)[0]
            sign = 1.0 if first >= 0 else -1.0
            shares = tuple(turned / easy.duration)
            job = replace(job, demands=replace(job.demands, first_sign=sign, turns=shares))
        with progress.progress_listener(None):  # report progress only from here on
            start, solution, log = _search(job, options, easy, near is not None)
            done = polish(Candidate(job, solution), options.accuracy, REFINEMENTS)
            search = progress.current_progress()
        assert search is not None
        if span.was_reached and done.exactness < Exactness.EXACT:
            raise TimeUpError
        plan = _plan(done.task, done.solution, options)
        plan = replace(
            plan,
            problem=problem,
            solve_time_s=time.perf_counter() - began - done.task.build_time_s,
            build_time_s=done.task.build_time_s,
            iterations=search.iterations,
            notes={"start": start, "tried": log, **plan.notes, **done.notes},
        )
        return mark_cut_short(plan, span, CUT_SHORT) if span.was_reached else plan


def desensitised_task(problem: Problem, options: DesensitisedOptions) -> Task:
    """Return the collocation task for a system augmented by the response to its errors."""
    spread = spreads(problem.system, options)
    factors = options.passive, options.terminal, options.path, options.backoff
    metered = options.effort_limit is not None
    model = Augmented(problem.system, tuple(spread.items()), *factors, metered)
    form = Form(
        intervals=options.intervals,
        scheme_kind="legendre",
        input=input_kind(problem, NAME, options, auto="constant"),
        inner=True,
        augmented=model,
    )
    rest = problem.rests(options.rest)
    demands = InputDemands(rest, effort=options.effort_limit or np.inf)
    settings = Settings(options.tolerance, options.max_iterations)
    time_weight = options.time if problem.duration is None else 0.0
    terms = {
        "passive block^2 (deg^2)": options.passive,
        "terminal response^2 (deg^2)": options.terminal,
        "response along the path^2 (deg^2)": options.path,
        "effort": options.effort,
        "duration": time_weight,
    }
    goal = Objective(NAME, {term: weight for term, weight in terms.items() if weight})
    return task(problem, goal, form, uniform(options.intervals), demands, settings)


def spreads(system: TriangularSystem, options: DesensitisedOptions) -> dict[str, float]:
    """Return the standard deviations of a system's errors by name, in SI units, without zeros.

    Raises:
        InputError: If a list does not have one number per input, joint or constant, or is all zero.
    """
    families: dict[str, list[ErrorParameter]] = {}
    for parameter in parameters(system):
        families.setdefault(parameter.family, []).append(parameter)
    starts = families["start"][1:]
    angles = [p for p in starts if p.unit == "rad"]
    lengths = [p for p in starts if p.unit != "rad"]
    given = [
        ("gain", families["gain"], options.gain, 1.0),
        ("bias", families["bias"], options.bias, 1.0),
        ("delay_s", families["delay"], options.delay_s, 1.0),
        ("stretch", families["stretch"], options.stretch, 1.0),
        ("start_deg", angles, options.start_deg, np.pi / 180),
        ("start_m", lengths, options.start_m, 1.0),
        ("gear", families.get("gear", []), options.gear, 1.0),
    ]
    out: dict[str, float] = {}
    for key, members, numbers, unit in given:
        values = numbers if isinstance(numbers, list) else [numbers] * len(members)
        if len(values) != len(members):
            names = ", ".join(p.name for p in members) or "no parameter of this system"
            raise InputError(
                f"method.desensitised.{key} has {len(values)} values; give one number, or"
                f" {len(members)} for {names}"
            )
        named = zip(members, values, strict=True)
        out |= {p.name: float(value) * unit for p, value in named if value > 0}
    if not out:
        raise InputError(
            "method.desensitised: all standard deviations are zero, so there is no error to plan"
            " for; set gain, start_deg, bias, delay_s, stretch or gear"
        )
    return out


def _search(
    job: Task, options: DesensitisedOptions, easy: Plan, near: bool
) -> tuple[str, Solution, list[dict[str, Any]]]:
    """Solve from each first guess; return name and solution of the best, and a log of all."""
    log: list[dict[str, Any]] = []
    solutions: list[tuple[str, Solution]] = []
    for seed in excursions(options.reversal)[: 1 if near else options.starts]:
        start = excursion_guess(job, easy.trajectory, seed)
        name = "the plan given" if near else seed.name
        last = job.solve(start, near)
        if not last.ok:  # another barrier may converge elsewhere
            other = job.solve(start, not near)
            last = replace(other, iterations=last.iterations + other.iterations)
        value = last.objective if last.ok else None
        log.append({"start": name, "status": last.status, "objective": value, **_sizes(job, last)})
        if last.ok:
            solutions.append((name, last))
    if not solutions:
        raise _not_converged(job, last, options, len(log))
    name, solution = min(solutions, key=lambda each: each[1].objective)
    return name, solution, log


AMPLITUDE = (0.6, 0.5)
"""Amplitudes of the excursion of q₁ from the easy plan and of q₂ from the straight line, in the
units of q₁ and q₂."""

EASY_PLAN = Seed("least effort", np.zeros_like, np.zeros_like)
"""Seed without excursions, from which the easy plan itself is the first guess."""

SLOWEST_DRIVE = 0.05
"""Least |drive factor| q̇₁/u₁ by which an excursion of q₁ is divided to get u₁."""

FREE_DURATION_RATIO = 3.0
"""First guess of a free duration, as a multiple of the duration of the easy plan, which is fast."""


def excursions(reversal: bool) -> list[Seed]:
    """Return the seeds of first guesses in order; without `reversal` only q₂ makes excursions."""

    def wave(size: float, count: int) -> Excursion:
        return lambda s: size * np.sin(count * np.pi * s)

    out = [EASY_PLAN]
    shapes = [("out and back", 1), ("twice", 2), ("thrice", 3)]
    for name, count in shapes:
        for a, b in ((1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)):
            if not reversal and a < 0:
                continue
            sign = sign_of(b) if not reversal else f"{sign_of(a)}{sign_of(b)}"
            path = wave(a * AMPLITUDE[0], count) if reversal else np.zeros_like
            out.append(Seed(f"{name} {sign}", path, wave(b * AMPLITUDE[1], count)))
    order = [0, *range(1, len(out), 4), *range(2, len(out), 4)] if reversal else range(len(out))
    first = [out[k] for k in order]
    return [*first, *(seed for seed in out if seed not in first)]


def excursion_guess(job: Task, easy: Trajectory, seed: Seed) -> Iterate:
    """Return the first guess whose inputs make the excursions of a seed.

    Only a guess that obeys the kinematics has a response to errors. So the inputs are chosen, and
    states and response follow by integration. An arm's drive depends on cos θ₁, so the easy plan's
    excursion of θ₁ has a mirror image on the other side. An excursion of q₂ is therefore added to
    the straight line; added to the easy plan, the excursion would stay on the plan's side.
    """
    duration = job.problem.duration or FREE_DURATION_RATIO * easy.duration
    s = job.nlp.form.input_places(job.mesh)
    u = np.array(easy.u(s * easy.duration) * easy.duration)
    if seed is not EASY_PLAN:
        u[:, 1] = easy.q(easy.duration)[1] - easy.q(0.0)[1]
    fine = np.linspace(0.0, 1.0, 2001)
    slopes = [np.gradient(part(fine), fine) for part in (seed.path, seed.driven)]
    swing = np.stack([np.interp(s, fine, slope) for slope in slopes], axis=-1)
    drive = easy.system.drive(easy.q(s * easy.duration))
    swing[:, 0] /= np.where(np.abs(drive) < SLOWEST_DRIVE, SLOWEST_DRIVE, drive)
    limit = job.problem.limits.input
    return iterate_of_inputs(job, duration, np.clip((u + swing) / duration, -limit, limit))


def _sizes(job: Task, solution: Solution) -> dict[str, Any]:
    model, iterate = job.nlp.form.augmented, solution.iterate
    assert model is not None
    passive, total = model.sizes_deg(iterate.nodes[-1])
    spent = effort(job.curve(iterate))
    sizes = {"passive_deg": passive, "total_deg": total, "effort": spent}
    return sizes | {"iterations": solution.iterations}


def _plan(job: Task, solution: Solution, options: DesensitisedOptions) -> Plan:
    model = job.nlp.form.augmented
    assert model is not None
    return Plan(
        problem=job.problem,
        method=NAME,
        options=options.model_dump(),
        trajectory=job.curve(solution.iterate),
        objective=solution.objective,
        aim=job.objective,
        iterations=solution.iterations,
        notes={
            "spread": dict(model.spread),
            **chosen_goal(job.problem, solution.iterate),
            **_sizes(job, solution),
        },
    )


def _refuse_no_room(job: Task) -> None:
    """Raise InfeasibleError if the start is closer to a limit than the required back-off.

    At the start the spread is a given constant, which no path changes.
    """
    problem, model = job.problem, job.nlp.form.augmented
    if model is None or not model.backoff:
        return
    W = model.response(job.nlp.start(problem))
    for requirement in filter(backs_off, problem.requirements):
        for part, row, q in _functions(requirement, problem.system):
            there = ca.Function("there", [q], [row, ca.jacobian(row, q)])
            value, slope = (np.asarray(entry, dtype=float) for entry in there(problem.start))
            room = min(part.high - float(value.item()), float(value.item()) - part.low)
            needed = model.backoff * float(np.linalg.norm(slope @ W))
            if needed > room:
                name = requirement.limit_name(part)
                looser = "wider" if np.isfinite(part.high) else "smaller"
                raise InfeasibleError(
                    f"method.desensitised.backoff = {model.backoff:g} needs a"
                    f" distance of {format_value(needed, part.unit)} from the limit on {name},"
                    f" but the start has only {format_value(room, part.unit)}",
                    source=problem.source,
                    advice="method.desensitised.backoff ="
                    f" {model.backoff * room / needed * 0.99:.3g} or less, or a {looser}"
                    f" {part.key or f'limit on {name}'}",
                )


def _not_converged(
    job: Task, solution: Solution, options: DesensitisedOptions, tried: int
) -> NotConvergedError:
    ways = [] if options.reversal else ["method.desensitised.reversal = true"]
    ways += ["method.desensitised.backoff smaller"] if options.backoff else []
    ways += ["a larger method.desensitised.effort_limit"] if options.effort_limit else []
    more = ["more method.desensitised.starts", *looser_limits(job.problem)]
    ways += [f"{', '.join(more)}, or more time"]
    plan = replace(_plan(job, solution, options), status=NotConvergedError.status)
    return NotConvergedError(
        f"no desensitised motion was found from {tried} start"
        f"{'s' if tried > 1 else ''} (the last one: {solution.status} after"
        f" {solution.iterations} iterations)",
        source=job.problem.source,
        plan=plan,
        violations=_violations(job, plan, solution.iterate.nodes),
        advice=", or ".join(ways),
    )


def _violations(job: Task, plan: Plan, nodes: Array) -> list[Violation]:
    """Return what an iterate breaks: requirements by `verify`, the effort limit, and back-offs."""
    problem, model, spent = job.problem, job.nlp.form.augmented, effort(plan.trajectory)
    assert model is not None
    out = list(verify(plan).violations)
    if spent > job.demands.effort:
        most = job.demands.effort
        out.append(Violation(Part("effort", "", -np.inf, most, most), spent, most))
    if not model.backoff:
        return out
    x = ca.SX.sym("x", model.size)
    for requirement in filter(backs_off, problem.requirements):
        for part, value, q in _functions(requirement, problem.system):
            reach = ca.Function("reach", [x], [ca.vertcat(*model.sides(q, value, [x]))])
            below, above = np.asarray(reach(nodes.T))
            excesses = np.maximum(above - part.high, part.low - below)
            k = int(np.argmax(excesses))
            if excesses[k] > ACCEPTED_RESIDUAL:
                upper = above[k] - part.high == excesses[k]
                extreme, limit = (above[k], part.high) if upper else (below[k], part.low)
                label = f"{part.label} with {model.backoff:g} standard deviations of back-off"
                time_s = float(job.mesh.edges[k] * plan.duration)
                out.append(Violation(replace(part, label=label), float(extreme), limit, time_s))
    return out


def _functions(requirement: Requirement, system: TriangularSystem) -> list[tuple[Part, Any, Any]]:
    """Return each part of a requirement with its row as a CasADi expression, and the symbol q."""
    q = ca.SX.sym("q", system.size)
    pairs = zip(requirement.parts, requirement.rows(MotionPoint(system, q)), strict=True)
    return [(part, row, q) for part, row in pairs]
