"""How a result was made: versions, and the command that makes it again."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping
from dataclasses import replace
from importlib import metadata
from typing import TYPE_CHECKING, Any

from planner.distribution import version
from planner.errors import InputError
from planner.machine import Machine
from planner.problem import load_problem
from planner.reading import toml

if TYPE_CHECKING:
    from planner.comparison import Comparison, Row

LIBRARIES = ("casadi", "numpy", "scipy", "osqp")


def versions() -> dict[str, str]:
    """Versions of the planner, of Python, and of the libraries that numbers depend on."""
    return {
        "planner": version(),
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in LIBRARIES},
    }


def command(comparison: Comparison, out: str | None = None, *, report: bool = False) -> str | None:
    """The command line that repeats a comparison.

    Whatever the problem or the machine changes against the problem's file becomes a `--set`.

    Args:
        comparison: What to repeat.
        out: The folder to name.
        report: Whether that folder holds a page.

    Returns:
        The command, or None if no command gives this problem (its file is gone, or lacks what
        only the file can take away).
    """
    settings = _settings(comparison)
    if settings is None:
        return None
    words = ["planner", "compare", comparison.problem.source]
    words += ["--methods", ",".join(dict.fromkeys(row.spec for row in comparison.rows))]
    words += ["--feedback"] * any(row.feedback for row in comparison.rows)
    for drawn in comparison.chosen or ():
        words += ["--sample", str(drawn)]
    if comparison.chosen is None:
        words += ["--samples", str(comparison.samples)]
    words += ["--seed", str(comparison.seed)]
    for key, value in settings.items():
        words += ["--set", f"{key}={toml(value)}"]
    if out is not None:
        words += ["--out", out, *["--report"] * report]
    return shlex.join(words)


def worst_command(comparison: Comparison, row: Row) -> str | None:
    """The command line that replays a row's worst machine alone; None where there is none."""
    if row.worst is None:
        return None
    alone = replace(comparison, rows=(row,), chosen=(row.worst,))
    return command(alone)


def _settings(comparison: Comparison) -> dict[str, Any] | None:
    problem, machine = comparison.problem, comparison.machine
    try:
        filed = load_problem(problem.source)
    except InputError:
        return None
    settings = _changes(filed.to_dict(), problem.to_dict())
    if settings is None:
        return None
    usual = Machine.from_table(problem.machine).to_dict()
    own = machine.to_dict()
    changed = {f"machine.{key}": own[key] for key in own if own[key] != usual[key]}
    return {**settings, **changed}


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any] | None:
    """Dotted keys to values that turn one table into another; None if a key would have to go."""
    out: dict[str, Any] = {}
    if before.keys() - after.keys():
        return None
    for key, value in after.items():
        old = before.get(key, {} if isinstance(value, Mapping) else None)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            inner = _changes(old, value)
            if inner is None:
                return None
            out |= {f"{key}.{name}": item for name, item in inner.items()}
        elif value != old:
            out[key] = value
    return out
