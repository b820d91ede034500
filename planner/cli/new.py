"""`planner new`: a commented problem file to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from planner.cli.arguments import Json
from planner.cli.lists import SYSTEMS
from planner.cli.output import note, print_json
from planner.errors import InputError
from planner.files import refuse_unwritable, write_text
from planner.starter import problem_text


def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")] = Path(
        "problem.toml"
    ),
    system: Annotated[
        str,
        typer.Option(
            "--system",
            "-s",
            metavar="KIND",
            help="What is steered; `planner systems` lists the kinds.",
            autocompletion=lambda: list(SYSTEMS.items()),
        ),
    ] = "manipulator",
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it is there.")] = False,
    as_json: Json = False,
) -> int:
    """Write a commented problem file that can be solved as it is.

    It names every key there is with its default, for all methods and the emulated machine.

    \b
    Examples:
      planner new
      planner new lane-change.toml --system car
    """
    refuse_unwritable(file)
    text = problem_text(system).replace("FILE", str(file))
    if file.exists() and not force:
        raise InputError(f"{file} is there already; name another file, or replace it with --force")
    written = str(write_text(file, text))
    if as_json:
        print_json({"written": written, "system": system, "exit_status": 0})
    note(f"written to {file}; next: planner check {file}")
    return 0
