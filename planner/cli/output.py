"""What commands print: results on standard output, everything else on standard error.

Every command has `--quiet` and `--verbose`.
"""

from __future__ import annotations

import functools
import inspect
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from planner.cli.standard_output import told_where_it_fails, write_result
from planner.errors import InputError, PlannerError
from planner.support import deadline
from planner.support.arrays import jsonable
from planner.support.interrupts import Terminated, hearing
from planner.support.package import versions
from planner.support.progress import Progress, listening
from planner.support.tables import Column, clean, terminal_table

INTERRUPTED = 130
WIDTH_WITHOUT_TERMINAL = 160
PATIENCE_S = 2.0
"""How long a job may take before its progress is shown."""


FINISHING = b"planner: finishing with the best plan found so far; Ctrl-C again ends at once\n"
EVERY_S = 10.0
"""Time between the lines that tell of a job whose standard error is no terminal."""


class Told(int):
    """An exit status whose reason the command itself has told."""


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on standard output; NaN and infinities become null.

    Raises:
        InputError: If standard output cannot be written (a full disk).
    """
    write_result(json.dumps(jsonable(data), indent=2, allow_nan=False, default=str) + "\n")


def print_text(*parts: str | Text | Table) -> None:
    """Lines and tables on standard output, coloured only on a terminal.

    Raises:
        InputError: As for `print_json`.
    """
    console = _console(stderr=False)
    with told_where_it_fails(), console.capture() as capture:
        for part in parts:
            console.print(part, highlight=False, markup=False, soft_wrap=isinstance(part, str))
    write_result("\n".join(line.rstrip() for line in capture.get().splitlines()) + "\n")


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


def facts(rows: Sequence[tuple[str, str]]) -> Table:
    """A two-column table without headers."""
    return terminal_table([Column("", "", itemgetter(k), left=True) for k in (0, 1)], rows)


def number(value: float | None) -> str:
    """Four significant digits; a dash where undefined."""
    return "-" if value is None or math.isnan(value) else f"{value:.4g}"


def finish(
    as_json: bool,
    data: Mapping[str, Any],
    *parts: str | Table,
    status: int = 0,
    where: str = "written to {}",
) -> int:
    """End a command: print its result, say where it is written, return the exit status.

    Args:
        as_json: Whether the result is one JSON object.
        data: This object; `exit_status` is added. Its key `written` is where the result was
            written, or None.
        parts: Lines and tables that are printed otherwise.
        status: The exit status.
        where: The words around `written`, for people.
    """
    if as_json:
        print_json({**data, "exit_status": status})
    elif parts:
        print_text(*parts)
    if data.get("written") is not None:
        note(where.format(data["written"]))
    return status


class Waiting:
    """Says what is going on once a job takes long, on a terminal only; see `waiting`."""

    def __init__(self, text: str) -> None:
        self._status = _console(stderr=True).status(text)
        self._shown = False
        self.text, self.line, self._doing = text, text, ""

    def __call__(self, text: str) -> None:
        """Replace the text."""
        self.text = self.line = text
        self._status.update(text)
        detail(text)

    def hear(self, progress: Progress) -> None:
        """Add what a search tells."""
        takes = "; Ctrl-C verifies and takes it" if progress.best and _ends_with_the_best() else ""
        self.line = f"{self.text}: {progress}{takes}"
        self._status.update(self.line)
        if progress.doing != self._doing:
            self._doing = progress.doing
            detail(progress.doing)

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
        with redirect_stdout(sys.stderr), listening(notice.hear), _lines(lambda: notice.line):
            yield notice
    finally:
        timer.cancel()
        if notice._shown:
            notice._status.stop()
    if interrupted():  # CasADi's solvers swallow the exception and return
        raise hearing.exception


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Run a job that reports what it does and its share done, 0 … 1; otherwise as `waiting`."""
    began = time.monotonic()
    bar = Bar(
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
    patient, last, line = _lively(), "", ""

    def tell(doing: str, share: float) -> None:
        nonlocal last, line
        line = f"{doing}, {share:.0%} of all done"
        if doing != last:
            detail(doing)
            last = doing
        bar.update(task, description=doing, completed=share)
        if patient and not bar.live.is_started and time.monotonic() - began > PATIENCE_S:
            bar.start()

    def hear(progress: Progress) -> None:
        nonlocal line
        line = f"{last}: {progress}"

    try:
        with redirect_stdout(sys.stderr), listening(hear), _lines(lambda: line):
            yield tell
    finally:
        if bar.live.is_started:
            bar.stop()
    if interrupted():
        raise hearing.exception


@contextmanager
def _lines(line: Callable[[], str]) -> Iterator[None]:
    """Say a line every ten seconds while a job runs, where nothing moves on a terminal."""
    if _lively() or volume.quiet:
        yield
        return
    done, began = threading.Event(), time.monotonic()

    def tell() -> None:
        while not done.wait(EVERY_S):
            say(f"planner: {time.monotonic() - began:.0f} s: {line()}")

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


class Interrupted(PlannerError):  # noqa: N818 (not an error)
    """Ctrl-C or SIGTERM, after which the same command goes on."""

    def __init__(self, kept: str) -> None:
        self.exit_status = hearing.status
        self.status = "interrupted" if self.exit_status == INTERRUPTED else "terminated"
        super().__init__(f"{self.status}; {kept}; the same command runs the rest")


@contextmanager
def resumable(what: str, place: Path) -> Iterator[None]:
    """Run a job that keeps what is finished, such as "cases", in a file or folder.

    Raises:
        Interrupted: After Ctrl-C or SIGTERM, also where an error hides it, once the place is there.
    """
    try:
        yield
    except BaseException as error:
        ended = interrupted() or isinstance(error, KeyboardInterrupt | Terminated)
        if not (ended and place.exists()):
            raise
        raise Interrupted(f"finished {what} are in {place}") from None


def interrupted() -> bool:
    """Whether Ctrl-C was pressed or the process was told to end since the command began."""
    return bool(hearing.heard)


@contextmanager
def ends_with_the_best() -> Iterator[None]:
    """The first Ctrl-C in the block only ends a search that holds an answer."""
    hearing.instead = _finish
    try:
        yield
    finally:
        hearing.instead = None


def _ends_with_the_best() -> bool:
    return hearing.instead is _finish


def _finish() -> bool:
    if not deadline.stop():
        return False
    with suppress(OSError, ValueError):  # the stream may be in use where this came in
        os.write(sys.__stderr__.fileno(), FINISHING)  # type: ignore[union-attr]
    return True


def ended_with_the_best() -> bool:
    """Whether Ctrl-C did so since the command began."""
    return hearing.spared


def _lively() -> bool:
    """Whether progress may move about: on a terminal, unless told to be quiet or to say it all."""
    return sys.stderr.isatty() and not volume.quiet and not volume.verbose


class _Door(Console):
    """A console that foreign text cannot steer: what it writes itself is no text but style."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else clean(text), style, control)


def _console(stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    return _Door(
        stderr=stderr, width=None if stream.isatty() else WIDTH_WITHOUT_TERMINAL, emoji=False
    )


Command = Callable[..., int]

_OPTIONS = {
    "quiet": Annotated[
        bool,
        typer.Option("--quiet", "-q", help="Print only the result, warnings and errors."),
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
            raise InputError("--quiet and --verbose contradict each other; give one of them")
        volume.quiet, volume.verbose = quiet, verbose
        began = time.monotonic()
        if verbose:
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
