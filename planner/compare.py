"""Many methods on one problem, every plan on the same emulated machines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from planner.comparison import Comparison, Row
from planner.errors import InputError, NoPlanError, SingularError, VerificationError, Violation
from planner.machine import Machine
from planner.measures import effort, peak_inputs
from planner.plan import Plan
from planner.problem import Problem
from planner.replay import RECORD_S
from planner.replay import replay as run_replay
from planner.solve import solve_and_check
from planner.spec import Spec, parse_specs
from planner.verify import Check, verify

__all__ = ["Comparison", "Progress", "Row", "compare", "default_methods"]

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of all work that is done, 0 … 1."""


def compare(
    problem: Problem,
    methods: str | Sequence[str] | None = None,
    *,
    machine: Machine | None = None,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Comparison:
    """Plan one problem by several methods and replay every plan on the same emulated machines.

    A plan that is refused for breaking a limit, but can be executed, is replayed too: its row says
    why it is refused and its error shows what the limit costs on the machine.

    Args:
        problem: What to solve.
        methods: Names of methods with options, as in "polynomial:travel=middle" or
            "collocation:intervals=20:degree=2". By default the polynomial at its best travel (and,
            when the travel is free, in the middle of the travels it can use) and collocation.
        machine: The machine; the problem's `[machine]` table when left out.
        samples: Number of machines drawn, at least 1.
        seed: Seed of the draws; the same seed gives the same machines.
        progress: Told what is being done; see `Progress`.

    Raises:
        InputError: If a method, an option, or a number is wrong.
    """
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 1:
        raise InputError(f"samples = {samples}: must be a whole number, at least 1")
    specs = parse_specs(problem, default_methods(problem) if methods is None else methods)
    machine = Machine.from_table(problem.machine) if machine is None else machine
    rows = []
    for k, spec in enumerate(specs):
        part = partial(_part, progress, k, len(specs), spec.label)
        part("planning", 0.0)
        row = _planned(problem, spec)
        part("replaying", 0.5)
        rows.append(_replayed(row, machine, samples, seed, part))
        part("done", 1.0)
    return Comparison(problem, tuple(rows), machine, samples, seed)


def default_methods(problem: Problem) -> list[str]:
    """What `compare` runs when no method is named.

    With the travel free the polynomial is shown twice, at an ordinary travel and at its best one,
    so that the comparison with a planner that chooses its travel is fair.
    """
    ordinary = ["polynomial:travel=middle"] if problem.travel is None else []
    return [*ordinary, "polynomial", "collocation"]


def _part(
    progress: Progress | None, k: int, count: int, label: str, doing: str, share: float
) -> None:
    if progress is not None:
        progress(f"{doing} {label}", (k + share) / count)


def _planned(problem: Problem, spec: Spec) -> Row:
    """The row without its replay."""
    try:
        plan, check = solve_and_check(problem, spec.method, **spec.options)
        why = "" if plan.verified else _outside(plan.domain.singular_times_s)
    except NoPlanError as error:
        kept = _complete(error)
        if kept is None:
            return Row(spec.label, spec.method, False, _reason(problem, error))
        known = error.check if isinstance(error, VerificationError) else None
        plan, check, why = kept, known or verify(kept), _reason(problem, error)
    return _measured(spec, plan, check, why)


def _measured(spec: Spec, plan: Plan, check: Check, why: str) -> Row:
    errors = np.abs(check.terminal_error_deg)
    row = Row(
        label=spec.label,
        method=spec.method,
        solved=plan.verified,
        why=why,
        plan=plan,
        travel_rad=plan.travel,
        duration_s=plan.duration,
        domain_margin=plan.domain.margin,
        domain_ok=plan.domain.ok,
        terminal_error_deg=float(np.max(errors)) if errors.size else np.nan,
        solve_time_s=plan.solve_time_s,
        build_time_s=plan.build_time_s,
    )
    if not plan.executable:
        return row
    peaks = peak_inputs(plan.trajectory)
    return replace(row, effort=effort(plan.trajectory), peak_u=(float(peaks[0]), float(peaks[1])))


def _replayed(
    row: Row, machine: Machine, samples: int, seed: int, part: Callable[[str, float], None]
) -> Row:
    if row.plan is None or not row.plan.executable:
        return row

    def tell(done: int, total: int) -> None:
        part("replaying", 0.5 + 0.5 * done / total)

    # Long motions are recorded more coarsely: a thousand samples are kept in memory.
    record = max(RECORD_S, row.plan.duration / 500)
    runs = run_replay(row.plan, machine, samples, seed, record_s=record, progress=tell)
    if not runs.angles:
        return replace(row, replay=runs)
    median, high = np.percentile(runs.index_E_deg, [50, 95])
    return replace(row, replay=runs, E_median_deg=float(median), E_p95_deg=float(high))


def _complete(error: NoPlanError) -> Plan | None:
    """The plan a refusal carries if it is a whole motion, not a solver's last iterate."""
    if error.plan is None or not isinstance(error, SingularError | VerificationError):
        return None
    return replace(error.plan, status=error.status, verified=False)


def _reason(problem: Problem, error: NoPlanError) -> str:
    if isinstance(error, SingularError) and error.plan is not None and error.times_s:
        return _outside(error.times_s)
    if isinstance(error, VerificationError) and error.violations:
        more = len(error.violations) - 1
        return _broken(error.violations[0]) + (f", and {more} more" if more else "")
    return error.reason.splitlines()[0].removeprefix(f"{problem.source}: ")


def _broken(violation: Violation) -> str:
    unit = f" {violation.unit}" if violation.unit else ""
    return f"{violation.label} reaches {violation.value:.3g}{unit}, allowed {violation.limit:.3g}"


def _outside(times: Sequence[float]) -> str:
    listed = ", ".join(f"{t:.3g}" for t in times[:4]) + (", ..." if len(times) > 4 else "")
    return f"leaves the chart's domain at t = {listed} s"
