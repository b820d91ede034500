"""What commands print: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from planner.errors import InputError
from planner.jsonable import jsonable

WIDTH_WITHOUT_TERMINAL = 160
PATIENCE_S = 2.0
"""How long a job may take before its progress is shown."""


class Told(int):
    """An exit status whose reason the command itself has told."""


class ReaderGoneError(Exception):
    """Nobody reads standard output any more (planner schema | head)."""


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on standard output; NaN and infinities become null.

    Raises:
        InputError: If standard output cannot be written (a full disk).
    """
    _write(json.dumps(jsonable(data), indent=2, allow_nan=False, default=str) + "\n")


def print_text(*parts: str | Text | Table) -> None:
    """Lines and tables on standard output, coloured only on a terminal.

    Raises:
        InputError: As for `print_json`.
    """
    console = _console(stderr=False)
    with _told_where_it_fails(), console.capture() as capture:
        for part in parts:
            console.print(part, highlight=False, markup=False, soft_wrap=isinstance(part, str))
    _write("\n".join(line.rstrip() for line in capture.get().splitlines()) + "\n")


@dataclass
class Volume:
    """How much is said besides the result; `--quiet` and `--verbose` set it."""

    quiet: bool = False
    verbose: bool = False


volume = Volume()


def note(text: str) -> None:
    """A message that one can do without (written to ...), on standard error."""
    if not volume.quiet:
        say(text)


def detail(text: str) -> None:
    """What only `--verbose` says, on standard error."""
    if volume.verbose:
        say(text, "dim")


def say(text: str, style: str = "") -> None:
    """A message for people, on standard error."""
    console = _console(stderr=True)
    console.print(Text(text, style=style), highlight=False, soft_wrap=True)


def table(*headers: str) -> Table:
    """An empty table in the house style; headers that start with '>' are right-aligned."""
    out = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for header in headers:
        right = header.startswith(">")
        out.add_column(header.removeprefix(">"), justify="right" if right else "left")
    return out


def facts(rows: Sequence[tuple[str, str]]) -> Table:
    """A two-column table without headers."""
    out = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    for name, value in rows:
        out.add_row(name, value)
    return out


class Waiting:
    """Says what is going on once a job takes long, on a terminal only; see `waiting`."""

    def __init__(self, text: str) -> None:
        self._status = _console(stderr=True).status(text)
        self._shown = False

    def __call__(self, text: str) -> None:
        """Replace the text."""
        self._status.update(text)
        detail(text)

    def _show(self) -> None:
        self._shown = True
        self._status.start()


@contextmanager
def waiting(text: str) -> Iterator[Waiting]:
    """Run a job that may take long.

    What libraries print meanwhile goes to standard error, so that standard output holds results
    only.
    """
    notice = Waiting(text)
    detail(text)
    timer = threading.Timer(PATIENCE_S, notice._show)
    timer.daemon = True
    if _lively():
        timer.start()
    try:
        with redirect_stdout(sys.stderr):
            yield notice
    finally:
        timer.cancel()
        if notice._shown:
            notice._status.stop()
    if interrupted():  # CasADi's solvers swallow the exception and return
        raise KeyboardInterrupt


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Run a job that reports what it does and its share done, 0 … 1; otherwise as `waiting`."""
    began = time.monotonic()
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        console=_console(stderr=True),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    task = bar.add_task("", total=1.0)
    patient, last = _lively(), ""

    def tell(doing: str, share: float) -> None:
        nonlocal last
        if doing != last:
            detail(doing)
            last = doing
        bar.update(task, description=doing, completed=share)
        if patient and not bar.live.is_started and time.monotonic() - began > PATIENCE_S:
            bar.start()

    try:
        with redirect_stdout(sys.stderr):
            yield tell
    finally:
        if bar.live.is_started:
            bar.stop()
    if interrupted():
        raise KeyboardInterrupt


_interrupts: list[int] = []


def interrupted() -> bool:
    """Whether Ctrl-C was pressed since `watch_interrupts`."""
    return bool(_interrupts)


@contextmanager
def watch_interrupts() -> Iterator[None]:
    """Remember Ctrl-C, even where compiled code swallows the exception.

    Where it is ignored it stays so: a script's jobs in the background begin like that, and Ctrl-C
    is for what runs before them.
    """

    def remember(number: int, frame: FrameType | None) -> None:
        _interrupts.append(number)
        raise KeyboardInterrupt

    _interrupts.clear()
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before == signal.SIG_IGN:
        yield
        return
    signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _lively() -> bool:
    """Whether progress may move about: on a terminal, unless told to be quiet or to say it all."""
    return sys.stderr.isatty() and not volume.quiet and not volume.verbose


def _console(stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    return Console(
        stderr=stderr, width=None if stream.isatty() else WIDTH_WITHOUT_TERMINAL, emoji=False
    )


def _write(text: str) -> None:
    with _told_where_it_fails():
        sys.stdout.write(text)
        sys.stdout.flush()


@contextmanager
def _told_where_it_fails() -> Iterator[None]:
    """What becomes of errors of standard output; Rich writes to it even where it captures."""
    try:
        yield
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise InputError(f"cannot write standard output: {error.strerror or error}") from None
