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


_result_writer: Callable[[str], object] | None = None
"""What writes the one JSON object, where `reserve_output` has put standard output aside."""


@contextmanager
def reserve_output(active: bool, last: bool) -> Iterator[None]:
    """Keep standard output for the one JSON object of `--json`.

    What is printed otherwise goes to standard error: by packages with plugins, by libraries, and,
    where standard output is the process's own, by compiled code and other processes too.

    Args:
        active: Whether to do so at all.
        last: Whether the process ends after the block, so that it stays so.
    """
    global _result_writer
    if not active:
        yield
        return
    stream, copy = sys.stdout, None
    with suppress(OSError, ValueError):  # not a stream of the system's, or no standard error
        if stream.fileno() == 1:
            stream.flush()
            copy = os.dup(1)
            os.dup2(2, 1)
    _result_writer = stream.write if copy is None else partial(_write_all, copy)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        if not last:
            sys.stdout, _result_writer = stream, None
            if copy is not None:
                os.dup2(copy, 1)
                os.close(copy)


def _write_all(number: int, text: str) -> None:
    """Write all of a text to a file by its number; nothing is left to be written at the end."""
    rest = text.encode()
    while rest:
        rest = rest[os.write(number, rest) :]


def write_result(text: str) -> None:
    """Put a text on standard output.

    Raises:
        InputError: If that cannot be written (a full disk).
        ReaderGoneError: If nobody reads it.
    """
    with translate_output_errors():
        (_result_writer or sys.stdout.write)(text)
        sys.stdout.flush()


@contextmanager
def translate_output_errors() -> Iterator[None]:
    """What becomes of errors of standard output; Rich writes to it even where it captures."""
    try:
        yield
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise InputError(f"cannot write standard output: {error.strerror or error}") from None
