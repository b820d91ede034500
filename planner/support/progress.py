"""Progress reports of a running search, to callbacks and to the logger `planner`.

Listeners belong to the context, like time limits (`planner.support.deadline`): any part of a search
can report, and every listener around it is called.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from planner.errors import InputError
from planner.support.tables import shorten

logger = logging.getLogger("planner")


@dataclass(frozen=True)
class Progress:
    """Progress of a search; `str` gives one line.

    Attributes:
        doing: The current step, in words.
        seconds: Time since the search began, s.
        solves: Number of solver calls so far.
        best: The best motion so far, in words; None before the first.
        iterations: Number of iterations of all solvers so far.
    """

    doing: str
    seconds: float
    solves: int
    best: str | None
    iterations: int = 0

    def __str__(self) -> str:
        best = "no motion yet" if self.best is None else f"motion found ({self.best})"
        return f"{self.doing}; {self.solves} solves, {best}, {self.seconds:.0f} s"


Listener = Callable[[Progress], None]

Tell = Callable[[str, float], None]
"""Callback that receives the current step of a job and its finished share, from 0 to 1."""


def expect_listener(progress: Any) -> Callable[..., None]:
    """Return an argument `progress`, or a function that does nothing if it is None.

    Call this before long work.

    Raises:
        InputError: If `progress` is neither a function nor None.
    """
    if progress is not None and not callable(progress):
        raise InputError(f"progress = {shorten(repr(progress))}: give a function, such as print")
    return progress or (lambda *_: None)


class _Run:
    def __init__(self, listener: Listener | None, outer: _Run | None) -> None:
        self.listener, self.outer = listener, outer
        self.began, self.doing = time.monotonic(), "preparing"
        self.solves, self.iterations = 0, 0
        self.best: str | None = None

    @property
    def now(self) -> Progress:
        seconds = time.monotonic() - self.began
        return Progress(self.doing, seconds, self.solves, self.best, self.iterations)


_run: ContextVar[_Run | None] = ContextVar("run", default=None)


@contextmanager
def progress_listener(listener: Listener | None) -> Iterator[None]:
    """Send progress reports from a block to `listener` and to the listeners of blocks around it.

    Raises:
        InputError: As for `expect_listener`.
    """
    expect_listener(listener)
    token = _run.set(_Run(listener, _run.get()))
    try:
        yield
    finally:
        _run.reset(token)


def tell(doing: str = "", best: str = "") -> None:
    """Report the current step of the search to the logger and all listeners; or, in words, a motion
    that is better than all motions before."""
    logger.info("%s", doing or f"motion found ({best})")
    for run in _runs():
        run.doing, run.best = doing or run.doing, best or run.best
        if run.listener is not None:
            run.listener(run.now)


def count(solves: int = 0, iterations: int = 0) -> None:
    """Add solver calls and their iterations to the progress of the running search."""
    for run in _runs():
        run.solves += solves
        run.iterations += iterations


def current_progress() -> Progress | None:
    """Return the progress of the innermost running search; None outside of a search."""
    return next((run.now for run in _runs()), None)


def _runs() -> Iterator[_Run]:
    """Yield the running searches from the innermost to the outermost."""
    run = _run.get()
    while run is not None:
        yield run
        run = run.outer
