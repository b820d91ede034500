"""Arguments and options that several commands share, and the functions that parse them.

An option of a single command is in the signature of that command. A shared option is a type alias
here, or a function of the help text if the help differs between commands.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from planner.errors import InputError
from planner.machine.machine import load_machine
from planner.methods.registry import all_methods
from planner.problem.problem import Problem, load_problem
from planner.support.files import MOST_LEVELS, toml_value
from planner.support.tables import shorten

ProblemPath = Annotated[Path, typer.Argument(metavar="PROBLEM", help="A problem file (TOML).")]
PlanPath = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan file (JSON) from `planner plan --out`.")
]
PlanOrProblemPath = Annotated[
    Path,
    typer.Argument(
        metavar="PROBLEM|PLAN",
        help="A problem file (TOML), or a plan file (JSON) from `planner plan --out`.",
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the problem file, for example goal.travel=0.8; repeatable. The"
        " value is TOML; a bare word is taken as text.",
    ),
]
MachineFile = Annotated[
    Path | None,
    typer.Option(
        "--machine",
        metavar="FILE",
        help="Use the machine in this file (from `planner identify --out`), not the problem's.",
    ),
]
PoseFrom = Annotated[
    Path | None,
    typer.Option(
        "--pose-from",
        metavar="LOG",
        help="Start from the pose of the arm at the end of a recorded run (CSV), for example after"
        " homing.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option("--workers", "-j", min=1, help="Number of processes. Default: one per core."),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        help="Run on the Dask cluster of this scheduler, for example tcp://host:8786.",
    ),
]


def complete_methods(incomplete: str) -> list[tuple[str, str]]:
    """Complete the last name of a comma-separated list of methods."""
    before, comma, _ = incomplete.rpartition(",")
    head = f"{before}{comma}"
    names = before.split(",")
    return [(head + m.name, m.summary) for m in all_methods().values() if m.name not in names]


def join_methods(given: list[str] | None) -> str | None:
    """Return the methods of one or several `--methods` as one list "a,b,c"; None without any."""
    return ",".join(given) if given else None


PlannedMethods = Annotated[
    list[str] | None,
    typer.Option(
        "--methods",
        metavar="A,B,C",
        autocompletion=complete_methods,
        help="Methods, each with options if needed (polynomial:travel=middle) or followed by the"
        " word compensated ('collocation compensated'); or all.",
    ),
]
TimeLimit = Annotated[
    float | None,
    typer.Option(
        "--time-limit",
        metavar="SECONDS",
        help="Seconds for planning and compensation (in `compare`, of each method). Default: 60 s"
        " of processor time for the search. When time is up, the best verified plan so far is"
        " taken, uncompensated if necessary; without a plan, the command reports how far the"
        " search got.",
    ),
]


def out_option(metavar: str, help: str) -> Any:
    """Return the option `--out` of a command, with the given metavar (FILE, FOLDER) and help."""
    return typer.Option("--out", "-o", metavar=metavar, help=help)


def figure_option(help: str) -> Any:
    """Return the option `--figure` of a command; `help` says what is drawn."""
    return typer.Option("--figure", metavar="FILE", help=f"{help} (.png, .svg or .pdf).")


Folder = Annotated[
    Path | None, out_option("FOLDER", "Save results, figures, plans and data in this folder.")
]
MethodName = Annotated[
    str,
    typer.Option(
        "--method",
        "-m",
        help="The method (`planner methods` lists them), with options if needed:"
        " polynomial:points=auto, 'collocation compensated'.",
        autocompletion=lambda: [(name, m.summary) for name, m in all_methods().items()],
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Check the file and count its cases, but run none.")
]
Samples = Annotated[
    int, typer.Option("--samples", "-n", min=1, help="Number of random machines for each plan.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the random machines.")]


def refuse_given(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Refuse options that the user has given although they cannot be used.

    Args:
        context: The command's call.
        names: Names of the command's arguments.
        why: What is wrong with giving them, for the message.

    Raises:
        InputError: If any of them is given.
    """
    found = {name: context.get_parameter_source(name) for name in names}
    given = [name for name, kind in found.items() if kind and kind.name != "DEFAULT"]
    if options := [each.opts[0] for each in context.command.params if each.name in given]:
        raise InputError(f"{' and '.join(options)}: {why}")


def read_problem(path: Path, changes: list[str] | None, machine: Path | None = None) -> Problem:
    """Read a problem file; apply the machine of `--machine`, then the changes of `--set`.

    Raises:
        InputError: If a file or a change is invalid.
    """
    parsed = parse_changes(changes or [])
    if machine is not None:
        parsed = {"machine": load_machine(machine).to_dict(), **parsed}
    try:
        return load_problem(path, parsed)
    except InputError as error:
        fine = _loads(path, {})
        guilty = [
            key
            for key, value in parsed.items()
            if _loads(path, {k: v for k, v in parsed.items() if k != key})
            or (fine and not _loads(path, {key: value}))
        ]
        note = f"\n(from --set: {', '.join(guilty)})" if guilty else ""
        raise InputError(f"{error}{note}") from None


def is_plan(path: Path) -> bool:
    """Return whether the name of a file is that of a plan (.json), not of a problem."""
    return path.suffix.lower() == ".json"


def parse_changes(pairs: list[str]) -> dict[str, Any]:
    """Parse the words after `--set`, each `key=value`, into values by dotted key.

    Raises:
        InputError: If a word does not have that form or its value is not TOML.
    """
    out: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        key, text = key.strip(), text.strip()
        if not equals or not text or not all(part.strip() for part in key.split(".")):
            raise InputError(
                f"--set {shorten(pair)}: write it as key=value, as in --set goal.travel=0.8"
            )
        if key.count(".") > MOST_LEVELS:
            raise InputError(f"--set {shorten(pair)}: the key has more than {MOST_LEVELS} parts")
        try:
            out[key] = toml_value(text)
        except ValueError:
            raise InputError(
                f"--set {shorten(pair)}: cannot read the value {shorten(text)!r}; write a number,"
                " true, a [list] or a text in quotes"
            ) from None
    return out


def _loads(path: Path, changes: Mapping[str, Any]) -> bool:
    with suppress(InputError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        load_problem(path, changes)
        return True
    return False
