"""`planner new`, `methods`, `systems` and `schema`: list what exists, and write a first file.

The problem in a new file is the `example` of its kind. Other limits, the options of the methods and
the settings of the machine come from the tables that read them, so the file names every key.
"""

from __future__ import annotations

import re
import sys
import textwrap
import tomllib
from collections.abc import Callable, Mapping
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import BaseModel

from planner.cli.output import manner, note, print_json, print_text
from planner.errors import InputError
from planner.problem.tables.arms import MOST_JOINTS, ArmFile
from planner.problem.tables.kinds import (
    all_files,
    example_of,
    json_schema,
    limits_of,
    parse_file,
    system_of,
)
from planner.problem.tables.machine_effects import EFFECTS, MachineTable
from planner.problem.tables.problem_file import CompensationTable, FeedbackTable, ProblemFile
from planner.support.files import refuse_unwritable, toml, write_text
from planner.support.tables import Column, CommandLine, clean_text, terminal_table
from planner.support.user_tables import allowed_hint
from planner.systems.manipulator import prototype_ratios


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
            help="The kind of system; `planner systems` lists them.",
            autocompletion=lambda: list(_summaries().items()),
        ),
    ] = "manipulator",
    joints: Annotated[
        int | None,
        typer.Option("--joints", "-n", metavar="N", help="Number of joints of an arm. Default: 3."),
    ] = None,
    full: Annotated[
        bool,
        typer.Option(
            "--full/--brief",
            help="Add every option of methods, feedback, compensation and the machine.",
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace FILE if it exists.")] = False,
) -> int:
    """Write a commented problem file that can be solved as it is.

    The file holds every key of the problem itself; with --full also the keys of the methods and
    of the emulated machine, with their defaults.

    \b
    Examples:
      planner new
      planner new four.toml --joints 4 --full
      planner new lane-change.toml --system car
    """
    refuse_unwritable(file)
    text = problem_text(system, joints=joints, full=full)
    text = text.replace("FILE", " ".join(clean_text(CommandLine.of(str(file))).splitlines()))
    if file.exists() and not force:
        raise InputError(f"{file} exists; name another file, or replace it with --force")
    written = write_text(file, text)
    if manner.as_json:
        print_json({"written": written, "system": system, "exit_status": 0})
    note(CommandLine.of("planner", "check", str(file), after=f"written to {file}; next: "))
    return 0


def methods() -> int:
    """List the planning methods, one per line.

    Prints only the names if the output is not a terminal.

    \b
    Example:
      planner methods
    """
    from planner.methods.registry import all_methods

    return _print_list("method", {name: m.summary for name, m in all_methods().items()})


def systems() -> int:
    """List the kinds of systems, one per line.

    Prints only the names if the output is not a terminal.

    \b
    Example:
      planner systems
    """
    return _print_list("system.kind", _summaries())


def _summaries() -> dict[str, str]:
    """Return the one-line summary of every `system.kind`."""
    return {kind: file.summary for kind, file in all_files().items()}


def schema(
    of: Annotated[
        str,
        typer.Argument(
            metavar="problem|sweep|design|plan",
            help="Kind of file: problem, sweep, design or plan.",
            autocompletion=lambda: list(SCHEMAS),
        ),
    ] = "problem",
    as_json: Annotated[
        bool, typer.Option("--json", help="No effect: the output is JSON in any case.")
    ] = False,
) -> int:
    """Print the JSON Schema of a kind of file.

    \b
    Examples:
      planner schema > problem.schema.json
      planner schema sweep > sweep.schema.json
      planner schema design > design.schema.json
      planner schema plan > plan.schema.json
    """
    if of not in SCHEMAS:
        raise InputError(f"no schema of '{of}'; {allowed_hint(of, SCHEMAS)}")
    # Imported here because `planner new` does not need them.
    from planner.plan.plan_file import plan_schema
    from planner.sweep.design.design_file import DesignFile
    from planner.sweep.sweep_file import SweepFile

    makers: dict[str, Callable[[], dict[str, Any]]] = {
        "problem": json_schema,
        "sweep": SweepFile.model_json_schema,
        "design": DesignFile.model_json_schema,
        "plan": lambda: plan_schema(json_schema()),
    }
    print_json(makers[of]())
    return 0


SCHEMAS = ("problem", "sweep", "design", "plan")


def _print_list(what: str, summaries: dict[str, str]) -> int:
    if manner.as_json:
        print_json(summaries)
    elif not sys.stdout.isatty():  # names alone suit a loop in a shell
        print_text(*summaries)
    else:
        heads = (what, "what it is")
        columns = [Column(head, "", itemgetter(k), left=True) for k, head in enumerate(heads)]
        print_text(terminal_table(columns, summaries.items()))
    return 0


LINE_WIDTH = 100

_LEGEND = """\
# A problem file of planner. Try it:
#   planner check FILE       is there a plan, and if not, why not
#   planner compare FILE     several methods, replayed on the same emulated machines
# Remove the # before a key to set it. The values shown are defaults or examples. Keys of angles in
# degrees end in _deg; times are in seconds.
#
"""


def problem_text(
    kind: str = "manipulator", *, joints: int | None = None, full: bool = False
) -> str:
    """Return the text of a problem file (TOML) that can be solved as it is.

    Args:
        kind: A key of `planner.problem.tables.kinds.FILES`.
        joints: Number of joints of an arm. By default that of the shipped example.
        full: Whether to add the options of methods, feedback, compensation and the machine.

    Raises:
        InputError: If the kind is unknown or cannot have this number of joints.
    """
    kinds = all_files()
    if kind not in kinds:
        raise InputError(f"no system '{kind}'; {allowed_hint(kind, list(kinds))}")
    file = kinds[kind]
    last = system_of(parse_file(tomllib.loads(example_of(kind)), kind)).user_coordinates[-1]
    head = _add_limits(f"{example_of(kind)}\n", limits_of(file))
    head += file.places.replace("COORDINATE", last.name)
    if joints is not None:
        head = _resize_arm(head, kind, file, joints)
    parts = [f"{_LEGEND}{head}"]
    if not full:
        about = "Methods, feedback and the emulated machine have keys too: planner new OTHER"
        return f"{parts[0]}\n#   {about} --system {kind} --full\n"
    # Imported here because a short file does not need them.
    from planner.machine.machine import Machine
    from planner.methods.registry import all_methods

    parts += [_table_text(f"method.{k}", m.summary, m.options) for k, m in all_methods().items()]
    about = "Commands that compensate the machine's systematic errors. With on = true the plans"
    about += " of all methods are compensated."
    parts.append(_table_text("compensation", about, CompensationTable))
    about = "The tracker that closes the loop: planner compare FILE --feedback."
    parts.append(_table_text("feedback", about, FeedbackTable))
    joints = system_of(parse_file(tomllib.loads(parts[0]), kind)).size - 1
    preset = Machine.prototype().to_dict()
    for name, effect in EFFECTS.items():  # lists fit the prototype's joints only
        setting = preset.get(name)
        mean = setting["value"] if isinstance(setting, Mapping) else setting
        if isinstance(mean, list) and effect.mismatch(name, mean, joints):
            preset[name] = None
    about = "The emulated machine. Each effect is a number, or { value = mean, spread = standard"
    about += " deviation } over machines, or false, which switches it off."
    parts.append(_table_text("machine", about, MachineTable, preset))
    return "\n".join(parts)


def _resize_arm(head: str, kind: str, file: type[ProblemFile], joints: int) -> str:
    """Return the head of an arm's file for another number of joints.

    Lists repeat their last entry; K continues with the prototype's ratio. With more joints,
    duration and travel become free, because those of the example do not suffice.
    """
    if not issubclass(file, ArmFile):
        arms = ", ".join(name for name, each in all_files().items() if issubclass(each, ArmFile))
        raise InputError(f"--joints is for {arms}; a {kind} has no number of joints")
    if not 2 <= joints <= MOST_JOINTS:
        raise InputError(f"--joints {joints}: an arm here has 2 to {MOST_JOINTS} joints")
    shipped = tomllib.loads(head)["system"]["joints"]

    def resize(match: re.Match[str]) -> str:
        entries = match[2].split(", ")
        if match[1].startswith("K"):
            return f"{match[1]}{toml(prototype_ratios(joints))}"
        return f"{match[1]}[{', '.join([*entries, *entries[-1:] * joints][:joints])}]"

    text = re.sub(r"((?:K|theta_deg|link_lengths) = )\[([^\]]*)\]", resize, head)
    text = text.replace(f"joints = {shipped}", f"joints = {joints}")
    if joints > shipped:
        text = re.sub(r"(?m)^(travel|duration) = [\w.]+ ", r'\1 = "free" ', text)
    return re.sub(r"(?m)^(\S.*?) +(# .*)$", lambda row: f"{row[1]:<28} {row[2]}", text)


def _add_limits(head: str, table: type[BaseModel]) -> str:
    """Return the head of a file with all limits that it lacks, as comments in its `[limits]`."""
    if not (section := re.search(r"(?m)^\[limits\].*\n(?:(?!\[).+\n)*", head)):
        return _add_limits(f"{head}\n[limits]\n", table)
    rows = []
    for key, field in table.model_fields.items():
        if re.search(rf"(?m)^#? ?{key} =", section[0]):
            continue
        about, entry = field.description or "", f"# {key}: not set"
        if field.examples:
            entry = f"#{key} = {toml(field.examples[0])}"
        row = f"{entry:<28} # {about[:1].lower()}{about[1:].rstrip('.')}"
        rows.append(f"{row}\n" if len(row) <= LINE_WIDTH else f"{_comment_lines(about)}{entry}\n")
    return head[: section.end()] + "".join(rows) + head[section.end() :]


def _table_text(
    title: str, about: str, table: type[BaseModel], values: Mapping[str, Any] | None = None
) -> str:
    """Return the text of a table as comments: the meaning of each key, then its value."""
    lines = [f"[{title}]\n{_comment_lines(about)}"]
    for name, field in table.model_fields.items():
        default = field.get_default(call_default_factory=True)
        key, value = field.alias or name, (values or {}).get(name, default)
        entry = "# " + f"{key}: not set" if value is None else f"#{key} = {toml(value)}"
        lines.append(f"{_comment_lines(field.description or '')}{entry}\n")
    return "".join(lines)


def _comment_lines(text: str) -> str:
    filled = textwrap.fill(text, LINE_WIDTH - 4, break_on_hyphens=False)
    return textwrap.indent(f"{filled}\n", "#   ") if text else ""
