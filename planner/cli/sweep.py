"""`planner sweep` and `planner design`: run many cases in parallel and save them in a database."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from planner.cli.arguments import Cluster, DryRun, Workers, figure_option, out_option
from planner.cli.output import explain_interruption, finish, job, say
from planner.report.figures.design import draw_sweep
from planner.support.files import refuse_picture, write_figure
from planner.support.tables import facts
from planner.sweep.description import Sweep
from planner.sweep.design.design_file import StudyInput, read_design
from planner.sweep.design.result import CASES_FILE, design_study
from planner.sweep.results import export, read, recommend, refuse_unexportable, statuses_by_method
from planner.sweep.run import run_sweep


def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A sweep file (TOML).")],
    db: Annotated[
        Path | None,
        typer.Option(
            "--db",
            metavar="X.sqlite",
            help="Database file. Default: FILE's name with .sqlite, in the current folder.",
        ),
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    retry: Annotated[
        list[str] | None,
        typer.Option(
            "--retry",
            metavar="STATUS",
            help="Run again the cases that ended with this status, for example bug or"
            " not_converged; repeatable.",
        ),
    ] = None,
    export_to: Annotated[
        Path | None,
        typer.Option(
            "--export", metavar="OUT", help="Save the results in this .csv or .parquet file."
        ),
    ] = None,
    figure: Annotated[
        Path | None, figure_option("Draw what each method solves, at what effort")
    ] = None,
    dry_run: DryRun = False,
) -> int:
    """Run those cases of a sweep that are not yet in the database.

    Each finished case is saved at once; after an interruption the same command runs the rest. A
    refused case is a result too and is saved with its reason. Ends with status 0, or 1 if a case
    hit a bug.

    \b
    Examples:
      planner sweep problems/sweeps/paper-travel.toml
      planner sweep problems/sweeps/paper-travel.toml --export travel.csv
      planner sweep problems/sweeps/twenty-goals.toml --figure goals.png
      planner sweep problems/sweeps/paper-travel.toml --cluster tcp://host:8786
    """
    task = Sweep.load(file)
    if dry_run:
        return _count_cases(task)
    path = Path(f"{file.stem}.sqlite") if db is None else db
    if export_to is not None:
        refuse_unexportable(export_to)
    refuse_picture(figure)
    with explain_interruption("cases", path), job() as progress:
        outcome = run_sweep(
            task, path, workers=workers, cluster=cluster, retry=retry or (), progress=progress
        )
    written = export_to and export(path, export_to, outcome.sweep)
    columns, records = read(path, outcome.sweep)
    counts = statuses_by_method(records)
    take, headline = recommend(columns, records)
    if figure is not None:
        write_figure(figure, draw_sweep(columns, records, f"{task.name}: {headline}"))
    if outcome.bugs:
        say(f"{outcome.bugs} cases ended with a bug; see the column 'traceback'", "red")
    same = outcome.points - outcome.cases
    each = f", {outcome.elapsed_s / outcome.ran:.3g} s a case" if outcome.ran else ""
    rows = [
        ("database", outcome.db),
        *([("picture", str(figure))] if figure is not None else []),
        ("cases", f"{outcome.cases}" + (f"  ({same} more are identical)" if same else "")),
        ("were there", str(outcome.kept)),
        ("ran", f"{outcome.ran} in {outcome.elapsed_s:.3g} s{each}"),
    ]
    for label, statuses in counts.items():
        words = f"{statuses['solved']} of {statuses.total()} solved"
        others = (f", {n} {k.replace('_', ' ')}" for k, n in statuses.items() if k != "solved")
        rows.append((label, words + "".join(others)))
    methods = {k: {"solved": c["solved"], "cases": c.total()} for k, c in counts.items()}
    data = {**asdict(outcome), "methods": methods, "file": file}
    data |= {"written": written, "figure": figure, "recommended": take, "headline": headline}
    return finish(data, task.name, facts(rows), "", headline, status=1 if outcome.bugs else 0)


def _count_cases(task: Sweep) -> int:
    labels = [spec.label for spec in task.methods]
    rows = [
        ("varies", ", ".join(task.keys)),
        ("methods", ", ".join(labels)),
        ("cases", f"{len(task.points)} points x {len(labels)} methods = {len(task)}"),
    ]
    data = {"name": task.name, "keys": task.keys, "points": len(task.points)}
    return finish({**data, "methods": labels, "runs": len(task)}, task.name, facts(rows))


def design(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A design file (TOML).")],
    out: Annotated[
        Path | None,
        out_option(
            "FOLDER",
            "Folder for finished cases, table, picture and data; an existing one is"
            " continued. Default: FILE's name without its ending, in this folder.",
        ),
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    dry_run: DryRun = False,
) -> int:
    """Compare designs of the mechanism, and recommend one.

    Plans every task on every design, replays the plans on emulated machines, and prints one table
    with a recommendation and its reason. For a design that cannot be built it prints the violated
    inequality.

    Each finished case is saved at once: the same command continues an interrupted run.
    Ends with status 0, with 3 if no design solves a task, or 1 if a case hit a bug.

    \b
    Examples:
      planner design problems/designs/gear-ratios.toml
      planner design problems/designs/gear-ratios.toml --out out/gears -j 2
      planner design problems/designs/gear-ratios.toml --dry-run
    """
    if dry_run:
        return _count_designs(read_design(file))
    folder = Path(file.stem) if out is None else out
    cases = folder / CASES_FILE
    with explain_interruption("cases", cases), job() as progress:
        study = design_study(file, folder, workers=workers, cluster=cluster, progress=progress)
        study.save(folder)
    parts: list[str | Table] = [study.title, "", study.table()]
    whys = [(row.design.name, row.design.refused) for row in study.rows]
    if refused := [(name, f"cannot be built: {why}") for name, why in whys if why]:
        parts += [facts(refused), ""]
    if study.bugs:
        say(f"{study.bugs} cases met a bug; see the column 'traceback' of {cases}", "red")
    status = 1 if study.bugs else 0 if study.recommended else 3
    return finish({**study.to_dict(), "written": folder}, *parts, study.reason, status=status)


def _count_designs(study: StudyInput) -> int:
    runs = len(study.pairs) * len(study.methods)
    refused = {each.name: each.refused for each in study.designs if each.refused}
    rows = [
        ("designs", str(len(study.designs))),
        ("methods", ", ".join(study.methods)),
        ("cases", str(runs)),
        *((name, f"cannot be built: {why}") for name, why in refused.items()),
    ]
    counts = {"designs": len(study.designs), "refused": refused, "runs": runs}
    data = {"title": study.title, "methods": study.methods, **counts}
    return finish(data, study.title, facts(rows))
