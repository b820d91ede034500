"""`planner design`: designs of the mechanism against a set of tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Cluster, Json, Workers, out_option
from planner.cli.output import facts, note, print_json, print_text, progress_bar, say
from planner.cli.sweep import Interrupted
from planner.design.design_file import Asked, read_design
from planner.design.study import CASES, design_study
from planner.support.interrupts import Terminated


def design(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A design file (TOML).", show_default=False)
    ],
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
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Check the file and count designs and cases; plan none."),
    ] = False,
    as_json: Json = False,
) -> int:
    """Compare designs of the mechanism, and recommend one.

    Plans every task on every design, replays the plans on emulated machines, and prints one table
    with a recommendation and its reason. For a design that cannot be built it prints the violated
    inequality.

    Each finished case is saved at once: the same command continues an interrupted run.
    Ends with status 0, with 3 if no design solves a task, or 1 if a case met a bug.

    \b
    Examples:
      planner design problems/designs/gear-ratios.toml
      planner design problems/designs/gear-ratios.toml --out out/gear-ratios --workers 2
      planner design problems/designs/gear-ratios.toml --dry-run
    """
    if dry_run:
        return _count(read_design(file), as_json)
    folder = Path(file.stem) if out is None else out
    try:
        with progress_bar() as progress:
            study = design_study(file, folder, workers=workers, cluster=cluster, progress=progress)
            study.save(folder)
    except (KeyboardInterrupt, Terminated):
        raise Interrupted(f"finished cases are in {folder / CASES}") from None
    status = 1 if study.bugs else 0 if study.recommended else 3
    if as_json:
        print_json({**study.to_dict(), "written": str(folder), "exit_status": status})
    else:
        print_text(study.title, "", study.table(), "")
        whys = [(row.design.name, row.design.refused) for row in study.rows]
        if refused := [(name, f"cannot be built: {why}") for name, why in whys if why]:
            print_text(facts(refused), "")
        print_text(study.reason)
    if study.bugs:
        say(f"{study.bugs} cases met a bug; see the column 'traceback' of {folder / CASES}", "red")
    note(f"written to {folder}")
    return status


def _count(asked: Asked, as_json: bool) -> int:
    built = [each for each in asked.designs if not each.refused]
    runs = sum(len(asked.tasks[each.joints]) for each in built) * len(asked.methods)
    refused = {each.name: each.refused for each in asked.designs if each.refused}
    if as_json:
        counts = {"designs": len(asked.designs), "refused": refused, "runs": runs}
        print_json({"title": asked.title, "methods": asked.methods, **counts, "exit_status": 0})
        return 0
    rows = [
        ("designs", str(len(asked.designs))),
        ("methods", ", ".join(asked.methods)),
        ("cases", str(runs)),
        *((name, f"cannot be built: {why}") for name, why in refused.items()),
    ]
    print_text(asked.title, facts(rows))
    return 0
