"""Solve one problem with many methods and replay every plan on the same emulated machines."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from planner.comparison.comparison import Comparison
from planner.comparison.headline import FIGURES, By
from planner.comparison.rows import Row, machine_figures
from planner.compensation import compensate_in_time
from planner.errors import (
    InfeasibleError,
    InputError,
    NoPlanError,
    SingularError,
    UntrackableError,
    VerificationError,
    Violation,
    expect_number,
)
from planner.machine.feedback.run_up import hindrance
from planner.machine.feedforward.legs import compensable
from planner.machine.machine import Machine, machine_for, sample_numbers
from planner.machine.replay import RECORD_S
from planner.machine.replay import replay as run_replay
from planner.methods.registry import ALL, find_method, merged_options, parse_specs
from planner.plan.measures import polygon_lengths
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.problem.feasibility import why_too_short
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.solve import solve_and_check
from planner.support.deadline import TimeUpError, time_limit
from planner.support.progress import Tell, expect_listener
from planner.support.statistics import LEAST_DIFFERENCE_DEG
from planner.support.tables import line
from planner.verification.verify import INTEGRATION_TOLERANCE, Check, verify

KEPT_MOTIONS = 1000
"""Maximum number of machines whose motions are stored per plan: enough for a figure's 90 % band."""


def compare(
    problem: AnyProblem,
    methods: str | Sequence[str] | None = None,
    *,
    machine: Machine | str | None = None,
    samples: int | Sequence[int] = 1000,
    seed: int = 0,
    feedback: bool = False,
    progress: Tell | None = None,
    time_limit_s: float | None = None,
    threshold_deg: float = LEAST_DIFFERENCE_DEG,
    by: By = "way",
) -> Comparison:
    """Plan one problem with several methods and replay every plan on the same emulated machines.

    A refused plan that can be executed is replayed too: its row gives the reason for the refusal
    and its error on the machine.

    Ctrl-C returns the finished rows with `complete` False; Ctrl-C before the first row is finished
    raises KeyboardInterrupt as usual.

    Args:
        problem: The problem to solve.
        methods: Names of methods with options, for example "polynomial:travel=middle" or
            "collocation:intervals=20:degree=2". The word `compensated` after the name compensates
            the plan; " + feedback" at the end also replays it with feedback. "all" means every
            method. By default: the polynomial (if the travel is free, with the middle of its
            possible travels), the polynomial with automatic constraint points, the sinusoid and
            collocation; for arms with friction disks also the compensated plans of the last three
            methods, if these have a verified plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Number of random machines, at least 1, or a list of sample numbers.
        seed: Random seed; the same seed gives the same machines.
        feedback: Whether to replay every plan a second time with feedback by the tracker. With the
            default methods, only the last method's plan is replayed again (for arms a compensated
            plan).
        progress: Called with the current step and the finished share, 0 … 1; see `Tell`.
        time_limit_s: Seconds for planning with each method; see `planner.solve`.
        threshold_deg: A difference of E below this is too small to matter, degrees: the plan counts
            as neither better nor worse, even if the difference is significant.
        by: What the headline chooses the plan by: "way", the error E at any time; "end", the error
            at the end; "effort"; or "time", the whole duration.

    Raises:
        InputError: If a method, an option, or a number is wrong.
        KeyboardInterrupt: On Ctrl-C before a row is finished.
    """
    report = expect_listener(progress)
    problem = problem_of(problem)
    numbers = sample_numbers(samples)
    named = specs_of(problem, methods, feedback=True)
    requests = list(dict.fromkeys(replace(spec, feedback=False) for spec in named))
    distribution = machine_for(problem.machine, machine)
    chosen = None if isinstance(samples, int) else tuple(numbers.tolist())
    if by not in FIGURES:
        raise InputError(f"by = {by!r}: must be one of {', '.join(FIGURES)}")
    expect_number("threshold_deg", threshold_deg, "degrees, at least 0", 0)
    closed = [spec for spec in requests if feedback or replace(spec, feedback=True) in named]
    closed = closed[-1:] if methods is None else closed
    run = _ComparisonRun(
        problem, distribution, numbers.tolist(), seed, closed, methods, time_limit_s
    )
    complete = False
    try:
        for k, spec in enumerate(requests):

            def tell(doing: str, share: float, k: int = k, label: str = spec.label) -> None:
                report(f"{doing} {label}", (k + share) / len(requests))

            run.add(spec, tell)
        complete = True
    except KeyboardInterrupt:
        if not run.rows:
            raise
    rows = tuple(run.rows)
    return Comparison(
        problem, rows, distribution, len(numbers), seed, chosen, complete, float(threshold_deg), by
    )


@dataclass
class _ComparisonRun:
    """A running comparison and its rows so far; after Ctrl-C the last row may lack its replay."""

    problem: Problem
    machine: Machine
    numbers: Sequence[int]
    seed: int
    closed: Sequence[Spec]
    methods: str | Sequence[str] | None
    time_limit_s: float | None
    rows: list[Row] = field(default_factory=list)

    def add(self, spec: Spec, part: Tell) -> None:
        """Plan by one method, replay the plan, and append one row, or two with feedback.

        `part` is called with each step and its share of this method's work.
        """
        part("planning", 0.0)
        plain = self._plain(spec) if spec.compensated else None
        if self.methods is None and spec.compensated and plain is None:
            return  # there is no verified plan to compensate
        row = self._plan(spec, plain)
        self.rows.append(row)
        part("replaying", 0.5)
        with_feedback = spec in self.closed
        half = 0.75 if with_feedback else 1.0
        self.rows[-1] = self._replay(row, part, 0.5, half)
        if with_feedback and self.rows[-1].replay is not None:
            self.rows.append(self._feedback_row(row, partial(self._replay, part=part, begin=half)))
        part("done", 1.0)

    def _plain(self, spec: Spec) -> Row | None:
        """Return the finished row of the plan that `spec` compensates; None if it is not solved."""
        return next((row for row in self.rows if row.spec == spec.plain and row.solved), None)

    def _plan(self, spec: Spec, plain: Row | None) -> Row:
        try:
            return plan_row(self.problem, spec, self.time_limit_s, self.machine, plain)
        except InputError as error:  # with "all", some methods may not fit the problem
            if self.methods != ALL:
                raise
            return Row(spec, False, error.sentence)

    def _feedback_row(self, row: Row, replay: Callable[[Row], Row]) -> Row:
        """Return the row of a plan with feedback; if feedback cannot follow it, with the reason."""
        assert row.plan is not None
        spec, hindered = replace(row.spec, feedback=True), hindrance(row.plan, self.machine)
        try:
            return replay(replace(row, spec=spec, note=hindered or row.note))
        except UntrackableError as error:
            refusal = replace(row, spec=spec, solved=False, why=error.why)
            return replace(refusal, effort=np.nan, path_length=np.nan, peak_u=(np.nan, np.nan))

    def _replay(self, row: Row, part: Tell, begin: float, end: float = 1.0) -> Row:
        if row.plan is None or not row.plan.executable:
            return row
        doing = "replaying with feedback" if row.feedback else "replaying"

        def tell(done: int, total: int) -> None:
            part(doing, begin + (end - begin) * done / total)

        # Long motions are recorded more coarsely, to limit the memory for a thousand samples.
        runs = run_replay(
            row.plan,
            self.machine,
            self.numbers,
            self.seed,
            row.feedback,
            record_s=max(RECORD_S, row.plan.duration / 500),
            motions=KEPT_MOTIONS,
            progress=tell,
        )
        row = replace(row, replay=runs)
        if runs.effort is not None:
            first, second = runs.peak_rates.max(axis=0).tolist()
            effort = float(np.median(runs.effort))
            length = float(np.median(polygon_lengths(runs.plan.problem.system, runs.q)))
            row = replace(row, effort=effort, path_length=length, duration_s=runs.run_s)
            row = replace(row, peak_u=(first, second))
        if not runs.angles:
            return row
        errors = np.stack([runs.index_E_deg, runs.terminal_E_deg])
        return replace(row, machine_errors_deg=errors, **machine_figures(runs))


def specs_of(
    problem: Problem, methods: str | Sequence[str] | None, *, feedback: bool = False
) -> list[Spec]:
    """Return the methods and options that `compare` runs; `feedback` as for `parse_spec`.

    Raises:
        InputError: If a method is unknown or an option is wrong.
    """
    named = default_methods(problem) if methods is None else methods
    return parse_specs(problem, named, feedback=feedback)


def default_methods(problem: Problem) -> list[str]:
    """Return the methods that `compare` runs by default.

    The polynomial appears twice, without and with automatic constraint points, so that the
    comparison with a method that optimises its path is fair.
    """
    plain = "polynomial:travel=middle" if problem.travel is None else "polynomial"
    out = [plain, "polynomial:points=auto", "sinusoid", "collocation"]
    if problem.compensation.on or not compensable(problem.system):
        return out
    return out + [replace(Spec.of_label(text), compensated=True).text for text in out[1:]]


def plan_rows(problem: Problem, methods: str | Sequence[str] | None, progress: Tell) -> list[Row]:
    """Plan by several methods and return the comparison's rows, which have no replay yet.

    `progress` is called with each step and the finished share of the whole.

    Raises:
        InputError: If a method is unknown or does not fit the problem, or an option is wrong.
    """
    rows, specs = [], specs_of(problem, methods)
    for k, spec in enumerate(specs):
        progress(f"planning {spec.label}", k / len(specs))
        rows.append(plan_row(problem, spec))
    return rows


def plan_row(
    problem: Problem,
    spec: Spec,
    time_limit_s: float | None = None,
    machine: Machine | None = None,
    plain: Row | None = None,
) -> Row:
    """Plan by one method and return the comparison's row, which has no replay yet.

    The row has a verified plan, a refused plan, or only the reason why there is no plan.

    Args:
        problem: The problem to solve.
        spec: The method and its options.
        time_limit_s: Seconds for planning.
        machine: The machine to compensate for. By default the problem's machine.
        plain: The row of the same plan without compensation, if it exists already.

    Raises:
        InputError: If the method does not fit the problem.
    """
    advice = dict[str, Any]()
    time_limit_s = spec.options.get("time_limit_s", time_limit_s)
    start = time.perf_counter() - (0.0 if plain is None else plain.took_s)
    try:
        if plain is not None and plain.plan is not None:
            with time_limit(time_limit_s):
                plan, check = compensate_in_time(
                    plain.plan, verify(plain.plan), machine, problem.compensation
                )
        else:
            plan, check = solve_and_check(
                problem, spec, time_limit_s=time_limit_s, compensated_for=machine
            )
        took = time.perf_counter() - start
        early = str(plan.notes.get("ended_early", ""))
        why = early if plan.verified else _exit_text(plan.domain.singular_times_s)
    except NoPlanError as error:
        took = time.perf_counter() - start
        why = _reason(error)
        advice = {"ways": error.ways, "has_remedy": error.has_remedy}
        motion = _whole_plan(error) or _plan_too_short(problem, spec)
        if motion is None:
            return Row(spec, False, why, took_s=took, **advice)
        plan, check = replace(motion[0], status=error.status, verified=False), motion[1]
    row = Row.from_plan(spec, plan, check, why)
    return replace(row, took_s=took, **advice)


def _whole_plan(error: NoPlanError) -> tuple[Plan, Check] | None:
    """Return a refused plan that is a complete motion, and its verification.

    Return None if there is no plan, or only the last iterate of a solver.
    """
    whole = isinstance(error, SingularError | VerificationError | InfeasibleError) or error.blamed
    if error.plan is None or not whole:
        return None
    plan: Plan = error.plan
    check = (error.check if isinstance(error, VerificationError) else None) or verify(plan)
    # The plan of an InfeasibleError may not even reach the goal.
    misses = check.integration_error > INTEGRATION_TOLERANCE
    misses |= any(v.misses_goal for v in check.violations)
    return None if misses and isinstance(error, InfeasibleError) else (plan, check)


STUDY_LIMIT_S = 5.0
"""Time limit, in seconds, for planning a motion that is already refused and only for study."""


def _plan_too_short(problem: Problem, spec: Spec) -> tuple[Plan, Check] | None:
    """Plan a problem for which `solve` called no method, because its duration is too short.

    The plan is only for study. Return it with its verification; None if the duration is not proven
    too short, or if planning fails or takes too long.
    """
    method = find_method(spec.method)
    if method.finds_time or why_too_short(problem) is None:
        return None
    with time_limit(STUDY_LIMIT_S), suppress(NoPlanError, TimeUpError):
        plan = method.plan(problem, merged_options(problem, method, dict(spec.options)))
        return plan, verify(plan)
    return None


def _reason(error: NoPlanError) -> str:
    if isinstance(error, SingularError) and error.plan is not None and error.times_s:
        return _exit_text(error.times_s)
    if isinstance(error, VerificationError) and error.violations:
        more = len(error.violations) - 1
        return _violation_text(error.violations[0]) + (f", and {more} more" if more else "")
    return line(error.sentence)


def _violation_text(violation: Violation) -> str:
    if np.isnan(violation.limit):
        return str(violation)
    value, limit, unit = violation.shown(3)
    verb, allowed = violation.verbs
    return f"{violation.label} {verb} {value}{unit}, {allowed} {limit}"


def _exit_text(times: Sequence[float]) -> str:
    listed = ", ".join(f"{t:.3g}" for t in times[:4]) + (", ..." if len(times) > 4 else "")
    return f"leaves the chart's domain at t = {listed} s"
