"""What commands print: results on standard output, everything else on standard error.

What becomes of errors of standard output. Every command has `--json`, `--quiet` and `--verbose`.
"""

from __future__ import annotations

import codecs
import inspect
import io
import json
import math
import os
import sys
import threading
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial, wraps
from operator import itemgetter
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
from planner.support.tables import TABLE_WIDTH, Column, clean_text, terminal_table

INTERRUPT_STATUS = 130
PROGRESS_DELAY_S = 2.0
"""How long a job may take before its progress is shown."""


FINISH_MESSAGE = b"planner: finishing with the best plan found so far; Ctrl-C again ends at once\n"
LOG_INTERVAL_S = 10.0
"""Time between the lines that tell of a job whose standard error is no terminal."""


class ReaderGoneError(Exception):
    """Nobody reads standard output any more (planner schema | head)."""


_result_writer: Callable[[str], object] | None = None
"""What writes the one JSON object, where `reserve_output` has put standard output aside."""


PLAIN = {"−": "-", "–": "-", "·": "*", "×": "x", "±": "+-", "→": "->", "≤": "<=", "≥": ">="}
"""What a console shows of characters of ours that it does not have; others lose their accents, or
are question marks."""


def _nearest(error: UnicodeError) -> tuple[str, int]:
    """Characters that a console does not have, as those that every console has."""
    assert isinstance(error, UnicodeEncodeError)
    parts = unicodedata.normalize("NFKD", error.object[error.start : error.end])
    plain = (PLAIN.get(c, c) for c in parts if not unicodedata.combining(c))
    return "".join(plain).encode("ascii", "replace").decode(), error.end


codecs.register_error("planner-nearest", _nearest)


@contextmanager
def fit_console() -> Iterator[None]:
    """Let no character fail that standard output or standard error cannot write."""
    streams = [each for each in (sys.stdout, sys.stderr) if isinstance(each, io.TextIOWrapper)]
    before = [each.errors for each in streams]
    for stream in streams:
        stream.reconfigure(errors="planner-nearest")
    try:
        yield
    finally:
        for stream, errors in zip(streams, before, strict=True):
            with suppress(ValueError, OSError):  # closed; what is buffered cannot be written
                stream.reconfigure(errors=errors)


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


class ReportedStatus(int):
    """An exit status whose reason the command itself has told."""


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on standard output; NaN and infinities become null.

    Raises:
        InputError: If standard output cannot be written (a full disk).
    """
    write_result(json.dumps(jsonable(data), indent=2, allow_nan=False, default=str) + "\n")


def print_text(*parts: str | Text | Table) -> None:
    """Lines and tables on standard output, coloured only on a terminal.

    A terminal gets sentences broken at words; a line that holds a command stays whole, so that it
    can be copied, and so does every line in a pipe.

    Raises:
        InputError: As for `print_json`.
    """
    console = _console(stderr=False)
    with translate_output_errors(), console.capture() as capture:
        for part in parts:
            whole = isinstance(part, str) and (not console.is_terminal or "planner " in part)
            console.print(part, highlight=False, markup=False, soft_wrap=whole)
    write_result("\n".join(line.rstrip() for line in capture.get().splitlines()) + "\n")


@dataclass
class Manner:
    """How a command prints; `--json`, `--quiet` and `--verbose` set it.

    Attributes:
        as_json: Whether the result is one JSON object.
        quiet: Whether nothing is said beside the result, warnings and errors.
        verbose: Whether it is said what is being done and how long it takes.
    """

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False


manner = Manner()


def note(text: str) -> None:
    """A message that `--quiet` leaves out (written to ...), on standard error."""
    if not manner.quiet:
        say(text)


def detail(text: str) -> None:
    """What only `--verbose` says, on standard error."""
    if manner.verbose:
        say(text, "dim")


def say(text: str, style: str = "") -> None:
    """A message for people, on standard error."""
    console = _console(stderr=True)
    whole = not console.is_terminal or "planner " in text
    console.print(Text(text, style=style), highlight=False, soft_wrap=whole)


Rows = Iterator[tuple[str, str]]
"""Names and values of `facts`."""


def facts(rows: Iterable[tuple[str, str]]) -> Table:
    """A two-column table without headers."""
    return terminal_table([Column("", "", itemgetter(k), left=True) for k in (0, 1)], rows)


def number(value: float | None) -> str:
    """Four significant digits; a dash where undefined."""
    return "-" if value is None or math.isnan(value) else f"{value:.4g}"


def numbers(values: Iterable[float]) -> str:
    """The same of several, with commas between."""
    return ", ".join(map(number, values))


def finish(
    data: Mapping[str, Any], *parts: str | Table, status: int = 0, where: str = "written to {}"
) -> int:
    """End a command: print its result, say where it is written, return the exit status.

    Args:
        data: The result as one JSON object; `exit_status` is added. Its key `written` is where the
            result was written, or None.
        parts: Lines and tables that are printed otherwise.
        status: The exit status.
        where: The words around `written`, for people.
    """
    if manner.as_json:
        print_json({**data, "exit_status": status})
    elif parts:
        print_text(*parts)
    if data.get("written") is not None:
        note(where.format(data["written"]))
    return status


class Job:
    """What is going on, in words and, once its share of the whole is told, as a bar; see `job`."""

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
        """Say what is done now, and which share of the whole is done, 0 … 1."""
        if text != self.text:
            detail(text)
        if share is not None and self._share is None:
            columns = BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
            self.bar.columns = TextColumn("{task.description}", markup=False), *columns
        self.text, self._share = text, share
        self.line = text if share is None else f"{text}, {share:.0%} of all done"
        self.bar.update(self._task, description=text, completed=share)

    def hear(self, progress: Progress) -> None:
        """Add what a search tells."""
        usable = progress.best and signal_listener.substitute is _end_search
        takes = "; Ctrl-C verifies and takes it" if usable else ""
        self.line = f"{self.text}: {progress}{takes}"
        if self._share is not None:
            return
        self.bar.update(self._task, description=self.line)
        if progress.doing != self._search:
            self._search = progress.doing
            detail(progress.doing)


@contextmanager
def job(text: str = "") -> Iterator[Job]:
    """Run a job that may take long, and show how far it is: on a terminal once it takes a while.

    Elsewhere, as in a log, a line says so every ten seconds. What libraries print meanwhile goes to
    standard error, so that standard output holds results only.
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
    if is_interrupted():  # CasADi's solvers swallow the exception and return
        raise signal_listener.exception


class Interruption(PlannerError):  # noqa: N818 (not an error)
    """Ctrl-C or SIGTERM, after which the same command goes on."""

    def __init__(self, progress: str) -> None:
        self.exit_status = signal_listener.status
        self.status = "interrupted" if self.exit_status == INTERRUPT_STATUS else "terminated"
        super().__init__(f"{self.status}; {progress}; the same command runs the rest")


@contextmanager
def explain_interruption(what: str, place: Path) -> Iterator[None]:
    """Run a job that keeps what is finished, such as "cases", in a file or folder.

    Raises:
        Interruption: After Ctrl-C or SIGTERM, even if an error hides it, once the place is there.
    """
    try:
        yield
    except BaseException as error:
        stopped = is_interrupted() or isinstance(error, KeyboardInterrupt | Terminated)
        if not (stopped and place.exists()):
            raise
        raise Interruption(f"finished {what} are in {place}") from None


def is_interrupted() -> bool:
    """Whether Ctrl-C was pressed or the process was told to end since the command began."""
    return bool(signal_listener.signals)


@contextmanager
def keep_best_on_interrupt() -> Iterator[None]:
    """The first Ctrl-C in the block only ends a search that holds an answer."""
    signal_listener.substitute = _end_search
    try:
        yield
    finally:
        signal_listener.substitute = None


def _end_search() -> bool:
    if not deadline.stop():
        return False
    with suppress(OSError, ValueError):  # the stream may be in use where this came in
        os.write(sys.__stderr__.fileno(), FINISH_MESSAGE)  # type: ignore[union-attr]
    return True


def search_ended_early() -> bool:
    """Whether Ctrl-C did so since the command began."""
    return signal_listener.was_substituted


class _CleanConsole(Console):
    """A console that foreign text cannot steer: what it writes itself is no text but style."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else clean_text(text), style, control)


def _console(stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() else TABLE_WIDTH
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


def add_common_options(command: Command) -> Command:
    """The command with the options of all commands after its own; one of that name is its own."""
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
