"""`planner compare`: several methods, one emulated machine, one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Changes, Json, ProblemPath, read_problem
from planner.cli.output import Told, note, print_json, print_text, progress_bar, say
from planner.compare import compare as run
from planner.comparison import Comparison
from planner.errors import InputError, NoPlanError
from planner.files import refuse_unwritable_folder
from planner.report.differences import rich_differences
from planner.report.provenance import worst_command

INTERRUPTED = 130


def compare(
    problem: ProblemPath,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            metavar="A,B,C",
            help="Methods, each with options if wanted, as in polynomial:travel=middle; or all.",
            show_default=False,
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option("--samples", "-n", min=1, help="Machines to replay each plan on.")
    ] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the machines.")] = 0,
    sample: Annotated[
        list[int] | None,
        typer.Option(
            "--sample",
            metavar="NUMBER",
            min=0,
            help="Replay on this machine of the draw alone, as for the worst one; repeatable.",
            show_default=False,
        ),
    ] = None,
    feedback: Annotated[
        bool, typer.Option("--feedback", help="Replay every plan with feedback too.")
    ] = False,
    changes: Changes = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FOLDER",
            help="Write table, figures, plans and data to this folder.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        bool,
        typer.Option(
            "--report", help="Add report.html, a page to look at, to the folder of --out."
        ),
    ] = False,
    as_json: Json = False,
) -> int:
    """Plan by several methods, replay every plan on the same emulated machines, print one table.

    Ends with status 0 if one method has a verified plan, else 3. The same seed gives the same
    machines. Ctrl-C keeps what is done, says so, and ends with status 130.

    \b
    Examples:
      planner compare problems/paper.toml --out out/paper
      planner compare problems/paper.toml --out out/paper --report
      planner compare problems/paper.toml --methods polynomial,collocation --samples 200
      planner compare problems/paper.toml --methods all --feedback
      planner compare problems/paper.toml --methods collocation:intervals=20,collocation
    """
    task = read_problem(problem, changes)
    if report and out is None:
        raise InputError("--report needs a folder to go into: --out FOLDER")
    if out is not None:
        refuse_unwritable_folder(out)
    found: Comparison | None = None
    try:
        with progress_bar() as progress:
            found = run(
                task,
                methods,
                samples=sample or samples,
                seed=seed,
                feedback=feedback,
                progress=progress,
            )
    except KeyboardInterrupt:
        if found is None or found.complete:
            raise
    assert found is not None
    written = None if out is None else str(found.save(out, report=report))
    status = _status(found)
    if as_json:
        extra = {"exit_status": status, "written": written}
        print_json({"file": task.source, **found.to_dict(), **extra})
    else:
        _print(found)
    if not found.complete:
        say("interrupted: partial result; what is done is kept", "red")
    if written is not None:
        note(f"written to {written}" + (f"; open {out}/report.html" if report else ""))
    return status


def _status(found: Comparison) -> int:
    if not found.complete:
        return Told(INTERRUPTED)
    return 0 if any(row.solved for row in found.rows) else NoPlanError.exit_status


def _print(found: Comparison) -> None:
    print_text(found.problem.name, "", found.table())
    pairs = rich_differences(found)
    if pairs is not None:
        print_text("", pairs)
    commands = [c for c in (worst_command(found, row) for row in found.rows) if c]
    if commands:
        print_text("", "the worst machine of each plan alone:", *(f"  {c}" for c in commands))
