"""`planner compare`: several methods, one emulated machine, one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Changes, Json, ProblemPath, read_problem
from planner.cli.output import note, print_json, print_text, progress_bar
from planner.compare import compare as run
from planner.errors import InputError, NoPlanError
from planner.files import refuse_unwritable_folder


def compare(
    problem: ProblemPath,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            metavar="A,B,C",
            help="Methods, each with options if wanted, as in polynomial:travel=middle.",
            show_default=False,
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option("--samples", "-n", min=1, help="Machines to replay each plan on.")
    ] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the machines.")] = 0,
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
    machines.

    \b
    Examples:
      planner compare problems/paper.toml --out out/paper
      planner compare problems/paper.toml --out out/paper --report
      planner compare problems/paper.toml --methods polynomial,collocation --samples 200
      planner compare problems/paper.toml --methods collocation:intervals=20,collocation
    """
    task = read_problem(problem, changes)
    if report and out is None:
        raise InputError("--report needs a folder to go into: --out FOLDER")
    if out is not None:
        refuse_unwritable_folder(out)
    with progress_bar() as progress:
        found = run(task, methods, samples=samples, seed=seed, progress=progress)
        written = None if out is None else str(found.save(out, report=report))
    status = 0 if any(row.solved for row in found.rows) else NoPlanError.exit_status
    if as_json:
        extra = {"exit_status": status, "written": written}
        print_json({"file": task.source, **found.to_dict(), **extra})
    else:
        print_text(found.problem.name, "", found.table())
    if written is not None:
        note(f"written to {written}" + (f"; open {out}/report.html" if report else ""))
    return status
