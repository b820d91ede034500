"""`planner budget`: which effect of the machine costs a plan how much."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from planner.budget import Budget, error_budget, refuse_without_salib
from planner.cli.arguments import (
    Changes,
    Json,
    PlannedMethods,
    Seed,
    parse_changes,
    read_problem,
)
from planner.cli.output import note, print_json, print_text, progress_bar, say
from planner.compare import planned, specs
from planner.comparison import Row
from planner.errors import InputError, NoPlanError
from planner.files import refuse_unwritable_folder
from planner.loading import load_plan
from planner.machine import Machine
from planner.plan import Plan

Progress = Callable[[str, float], None]


def budget(
    subject: Annotated[
        Path,
        typer.Argument(
            metavar="PROBLEM|PLAN",
            help="A problem file (TOML), or a plan file (JSON).",
            show_default=False,
        ),
    ],
    methods: PlannedMethods = None,
    samples: Annotated[
        int, typer.Option("--samples", "-n", min=1, help="Machines for each median.")
    ] = 200,
    base: Annotated[
        int, typer.Option("--base", min=2, help="Base samples of the Sobol indices, a power of 2.")
    ] = 256,
    seed: Seed = 0,
    changes: Changes = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Write tables, figures and data to this folder.",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Find what each effect of the machine costs a plan.

    Each effect alone, each switched off, and each one's share of the variance (Sobol indices; they
    need the extra `budget`). Refused plans that can be executed are looked at too.

    \b
    Examples:
      planner budget problems/paper.toml --methods polynomial,collocation --out out/budget
      planner budget plan.json --samples 500 --base 512
    """
    refuse_without_salib()
    if out is not None:
        refuse_unwritable_folder(out)
    with progress_bar() as progress:
        plans = _plans(subject, methods, changes, partial(_part, progress, 0.0, 0.3))
        machine = _machine(next(iter(plans.values())), changes)
        told = partial(_part, progress, 0.3, 1.0)
        found = dict(budgets(plans, machine, samples, base, seed, told))
    words = ["planner", "budget", str(subject), *(["--methods", methods] if methods else [])]
    words += ["--samples", str(samples), "--base", str(base), "--seed", str(seed)]
    for change in changes or []:
        words += ["--set", change]
    written = None if out is None else save(found, out, shlex.join([*words, "--out", str(out)]))
    if as_json:
        data = {label: each.to_dict() for label, each in found.items()}
        print_json({"file": str(subject), "exit_status": 0, "written": written, "budgets": data})
    else:
        print_budgets(found)
    if written is not None:
        note(f"written to {written}")
    return 0


def budgets(
    plans: dict[str, Plan],
    machine: Machine,
    samples: int,
    base: int,
    seed: int,
    progress: Progress,
) -> Iterator[tuple[str, Budget]]:
    """Labels of plans and their budgets, each as soon as it is done."""
    for k, (label, plan) in enumerate(plans.items()):

        def tell(doing: str, share: float, k: int = k, label: str = label) -> None:
            progress(f"{label}: {doing}", (k + share) / len(plans))

        yield (
            label,
            error_budget(plan, machine, samples=samples, base=base, seed=seed, progress=tell),
        )


def executable(rows: Sequence[Row]) -> dict[str, Plan]:
    """The plans that have a budget, by label."""
    return {
        row.label: row.plan
        for row in rows
        if row.plan is not None and row.plan.executable and not row.feedback
    }


def save(found: dict[str, Budget], out: Path, command: str | None) -> str:
    """Write the budgets to a folder; returns its name."""
    from planner.report.budget import save as write

    return str(write(found, out, command))


def print_budgets(found: dict[str, Budget]) -> None:
    """One table a plan."""
    for each in found.values():
        print_text(each.table(), "")


def _plans(
    subject: Path, methods: str | None, changes: list[str] | None, progress: Progress
) -> dict[str, Plan]:
    if subject.suffix == ".json":
        if methods is not None:
            raise InputError(f"{subject} is a plan; --methods is for problem files")
        plan = load_plan(subject, strict=True)
        return {plan.method: plan}
    problem = read_problem(subject, changes)
    wanted, rows = specs(problem, methods), []
    for k, spec in enumerate(wanted):
        progress(f"planning {spec.label}", k / len(wanted))
        rows.append(planned(problem, spec))
    found = executable(rows)
    for row in rows:
        if row.label not in found:
            say(f"{row.label}: {row.why}", "yellow")
    if not found:
        raise NoPlanError("no method has a plan that can be executed, so there is no budget")
    return found


def _machine(plan: Plan, changes: list[str] | None) -> Machine:
    return Machine.from_table(plan.problem.changed(parse_changes(changes or [])).machine)


def _part(progress: Progress, begin: float, end: float, doing: str, share: float) -> None:
    progress(doing, begin + (end - begin) * share)
