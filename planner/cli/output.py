"""Output of commands: results on standard output, everything else on standard error.

This file also translates errors of standard output, and adds `--json`, `--quiet` and `--verbose`.
"""

from __future__ import annotations

import codecs
import inspect
import io
import json
import os
import sys
import threading
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.progress import Progress as Bar
from rich.segment import Segment
from rich.table import Column as TableColumn
from rich.table import Table
from rich.text import Text

from planner.errors import InputError, PlannerError
from planner.support import deadline
from planner.support.arrays import jsonable
from planner.support.interrupts import Terminated, signal_listener
from planner.support.package import versions
from planner.support.progress import Progress, progress_listener
from planner.support.tables import TABLE_WIDTH, CommandLine, clean_text, four_digits

INTERRUPT_STATUS = 130
PROGRESS_DELAY_S = 2.0
"""Progress is shown only for jobs that take longer than this, in seconds."""


FINISH_MESSAGE = b"planner: finishing with the best plan found so far; Ctrl-C again ends at once\n"
LOG_INTERVAL_S = 10.0
"""Time between progress lines where standard error is not a terminal, in seconds."""


class ReaderGoneError(Exception):
    """The reader of standard output has closed it (planner schema | head)."""


_result_writer: Callable[[str], object] | None = None
"""Function that writes the JSON object while `reserve_output` redirects other output, or None."""


PLAIN = {"−": "-", "–": "-", "·": "*", "×": "x", "±": "+-", "→": "->", "≤": "<=", "≥": ">="}
"""Replacements for characters that a console lacks; others lose their accents or become "?"."""


def _nearest(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII in place of characters that a console lacks; an error handler of `codecs`."""
    assert isinstance(error, UnicodeEncodeError)
    parts = unicodedata.normalize("NFKD", error.object[error.start : error.end])
    plain = (PLAIN.get(c, c) for c in parts if not unicodedata.combining(c))
    return "".join(plain).encode("ascii", "replace").decode(), error.end


codecs.register_error("planner-nearest", _nearest)


@contextmanager
def fit_console() -> Iterator[None]:
    """Replace characters that standard output or standard error cannot encode, within the block."""
    streams = [each for each in (sys.stdout, sys.stderr) if isinstance(each, io.TextIOWrapper)]
    before = [each.errors for each in streams]
    for stream in streams:
        stream.reconfigure(errors="planner-nearest")
    try:
        yield
    finally:
        for stream, errors in zip(streams, before, strict=True):
            with suppress(ValueError, OSError):  # closed, or its buffer cannot be written
                stream.reconfigure(errors=errors)


@contextmanager
def reserve_output(active: bool, last: bool) -> Iterator[None]:
    """Reserve standard output for the JSON object of `--json`.

    All other output goes to standard error: that of plugins and libraries and, if standard output
    is file descriptor 1, that of compiled code and child processes.

    Args:
        active: Whether to redirect; without it the block has no effect.
        last: Whether the process ends after the block; then the redirection stays.
    """
    global _result_writer
    if not active:
        yield
        return
    stream, copy = sys.stdout, None
    with suppress(OSError, ValueError):  # no file descriptor, or no standard error
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
    """Write a text to a file descriptor, repeating `os.write` until all of it is written."""
    rest = text.encode()
    while rest:
        rest = rest[os.write(number, rest) :]


def write_result(text: str) -> None:
    """Write a text to standard output.

    Raises:
        InputError: If the text cannot be written (a full disk).
        ReaderGoneError: If the reader has closed standard output.
    """
    with translate_output_errors():
        (_result_writer or sys.stdout.write)(text)
        sys.stdout.flush()


@contextmanager
def translate_output_errors() -> Iterator[None]:
    """Translate errors of standard output, to which Rich writes even while capturing."""
    try:
        yield
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise InputError(f"cannot write standard output: {error.strerror or error}") from None


class ReportedStatus(int):
    """An exit status whose reason the command has already printed."""


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output; NaN and infinities become null.

    Raises:
        InputError: If standard output cannot be written (a full disk).
    """
    write_result(json.dumps(jsonable(data), indent=2, allow_nan=False, default=str) + "\n")


def print_text(*parts: str | Text | Table) -> None:
    """Print lines and tables on standard output, coloured only on a terminal.

    On a terminal, lines wrap at words, except lines with a command, which can then be copied. In a
    pipe no line wraps.

    Raises:
        InputError: As for `print_json`.
    """
    console = _console(stderr=False)
    with translate_output_errors(), console.capture() as capture:
        for part in parts:
            whole = isinstance(part, CommandLine) or (
                isinstance(part, str) and not console.is_terminal
            )
            console.print(part, highlight=False, markup=False, soft_wrap=whole)
    write_result("\n".join(line.rstrip() for line in capture.get().splitlines()) + "\n")


@dataclass
class Manner:
    """How a command prints; `--json`, `--quiet` and `--verbose` set it.

    Attributes:
        as_json: Whether the result is printed as one JSON object.
        quiet: Whether only the result, warnings and errors are printed.
        verbose: Whether to print each step and how long it takes.
        words: The words of the command line after `planner`.
    """

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False
    words: Sequence[str] = ()


manner = Manner()


def note(text: str) -> None:
    """Print a message on standard error, unless `--quiet` is set."""
    if not manner.quiet:
        say(text)


def detail(text: str) -> None:
    """Print a message on standard error if `--verbose` is set."""
    if manner.verbose:
        say(text, "dim")


def say(text: str, style: str = "") -> None:
    """Print a message on standard error; without effect if its reader has closed it."""
    console = _console(stderr=True)
    whole = not console.is_terminal or isinstance(text, CommandLine)
    with suppress(BrokenPipeError):
        console.print(Text(text, style=style), highlight=False, soft_wrap=whole)


number = four_digits


def numbers(values: Iterable[float]) -> str:
    """Format several numbers, separated by commas."""
    return ", ".join(map(number, values))


def finish(
    data: Mapping[str, Any], *parts: str | Table, status: int = 0, where: str = "written to {}"
) -> int:
    """End a command: print its result and where it was written, and return the exit status.

    Args:
        data: The result for `--json`; `exit_status` is added. The key `written` is where the result
            was written, or None.
        parts: Lines and tables to print without `--json`.
        status: The exit status.
        where: The message about `written`, which replaces {}.
    """
    if manner.as_json:
        print_json({**data, "exit_status": status})
    elif parts:
        print_text(*parts)
    if data.get("written") is not None:
        note(where.format(data["written"]))
    return status


class Job:
    """Display of a job's progress: a text, and a bar once the finished share is known."""

    def __init__(self, text: str) -> None:
        self.text = self.line = text
        self._share: float | None = None
        self._search = ""
        self.bar = Bar(
            SpinnerColumn(style="status.spinner"),
            TextColumn("{task.description}", markup=False, table_column=TableColumn()),  # wraps
            console=_console(stderr=True),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._task = self.bar.add_task(text, total=1.0)

    def __call__(self, text: str, share: float | None = None) -> None:
        """Set the current step and the finished share of the whole, from 0 to 1."""
        if text != self.text:
            detail(text)
        if share is not None and self._share is None:
            columns = BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
            self.bar.columns = TextColumn("{task.description}", markup=False), *columns
        self.text, self._share = text, share
        self.line = text if share is None else f"{text}, {share:.0%} done"
        self.bar.update(self._task, description=text, completed=share)

    def hear(self, progress: Progress) -> None:
        """Show the progress of a search."""
        usable = progress.best and signal_listener.substitute is _end_search
        takes = "; Ctrl-C verifies and returns it" if usable else ""
        self.line = f"{self.text}: {progress}{takes}"
        if self._share is not None:
            return
        self.bar.update(self._task, description=self.line)
        if progress.doing != self._search:
            self._search = progress.doing
            detail(progress.doing)


@contextmanager
def job(text: str = "") -> Iterator[Job]:
    """Show the progress of the block: a bar on a terminal, once the block takes a while.

    Elsewhere, for example in a log, print a line every ten seconds. The output of libraries goes to
    standard error, so that standard output has results only.
    """
    current, done, start = Job(text), threading.Event(), time.monotonic()

    def show() -> None:
        if sys.stderr.isatty() and not manner.quiet and not manner.verbose:
            if not done.wait(PROGRESS_DELAY_S):
                current.bar.start()
        elif not manner.quiet:
            while not done.wait(LOG_INTERVAL_S):
                say(f"planner: {time.monotonic() - start:.0f} s: {current.line}")

    if text:
        detail(text)
    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        with redirect_stdout(sys.stderr), progress_listener(current.hear):
            yield current
    finally:
        done.set()
        thread.join()
        if current.bar.live.is_started:
            current.bar.stop()
    if is_interrupted():  # an error may hide it
        raise signal_listener.exception


class Interruption(PlannerError):  # noqa: N818 (not an error)
    """Ctrl-C or SIGTERM stopped a command that continues when it is run again."""

    def __init__(self, progress: str) -> None:
        self.exit_status = signal_listener.status
        self.status = "interrupted" if self.exit_status == INTERRUPT_STATUS else "terminated"
        super().__init__(progress)

    def __str__(self) -> str:
        return f"{self.status}; {self.args[0]}; the same command runs the rest"


@contextmanager
def explain_interruption(what: str, place: Path) -> Iterator[None]:
    """If the block is interrupted, say where its finished results are.

    Args:
        what: The results in a word, for example "cases".
        place: Their file or folder.

    Raises:
        Interruption: After Ctrl-C or SIGTERM, even if hidden by another error, if `place` exists.
    """
    try:
        yield
    except BaseException as error:
        stopped = is_interrupted() or isinstance(error, KeyboardInterrupt | Terminated)
        if not (stopped and place.exists()):
            raise
        raise Interruption(f"finished {what} are in {place}") from None


def is_interrupted() -> bool:
    """Return whether Ctrl-C or SIGTERM has arrived since the command began."""
    return bool(signal_listener.signals)


@contextmanager
def keep_best_on_interrupt() -> Iterator[None]:
    """Let the first Ctrl-C in the block end the search and keep the best plan, if there is one."""
    signal_listener.substitute = _end_search
    try:
        yield
    finally:
        signal_listener.substitute = None


def _end_search() -> bool:
    if not deadline.stop():
        return False
    with suppress(OSError, ValueError):  # the signal may interrupt a write to the stream
        os.write(sys.__stderr__.fileno(), FINISH_MESSAGE)  # type: ignore[union-attr]
    return True


def search_ended_early() -> bool:
    """Return whether Ctrl-C has ended a search early since the command began."""
    return signal_listener.was_substituted


class _CleanConsole(Console):
    """A console that removes control characters, so that text of users cannot control it."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else clean_text(text), style, control)

    def on_broken_pipe(self) -> None:
        """Raise the error; Rich would silence standard output and end the process."""
        raise BrokenPipeError


def _console(stderr: bool) -> Console:
    width = None if (sys.stderr if stderr else sys.stdout).isatty() else TABLE_WIDTH
    return _CleanConsole(stderr=stderr, width=width, emoji=False)


Command = Callable[..., int]

_COMMON_OPTIONS = {
    "as_json": Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output and nothing else."),
    ],
    "quiet": Annotated[
        bool, typer.Option("--quiet", "-q", help="Print only the result, warnings and errors.")
    ],
    "verbose": Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            help="Print on standard error what is being done and how long it takes.",
        ),
    ],
}


def _refuse_own_input(options: Mapping[str, Any]) -> None:
    """Refuse to write a file that another argument names too, to be read or written.

    Raises:
        InputError: If there is such a file.
    """
    values = [each if isinstance(each, list) else [each] for each in options.values()]
    there = [p for each in values for p in each if isinstance(p, Path) and os.path.exists(p)]
    for out in map(options.get, ("out", "figure", "export_to")):
        if out in there and sum(os.path.samefile(out, path) for path in there) > 1:
            raise InputError(f"cannot write {out}: another argument names it; use another name")


def add_common_options(command: Command) -> Command:
    """Add `--json`, `--quiet` and `--verbose` to a command, unless it defines them itself."""
    hints = get_type_hints(command, include_extras=True)
    own_parameters = [
        each.replace(annotation=hints[each.name])
        for each in inspect.signature(command).parameters.values()
    ]
    common_parameters = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option)
        for name, option in _COMMON_OPTIONS.items()
        if name not in hints
    ]

    @wraps(command)
    def run(**options: Any) -> int:
        for name in _COMMON_OPTIONS:
            setattr(manner, name, options.pop(name, False))
        if manner.quiet and manner.verbose:
            raise InputError("--quiet and --verbose contradict each other; give one of them")
        _refuse_own_input(options)
        start = time.monotonic()
        if manner.verbose:
            detail(", ".join(f"{name} {number}" for name, number in versions().items()))
        try:
            return command(**options)
        finally:
            detail(f"{command.__name__}: {time.monotonic() - start:.3g} s in all")

    run.__signature__ = inspect.Signature([*own_parameters, *common_parameters])  # type: ignore[attr-defined]
    run.__annotations__ = {**hints, **{each.name: each.annotation for each in common_parameters}}
    return run
