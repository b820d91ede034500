"""What a problem changes in its file, as the options `--set` of a command that repeats it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from planner.errors import InputError
from planner.problem.problem import Problem, load_problem
from planner.support.files import toml


def changed_settings(
    problem: Problem, changes: Mapping[str, Any] | None = None
) -> dict[str, Any] | None:
    """Return the dotted keys, with values, in which a problem differs from its file.

    Args:
        problem: The problem.
        changes: Changes of the file that other options of the command make, such as `--machine`.

    Returns:
        The keys; None if no command gives this problem: its file is missing, or has a key that
        `--set` cannot remove.
    """
    try:
        filed = load_problem(problem.source, changes)
    except InputError:
        return None
    return _differences(filed.to_dict(), problem.to_dict())


def problem_words(
    problem: Problem, options: Sequence[str] = (), changes: Mapping[str, Any] | None = None
) -> list[str]:
    """Return the words of a command line that name a problem: file, options and `--set` options.

    `options`, such as `--machine FILE`, make the `changes` of the file.
    """
    return [problem.source, *options, *set_words(changed_settings(problem, changes) or {})]


def set_words(settings: Mapping[str, Any]) -> list[str]:
    """Return the `--set` options for dotted keys and values."""
    return [word for k, v in settings.items() for word in ("--set", f"{k}={toml(v)}")]


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return dotted keys and values that change one table into another; None if a key must go."""
    out: dict[str, Any] = {}
    if before.keys() - after.keys():
        return None
    for key, value in after.items():
        old = before.get(key, {} if isinstance(value, Mapping) else None)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            inner = _differences(old, value)
            if inner is None:
                return None
            out |= {f"{key}.{name}": item for name, item in inner.items()}
        elif value != old:
            out[key] = value
    return out
