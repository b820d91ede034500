"""`planner compare`: compare several methods on the same emulated machines.

`planner budget`: how much error each effect of the machine causes.
"""

from __future__ import annotations

from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from planner.cli.arguments import (
    Changes,
    Folder,
    MachineFile,
    PlannedMethods,
    PlanOrProblemPath,
    ProblemPath,
    Samples,
    Seed,
    TimeLimit,
    is_plan,
    join_methods,
    parse_changes,
    read_problem,
    refuse_given,
)
from planner.cli.output import (
    INTERRUPT_STATUS,
    ReaderGoneError,
    ReportedStatus,
    finish,
    is_interrupted,
    job,
    manner,
    note,
    print_json,
    print_text,
    say,
)
from planner.comparison.compare import compare as run
from planner.comparison.compare import plan_rows
from planner.comparison.comparison import Comparison, worst_command
from planner.comparison.differences import rich_differences
from planner.comparison.headline import By
from planner.errors import InputError, NoPlanError
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.report.folders import save, save_budget
from planner.report.result_folder import refuse_unwritable_folder
from planner.robustness.budget import Budget, error_budgets
from planner.robustness.sobol import find_salib
from planner.support.tables import CommandLine
from planner.verification.verdict import load_plan

BUDGET_SAMPLES, BUDGET_BASE = 200, 128


def compare(
    problem: ProblemPath,
    methods: PlannedMethods = None,
    samples: Samples = 1000,
    seed: Seed = 0,
    sample: Annotated[
        list[int] | None,
        typer.Option(
            "--sample",
            metavar="NUMBER",
            min=0,
            help="Replay only on the random machine of this number, for example the worst one;"
            " repeatable.",
        ),
    ] = None,
    feedback: Annotated[
        bool,
        typer.Option(
            "--feedback",
            help="Also replay with feedback: every named plan; without --methods the last plan.",
        ),
    ] = False,
    budget: Annotated[
        bool,
        typer.Option(
            "--budget",
            help="Also compute the error that each machine effect causes (needs extra `budget`).",
        ),
    ] = False,
    by: Annotated[By, typer.Option("--by", help="What the plan to take is chosen by.")] = "way",
    time_limit: TimeLimit = None,
    changes: Changes = None,
    machine: MachineFile = None,
    out: Folder = None,
    report: Annotated[
        bool,
        typer.Option(
            "--report", help="Also write report.html, an interactive page, to the folder of --out."
        ),
    ] = False,
) -> int:
    """Compare methods on the same emulated machines.

    Makes a plan with each method, replays every plan and prints one table.

    Ends with status 0 if one method has a verified plan, else 3. The same seed gives the same
    machines. Ctrl-C saves the finished results, says so, and ends with status 130.

    \b
    Examples:
      planner compare problems/paper.toml --out out/paper
      planner compare problems/paper.toml --out out/paper --report
      planner compare problems/paper.toml --methods sinusoid,collocation -n 200
      planner compare problems/paper.toml --methods "collocation compensated"
      planner compare problems/paper.toml --methods collocation:end=machine
      planner compare problems/paper.toml --by end
      planner compare problems/paper.toml --methods all --feedback --budget
      planner compare problems/paper.toml --methods collocation:intervals=20
    """
    task = read_problem(problem, changes, machine)
    _refuse_early(out, budget, report)
    result: Comparison | None = None
    with suppress(KeyboardInterrupt), job() as progress:
        result = run(
            task,
            join_methods(methods),
            machine=replace(Machine.from_table(task.machine), source=str(machine or "")),
            samples=sample or samples,
            seed=seed,
            feedback=feedback,
            progress=progress,
            time_limit_s=time_limit,
            by=by,
        )
    if result is None:
        raise KeyboardInterrupt
    # If the reader of the table leaves (`| head`), the folder is still written.
    gone = nullcontext() if out is None else suppress(ReaderGoneError)
    if not manner.as_json:  # now, because budgets and figures take a while
        with gone:
            _print_comparison(result)
    shares: dict[str, Budget] = {}
    complete = result.complete and not is_interrupted()
    if budget and complete:
        complete = False
        with suppress(KeyboardInterrupt), job() as progress:
            # `update` adds pairs one by one, so that budgets finished before Ctrl-C stay.
            numbers = {"samples": BUDGET_SAMPLES, "base": BUDGET_BASE, "seed": seed}
            shares.update(error_budgets(result.plans, result.machine, progress, **numbers))
            complete = not is_interrupted()
    if not manner.as_json:
        with gone:
            for share in shares.values():
                print_text(share.table(), "")
    written: Path | None = None
    # After Ctrl-C, `job` would end the command before the finished results are written.
    with suppress(KeyboardInterrupt), job("drawing figures") if out and complete else nullcontext():
        written = out and save(result, out, report=report, partial=not complete)
    if out and written is None:
        complete = False
        written = save(result, out, report=report, partial=True, pictures=False)
    if written is not None and shares:
        save_budget(shares, written / "budget")
    status = 0 if any(row.solved for row in result.rows) else NoPlanError.exit_status
    status = status if complete else ReportedStatus(INTERRUPT_STATUS)
    if manner.as_json:
        extra: dict[str, Any] = {"complete": complete, "exit_status": status, "written": written}
        if budget:
            extra["budgets"] = {label: each.to_dict() for label, each in shares.items()}
        print_json({"file": task.source, **result.to_dict(), **extra})
    _say_results(result, complete, out, written, report, changes)
    return status


def _refuse_early(out: Path | None, budget: bool, report: bool) -> None:
    """Refuse options and a folder with which the command would fail after the planning."""
    if report and out is None:
        raise InputError("--report needs a folder: add --out FOLDER")
    if budget:
        find_salib()
    refuse_unwritable_folder(out)


def _say_results(
    result: Comparison,
    complete: bool,
    out: Path | None,
    written: Path | None,
    report: bool,
    changes: list[str] | None,
) -> None:
    """Print where the results are, whether they are complete, and what to try without a plan."""
    if not complete:
        where = "shown above" if written is None else f"written to {written}"
        kept = "" if written == out else f"; {out} keeps the complete result of an earlier run"
        bare = written is not None and not (written / "figures").exists()
        say(f"interrupted: partial result{' without pictures' * bare}, {where}{kept}", "red")
    elif written is not None:
        look = f"open {written}/report.html" if report else f"pictures in {written}/figures"
        note(f"written to {written}; {look}")
        if not report:
            words = "a page with the motion and all figures: "
            note(CommandLine.of("planner", "report", str(written), after=words))
    if complete and not any(row.solved for row in result.rows):
        tried = any(row.has_remedy for row in result.rows)
        help_ = "see the changes after 'Try', or run" if tried else "to find what would help"
        sets = [word for change in changes or [] for word in ("--set", change)]
        command = ["planner", "check", result.problem.source, *sets]
        note(CommandLine.of(*command, after=f"no method has a plan; {help_}: "))


def _print_comparison(result: Comparison) -> None:
    print_text(result.problem.name, "", result.headline, "", result.table())
    if (pairs := rich_differences(result)) is not None:
        print_text("", pairs)
    if commands := [c for c in (worst_command(result, row) for row in result.rows) if c]:
        print_text(
            "",
            "to replay each plan on its worst machine:",
            *(CommandLine(f"  {c}") for c in commands),
        )


def budget(
    context: typer.Context,
    subject: PlanOrProblemPath,
    methods: PlannedMethods = None,
    samples: Samples = 200,
    base: Annotated[
        int, typer.Option("--base", min=2, help="Base samples of the Sobol indices, a power of 2.")
    ] = 256,
    seed: Seed = 0,
    feedback: Annotated[
        bool, typer.Option("--feedback", help="Drive the machines with feedback by the tracker.")
    ] = False,
    changes: Changes = None,
    out: Folder = None,
) -> int:
    """Compute how much error each effect of the machine causes.

    Shows the error with each effect alone, with each effect switched off, and the share of each
    effect in the variance (Sobol indices; they need the extra `budget`). Refused plans are included
    if they can be executed.

    \b
    Examples:
      planner budget problems/paper.toml --methods sinusoid,collocation -o budget
      planner budget plan.json --samples 500 --base 512
      planner budget plan.json --feedback    # effects of encoders too
    """
    find_salib()
    refuse_unwritable_folder(out)
    if is_plan(subject):
        why = f"for a problem, but {subject} is named as a plan"
        refuse_given(context, ["methods"], why)
        if others := [k for k in parse_changes(changes or []) if k.split(".")[0] != "machine"]:
            raise InputError(f"{', '.join(f'--set {key}' for key in others)}: {why}")
    plans = _plans(subject, join_methods(methods), changes)
    problem = next(iter(plans.values())).problem.changed(parse_changes(changes or []))
    machine = Machine.from_table(problem.machine)
    options = {"samples": samples, "base": base, "seed": seed, "feedback": feedback}
    with job() as progress:
        shares = dict(error_budgets(plans, machine, progress, **options))
    written = out and save_budget(shares, out, CommandLine.of("planner", *manner.words))
    data = {label: each.to_dict() for label, each in shares.items()}
    tables = [part for each in shares.values() for part in (each.table(), "")]
    return finish({"file": subject, "written": written, "budgets": data}, *tables)


def _plans(subject: Path, methods: str | None, changes: list[str] | None) -> dict[str, Plan]:
    if is_plan(subject):
        plan = load_plan(subject, strict=True)
        return {plan.method: plan}
    with job() as progress:
        rows = plan_rows(read_problem(subject, changes), methods, progress)
    plans = {row.label: row.plan for row in rows if row.plan is not None and row.plan.executable}
    for row in rows:
        if row.label not in plans:
            say(f"{row.label}: {row.why}", "yellow")
    if not plans:
        raise NoPlanError("no method has a plan that can be executed, so there is no error budget")
    return plans
