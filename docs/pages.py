"""The pages of the reference that are made from the program (`make generated`)."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer
from pydantic import BaseModel

import planner
from planner.cli.app import COMMANDS, load_command
from planner.cli.output import add_common_options
from planner.machine.replay import ERRORS, STATISTICS
from planner.problem.tables.kinds import FILES
from planner.problem.tables.machine_effects import EFFECTS, MachineTable
from planner.problem.tables.problem_file import CompensationTable, FeedbackTable
from planner.report.export import FORMATS
from planner.sweep.design.design_file import (
    DesignFile,
    MachinesTable,
    PairTable,
    TasksTable,
    VariablesTable,
)
from planner.sweep.sweep_file import SweepFile

KEEPING = {"kept": "kept", "judged": "checked", "never": "refused"}
"""What a method does about a requirement, in a reader's words."""

ROOT = Path(__file__).parents[1]


REFERENCE = ROOT / "docs" / "reference"


def pages() -> dict[Path, str]:
    """By path: the text of each page in docs/reference that is made from the program."""
    return {
        REFERENCE / f"{make.__name__.replace('_', '-')}.md": make()
        for make in (commands, methods, problem_file, machine, formats, sweep_file, design_file)
    }


def copy_sources(docs: Path) -> None:
    """Copy notebooks and the problems that they read, since Sphinx reads nothing outside docs."""
    for name in ("notebooks", "problems"):
        shutil.copytree(
            ROOT / name,
            docs / name,
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns(".ipynb_checkpoints"),
        )


def formats() -> str:
    """What `planner export` writes."""
    rows = [
        [f"`{name}`", ", ".join(one.endings), one.holds, f"`{one.reader}`" if one.reader else ""]
        for name, one in FORMATS.items()
    ]
    about = "`planner export PLAN --out FILE`: the ending of FILE, or `--format`, says which."
    return f"# Export formats\n\n{about}\n\n" + _table(
        ["format", "endings", "content", "read it with"], rows
    )


def escaped(line: str) -> str:
    """A docstring's line with bars, stars and trailing underscores outside of code escaped."""
    parts = re.split(r"(``.*?``|`.*?`|:\w+:)", line)
    for k in range(0, len(parts), 2):
        parts[k] = re.sub(r"(?<!\\)([|*])", r"\\\1", parts[k])
        parts[k] = re.sub(r"(\w)_(?=\W|$)", r"\1\\_", parts[k])
    return "".join(parts)


# -- commands ----------------------------------------------------------------------------------


def commands() -> str:
    """The help of every command, and a table of its options."""
    parts = ["# Commands\n", "`planner COMMAND --help` prints the same in a terminal.\n"]
    parts += [f"## planner {name}\n\n{_command(name)}" for name in COMMANDS]
    return "\n".join(parts)


def _command(name: str) -> str:
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    single.command(name)(add_common_options(load_command(name)))
    command = typer.main.get_command(single)
    rows = []
    for one in command.params:
        words = one.opts if one.opts[0].startswith("-") else [one.metavar or one.name]
        value = f" {one.metavar}" if one.metavar and words == one.opts else ""
        cell = ", ".join(f"`{word}{value}`" for word in words)
        rows.append([cell, (one.help or "").replace("|", "\\|")])
    text = (command.help or "").replace("\b\n", "")
    return f"```text\n{text}\n```\n\n" + _table(["option", "what it is"], rows)


# -- tables ------------------------------------------------------------------------------------


def methods() -> str:
    """Every method and its options."""
    parts = ["# Methods and their options\n"]
    parts.append(
        "The tables `[method.NAME]` of a problem file, and the keywords of `planner.solve`.\n"
    )
    parts += ["## What each method promises\n", promises()]
    for method in planner.METHODS.values():
        parts += [f"## {method.name}\n", method.summary + ".\n", table(method.options)]
    return "\n".join(parts)


ASKED: tuple[dict[str, Any], ...] = (
    {},
    {"limits.input_rate_rad_s2": 5.0},
    {"limits.input_rate_rad_s2": 5.0, "goal.duration": "free"},
    {"limits.input_rate_rad_s2": 5.0, "goal.travel": 0.0},
)
"""Changes of the problem files with which every answer is given once."""


def promises() -> str:
    """What each method answers for each kind of requirement, over the problem files."""
    found: dict[type, dict[str, set[str]]] = {}
    for path in sorted((ROOT / "problems").glob("*.toml")):
        for changes in ASKED:
            try:
                problem = planner.load_problem(path, changes)
            except planner.InputError:  # a vehicle's travel, a waypoint's time
                continue
            for demand in problem.demands:
                own = found.setdefault(type(demand), {name: set() for name in planner.METHODS})
                for name, method in planner.METHODS.items():
                    own[name] |= {method.keeps(problem, demand, part) for part in demand.parts}
    rows = []
    for kind, own in found.items():
        what = (kind.__doc__ or "").splitlines()[0].replace("|", "\\|")
        words = ({KEEPING[answer] for answer in answers} for answers in own.values())
        rows.append([what, *(" or ".join(sorted(each, reverse=True)) for each in words)])
    return (
        "*kept*: the method keeps the requirement during planning. *checked*: the finished plan is"
        " checked, and refused if it breaks the requirement. *refused*: the problem is refused"
        " before the method begins. Where there are two answers, the problem decides;"
        " `planner check --verbose` says which holds, and `planner/methods/keeping.py` why.\n\n"
        + _table(["what is asked", *planner.METHODS], rows)
    )


def problem_file() -> str:
    """Every key of a problem file, kind by kind."""
    parts = ["# The problem file\n"]
    parts.append(
        "TOML. The tables `[system]`, `[start]`, `[goal]` and `[limits]` differ from kind to kind"
        " of system; `[method.NAME]` and `[machine]` have pages of their own. `planner new` writes"
        " a commented file to start from.\n"
    )
    parts += ["## feedback\n", "The same for all kinds.\n", *_described("feedback", FeedbackTable)]
    parts += [
        "## compensation\n",
        "The same for all kinds; only the arm with friction disks has something to allow for.\n",
        *_described("compensation", CompensationTable),
    ]
    for kind, model in FILES.items():
        parts.append(f"## {kind}\n")
        for name, field in model.model_fields.items():
            if name not in ("title", "method", "machine", "feedback", "compensation"):
                parts += _tables(name, field.annotation, f" of {kind}")
    return "\n".join(parts)


def _tables(name: str, annotation: Any, whose: str) -> list[str]:
    """The tables that a key may hold, each followed by those inside it."""
    found = []
    for model in _models(annotation):
        several = get_origin(annotation) is list
        found += _described(f"[{name}]" if several else name, model, whose)
        for key, field in model.model_fields.items():
            found += _tables(f"{name}.{field.alias or key}", field.annotation, whose)
    return found


def _described(name: str, model: type[BaseModel], whose: str = "") -> list[str]:
    return [f"### [{name}]{whose}\n", table(model)]


def sweep_file() -> str:
    """Every key of a sweep file."""
    return "# The sweep file\n\n" + table(SweepFile)


def design_file() -> str:
    """Every key of a design file."""
    parts = ["# The design file\n", table(DesignFile)]
    parts += ["\n## Design variables, in `grid` and `cases`\n", table(VariablesTable)]
    tables = {"tasks": TasksTable, "tasks.pairs": PairTable, "replay": MachinesTable}
    for name, model in tables.items():
        parts += [f"\n## [{name}]\n", table(model)]
    return "\n".join(parts)


def machine() -> str:
    """Every effect of the emulated machine, with its value in the prototype."""
    used = planner.Machine.prototype().to_dict()
    parts = [
        "# The emulated machine\n",
        "The table `[machine]`, and the keywords of `Machine.prototype`.\n",
    ]
    rows = [
        [
            f"`{name}`",
            effect.unit or "1",
            effect.owner,
            _code(used[name]),
            _about(MachineTable, name),
        ]
        for name, effect in EFFECTS.items()
    ]
    parts.append(_table(["effect", "unit", "one a", "prototype", "what it is"], rows))
    others = [name for name in MachineTable.model_fields if name not in EFFECTS]
    parts += ["\n## Beside the effects\n", table(MachineTable, others)]
    parts += ["\n## Errors of a replay\n", "On one machine, degrees:\n"]
    parts.append(_table(["error", "what it is"], [[f"`{n}`", e.words] for n, e in ERRORS.items()]))
    parts.append("\nOver the machines, in `Replay.to_dict()`, rows, CSV and JSON, degrees:\n")
    rows = [
        [f"`{name}`", one.title, one.error, str(one.percent)] for name, one in STATISTICS.items()
    ]
    parts.append(_table(["name", "heading", "error", "percentile"], rows))
    return "\n".join(parts)


def table(model: type[BaseModel], names: list[str] | None = None) -> str:
    """Keys of a table: what each is, and what it is when left out."""
    rows = []
    for name in names or list(model.model_fields):
        field = model.model_fields[name]
        default = "needed" if field.is_required() else _code(_default(field))
        rows.append(
            [f"`{field.alias or name}`", _type(field.annotation), default, _about(model, name)]
        )
    return _table(["key", "value", "when left out", "what it is"], rows)


def _default(field: Any) -> Any:
    value = field.get_default(call_default_factory=True)
    return "" if isinstance(value, BaseModel) else value


def _about(model: type[BaseModel], name: str) -> str:
    return (model.model_fields[name].description or "").replace("|", "\\|").replace("*", "\\*")


def _models(annotation: Any) -> list[type[BaseModel]]:
    """The tables that an annotation speaks of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation] if annotation.model_fields else []
    return [model for part in get_args(annotation) for model in _models(part)]


PLAIN = {float: "number", int: "whole number", str: "text", bool: "true or false", dict: "table"}


def _type(annotation: Any) -> str:
    """What may stand there, in words; empty where only its description says it."""
    parts, origin = get_args(annotation), get_origin(annotation)
    if origin is Literal:
        return " or ".join(f"`{part}`" for part in parts)
    if origin in (list, tuple):
        return "list of " + (_type(parts[0]) or "values")
    if parts and origin is not dict:
        return " or ".join(dict.fromkeys(word for word in map(_type, parts) if word))
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    return PLAIN.get(origin or annotation, "")


def _code(value: Any) -> str:
    if value is None or value == "":
        return ""
    if value is False or value is True:
        return f"`{str(value).lower()}`"
    return f"`{value}`".replace("'", '"')


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
