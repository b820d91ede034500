"""A commented problem file for each kind of system.

What every problem says stands in heads/KIND.toml. The options of the methods and the settings of
the machine come from the tables that read them, so that the file names every key there is.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from pydantic import BaseModel

from planner.errors import InputError
from planner.machine import Machine
from planner.methods import METHODS
from planner.reading import toml
from planner.schema import FILES, MachineTable, MethodsTable, nearest
from planner.schema.feedback import FeedbackTable

WIDTH = 100

_LEGEND = """\
# A problem file of planner. Try it:
#   planner check FILE       is there a plan, and if not, why
#   planner compare FILE     several methods, replayed on one emulated machine
# Remove the # before a key to set it; the values shown are the ones used when it is left out, or
# examples. Angles in degrees end in _deg, times are in seconds.
#
"""


def problem_text(kind: str = "manipulator") -> str:
    """The text of a problem file (TOML) that can be solved as it is.

    Args:
        kind: A key of `planner.schema.FILES`.

    Raises:
        InputError: If there is no such kind.
    """
    if kind not in FILES:
        raise InputError(f"no system '{kind}'; {nearest(kind, list(FILES))}")
    head = files("planner.starter").joinpath(f"heads/{kind}.toml").read_text(encoding="utf-8")
    parts = [_LEGEND + head]
    for name, field in MethodsTable.model_fields.items():
        table: Any = field.annotation
        summary = METHODS[name].summary if name in METHODS else ""
        parts.append(f"[method.{name}]\n{_prose(summary)}{_keys(table, _defaults(table))}")
    about = "The tracker that closes the loop: planner compare FILE --feedback."
    parts.append(f"[feedback]\n{_prose(about)}{_keys(FeedbackTable, _defaults(FeedbackTable))}")
    preset = {**_defaults(MachineTable), **Machine.prototype().to_dict()}
    about = "The emulated machine. Each effect is a number, or { value = mean, spread = standard"
    about += " deviation } over machines, or false, which switches it off."
    parts.append(f"[machine]\n{_prose(about)}{_keys(MachineTable, preset)}")
    return "\n".join(parts)


def _defaults(table: type[BaseModel]) -> Mapping[str, Any]:
    return {
        name: field.get_default(call_default_factory=True)
        for name, field in table.model_fields.items()
    }


def _keys(table: type[BaseModel], values: Mapping[str, Any]) -> str:
    """Each key of a table as a comment, what it means above it."""
    lines = []
    for name, field in table.model_fields.items():
        key, value = field.alias or name, values[name]
        shown = "# " + f"{key}: not set" if value is None else f"#{key} = {toml(value)}"
        lines.append(f"{_prose(field.description or '')}{shown}\n")
    return "".join(lines)


def _prose(text: str) -> str:
    if not text:
        return ""
    return (
        textwrap.fill(
            text, WIDTH, initial_indent="#   ", subsequent_indent="#   ", break_on_hyphens=False
        )
        + "\n"
    )
