"""`planner report`: a comparison's folder as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Json
from planner.cli.output import note, print_json, waiting
from planner.report.html import write_report


def report(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER", help="What `planner compare --out` wrote.", show_default=False
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The page; report.html in FOLDER when left out.",
            show_default=False,
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write a comparison as one HTML page.

    The page opens from disk, without a network. It holds the table, the motion of two plans side by
    side, figures that show their values, the distribution of the error, and the command that makes
    it again.

    \b
    Examples:
      planner compare problems/paper.toml --out out/paper
      planner report out/paper
      planner report out/paper --out paper.html
    """
    with waiting("writing the page"):
        written = str(write_report(folder, out))
    if as_json:
        print_json({"folder": str(folder), "written": written, "exit_status": 0})
    note(f"written to {written}; open it in a browser")
    return 0
