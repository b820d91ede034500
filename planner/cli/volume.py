"""`--quiet` and `--verbose`, which every command has."""

from __future__ import annotations

import functools
import inspect
import time
from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

import typer

from planner.cli.output import detail, volume
from planner.errors import InputError
from planner.report.provenance import versions

Command = Callable[..., int]

_OPTIONS = {
    "quiet": Annotated[
        bool,
        typer.Option("--quiet", "-q", help="Say nothing but the result, warnings and errors."),
    ],
    "verbose": Annotated[
        bool,
        typer.Option("--verbose", "-v", help="Say on standard error what is done and how long."),
    ],
}


def with_volume(command: Command) -> Command:
    """The command with both options after its own."""
    signature = inspect.signature(command)
    extra = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option)
        for name, option in _OPTIONS.items()
    ]

    @functools.wraps(command)
    def run(*words: Any, quiet: bool = False, verbose: bool = False, **options: Any) -> int:
        if quiet and verbose:
            raise InputError("--quiet and --verbose say opposite things; give one of them")
        volume.quiet, volume.verbose = quiet, verbose
        began = time.monotonic()
        detail(", ".join(f"{name} {number}" for name, number in versions().items()))
        try:
            return command(*words, **options)
        finally:
            detail(f"{command.__name__}: {time.monotonic() - began:.3g} s in all")

    hints = get_type_hints(command, include_extras=True)
    own = [p.replace(annotation=hints[p.name]) for p in signature.parameters.values()]
    run.__signature__ = signature.replace(parameters=[*own, *extra])  # type: ignore[attr-defined]
    run.__annotations__ = {**hints, **_OPTIONS}
    return run
