"""What a search tells of itself while it runs: to callbacks, and to the logger `planner`.

Like the time it may take (`planner.support.deadline`) this belongs to the context: any part of a
search tells, whoever asked hears it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from planner.errors import InputError
from planner.support.tables import shorten

logger = logging.getLogger("planner")


@dataclass(frozen=True)
class Progress:
    """How far a search has come; `str` gives one line.

    Attributes:
        doing: What it does now, in words.
        seconds: Since it began.
        solves: Times that a solver was called so far.
        best: The best motion found so far, in words; None while there is none.
        iterations: Of all solvers so far.
    """

    doing: str
    seconds: float
    solves: int
    best: str | None
    iterations: int = 0

    def __str__(self) -> str:
        best = "no motion yet" if self.best is None else f"a motion is held ({self.best})"
        return f"{self.doing}; {self.solves} solves, {best}, {self.seconds:.0f} s"


Listener = Callable[[Progress], None]


def expect_listener(progress: object) -> None:
    """Refuse an argument `progress` that cannot be called, before the work that it would hear of.

    Raises:
        InputError: If it is neither a function nor None.
    """
    if progress is not None and not callable(progress):
        raise InputError(f"progress = {shorten(repr(progress))}: give a function, such as print")


class _Run:
    def __init__(self, listener: Listener | None, outer: _Run | None) -> None:
        self.listener, self.outer = listener, outer
        self.began, self.doing = time.monotonic(), "preparing"
        self.solves, self.iterations, self.best = 0, 0, None

    solves: int
    iterations: int
    best: str | None

    @property
    def now(self) -> Progress:
        seconds = time.monotonic() - self.began
        return Progress(self.doing, seconds, self.solves, self.best, self.iterations)


_run: ContextVar[_Run | None] = ContextVar("run", default=None)


@contextmanager
def progress_listener(listener: Listener | None) -> Iterator[None]:
    """What is told in the block goes to the listener, and to those around.

    Raises:
        InputError: As `expect_listener`.
    """
    expect_listener(listener)
    token = _run.set(_Run(listener, _run.get()))
    try:
        yield
    finally:
        _run.reset(token)


def tell(doing: str) -> None:
    """Say what is done now."""
    logger.info("%s", doing)
    _notify(doing=doing)


def report_motion(best: str) -> None:
    """Say that there is a motion better than all before."""
    logger.info("a motion is held (%s)", best)
    _notify(best=best)


def count_solve() -> None:
    """Count one call of a solver."""
    for run in _runs():
        run.solves += 1


def count_iterations(iterations: int) -> None:
    """Count a solver's iterations."""
    for run in _runs():
        run.iterations += iterations


def current_progress() -> Progress | None:
    """How far the search around has come; None outside of any."""
    run = _run.get()
    return None if run is None else run.now


def _notify(doing: str = "", best: str = "") -> None:
    """Put down what is new in all runs around, and let their listeners hear."""
    for run in _runs():
        run.doing, run.best = doing or run.doing, best or run.best
        if run.listener is not None:
            run.listener(run.now)


def _runs() -> Iterator[_Run]:
    """The runs around, from the innermost outwards."""
    run = _run.get()
    while run is not None:
        yield run
        run = run.outer
