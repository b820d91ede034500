"""Standard output: results only, and what becomes of its errors."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial

from planner.errors import InputError


class ReaderGoneError(Exception):
    """Nobody reads standard output any more (planner schema | head)."""


_results: Callable[[str], object] | None = None
"""What writes the one JSON object, where `results_alone` has put standard output aside."""


@contextmanager
def results_alone(wanted: bool, last: bool) -> Iterator[None]:
    """Keep standard output for the one JSON object of `--json`.

    What is printed otherwise goes to standard error: by packages with plugins, by libraries, and,
    where standard output is the process's own, by compiled code and other processes too.

    Args:
        wanted: Whether to do so at all.
        last: Whether the process ends after the block, so that it stays so.
    """
    global _results
    if not wanted:
        yield
        return
    before, own = sys.stdout, None
    with suppress(OSError, ValueError):  # not a stream of the system's, or no standard error
        if before.fileno() == 1:
            before.flush()
            own = os.dup(1)
            os.dup2(2, 1)
    _results = before.write if own is None else partial(_put, own)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        if not last:
            sys.stdout, _results = before, None
            if own is not None:
                os.dup2(own, 1)
                os.close(own)


def _put(number: int, text: str) -> None:
    """Write all of a text to a file by its number; nothing is left to be written at the end."""
    left = text.encode()
    while left:
        left = left[os.write(number, left) :]


def write_result(text: str) -> None:
    """Put a text on standard output.

    Raises:
        InputError: If that cannot be written (a full disk).
        ReaderGoneError: If nobody reads it.
    """
    with told_where_it_fails():
        (_results or sys.stdout.write)(text)
        sys.stdout.flush()


@contextmanager
def told_where_it_fails() -> Iterator[None]:
    """What becomes of errors of standard output; Rich writes to it even where it captures."""
    try:
        yield
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise InputError(f"cannot write standard output: {error.strerror or error}") from None
