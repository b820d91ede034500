"""Limits of time and work: when a search must end, and how every part of it learns this.

The limit belongs to the context (`contextvars`), so no function between `solve` and a solver has to
pass it on. `time_limit` opens a block with a limit; code inside asks `remaining` or `check`.

The computer and its load must not change an answer. So whatever the user did not limit in time is
limited in work: solvers count their iterations (`spend`), and `work_limit` limits this count.

>>> with time_limit(60.0):
...     remaining() <= 60.0
True
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import Context, ContextVar
from dataclasses import dataclass
from typing import Literal

from planner.errors import ABOVE_ZERO, expect_number
from planner.support.interrupts import handle_signals

DEFAULT_SEARCH_S = 60.0
"""Processor seconds after which a search without a given limit ends. A limit in clock time would
make plans depend on the computer's load."""

SEARCH_SHARE = 0.75
"""Share of the time for a search; the rest is for refining or compensating its result."""

LEAST_FINISH_S, FINISH_SHARE = 3.0, 0.25
"""Seconds, and share of the search so far: after Ctrl-C, refining gets the longer of the two."""


class TimeUpError(Exception):
    """No time is left. Unlike a refusal, this error also ends code that tries alternatives."""


@dataclass(eq=False)
class Span:
    """A block of code with its own end time.

    Attributes:
        enclosing: The block around this one, which may end earlier.
        start: Start time, by `time.monotonic`.
        end: End by the block's clock; infinite if the block has no limit.
        words: Name of the limit in a refusal.
        has_answer: Tells whether the search would have an answer if it ended now; None if the
            block is not a search.
        was_reached: Whether something in the block was cut short.
        interrupter: Who ended the block early ("Ctrl-C"), or "".
        condition: The limit applies only while this returns true; None: always.
        verification_ended: Whether even the verification of plans must stop.
        clock: What `end` counts, s: time, the process's processor time, or the work in the block.
        work: Work of solvers in the block so far, s, see `spend`.
        share_of: The block with the limit of which this block's limit is a share, or None.
    """

    enclosing: Span | None
    start: float
    end: float
    words: str = ""
    has_answer: Callable[[], bool] | None = None
    was_reached: bool = False
    interrupter: str = ""
    condition: Callable[[], bool] | None = None
    verification_ended: bool = False
    clock: Literal["time", "processor", "work"] = "time"
    work: float = 0.0
    share_of: Span | None = None

    @property
    def left(self) -> float:
        """Seconds until the end; negative afterwards."""
        return self.end - self._now

    def end_within(self, seconds: float) -> None:
        """End the block at most this many seconds from now."""
        self.end = min(self.end, self._now + seconds)

    @property
    def _now(self) -> float:
        if self.clock == "work":
            return self.work
        return time.process_time() if self.clock == "processor" else time.monotonic()

    @property
    def ended_by(self) -> str:
        """Who ended this block or a block around it early; "" if nobody did."""
        return next((span.interrupter for span in _spans(self) if span.interrupter), "")

    @property
    def why(self) -> str:
        """Name of the limit, or of the person or program, that cut the block short."""
        if self.ended_by:
            return self.ended_by
        named = [span for span in _spans(self) if span.words]
        over = [span for span in named if span.left <= 0]
        return (over or sorted(named, key=lambda span: span.left) or [self])[0].words


_span: ContextVar[Span | None] = ContextVar("span", default=None)


def _spans(inmost: Span | None) -> list[Span]:
    """Return a block and the blocks around it from the inside out."""
    spans = list[Span]()
    while inmost is not None:
        spans.append(inmost)
        inmost = inmost.enclosing
    return spans


def time_limit(
    seconds: float | None, words: str = "", has_answer: Callable[[], bool] | None = None
) -> AbstractContextManager[Span]:
    """Limit the time of a block, in addition to the limits of the blocks around it.

    Args:
        seconds: Greater than zero; None adds no limit.
        words: Name of the limit in a refusal; default "the time limit of ... s".
        has_answer: For a search: tells whether it has an answer that Ctrl-C should keep.

    Raises:
        InputError: If `seconds` is not a number above zero.
    """
    now, end = time.monotonic(), math.inf
    if seconds is not None:
        end, words = now + check_seconds(seconds), words or f"the time limit of {seconds:g} s"
    return _open_span(Span(_span.get(), now, end, words, has_answer))


def default_limit(given: float | None) -> AbstractContextManager[Span]:
    """Limit a search to `DEFAULT_SEARCH_S` unless the caller gave a limit."""
    if given is not None:
        return time_limit(None)
    end = time.process_time() + DEFAULT_SEARCH_S
    words = f"the default limit of {DEFAULT_SEARCH_S:g} s of processor time"
    return _open_span(Span(_span.get(), time.monotonic(), end, words, clock="processor"))


def work_limit(work: float, words: str) -> AbstractContextManager[Span]:
    """Limit the work of solvers in a block, see `spend`; `words` name the limit in a refusal."""
    return _open_span(Span(_span.get(), time.monotonic(), work, words, clock="work"))


def spend(work: float) -> None:
    """Count work of a solver in all blocks around it.

    Args:
        work: About the seconds that the work takes on an idle machine, computed from the size of
            the programme and never measured: the same search does the same work everywhere.
    """
    for span in _spans(_span.get()):
        span.work += work


def time_share(
    part: float = SEARCH_SHARE, words: str = "", condition: Callable[[], bool] | None = None
) -> AbstractContextManager[Span]:
    """Limit a block to a share of the remaining time, by the clock of the limit that ends first.

    Args:
        part: The share, 0 to 1.
        words: As for `time_limit`.
        condition: The limit applies only while this returns true. With a condition, the remaining
            time ends at the first enclosing limit even if the condition of that limit is false.
    """
    span = Span(_span.get(), time.monotonic(), math.inf, words, condition=condition)
    around = (
        s for s in _spans(span.enclosing) if condition or s.condition is None or s.condition()
    )
    if first := min(around, key=lambda each: each.left, default=None):
        span.clock, span.share_of = first.clock, first.share_of or first
        span.end_within(part * max(0.0, first.left))
    return _open_span(span)


@contextmanager
def _open_span(span: Span) -> Iterator[Span]:
    token = _span.set(span)
    try:
        yield span
    finally:
        _span.reset(token)


def remaining() -> float:
    """Return the seconds until the first enclosing limit, at least 0; infinite without a limit."""
    spans = _spans(_span.get())
    left = (each.left for each in spans if each.condition is None or each.condition())
    return max(0.0, min(left, default=math.inf))


def check() -> None:
    """Raise an exception if no time is left or a signal waits; call this in every iteration.

    Raises:
        TimeUpError: If no time is left.
        KeyboardInterrupt: As for `handle_signals`.
    """
    handle_signals()
    if remaining() <= 0:
        raise time_up()


def check_stopped() -> None:
    """Raise an exception if `end` was called; for work that no time limit may cut short.

    Raises:
        TimeUpError: If `end` was called.
        KeyboardInterrupt: As for `handle_signals`.
    """
    handle_signals()
    if any(span.verification_ended for span in _spans(_span.get())):
        raise time_up()


def time_up() -> TimeUpError:
    """Mark the blocks that a limit cuts short, out to the block that has this limit, and return the
    exception for the caller to raise."""
    spans = _spans(_span.get())
    over = [s for s in spans if s.left <= 0 and (s.condition is None or s.condition())]
    last = max((spans.index(span.share_of or span) for span in over), default=len(spans) - 1)
    for span in spans[: last + 1]:
        span.was_reached = True
    return TimeUpError()


def is_over() -> bool:
    """Return whether time is up or somebody ended the search."""
    return remaining() <= 0 or _is_stopped()


def time_advice() -> str | None:
    """Return the advice for a refusal after a time limit; None if somebody ended the search."""
    return None if _is_stopped() else "a larger time limit (--time-limit, time_limit_s)"


def _is_stopped() -> bool:
    return any(span.interrupter for span in _spans(_span.get()))


def holds_answer(context: Context | None = None) -> bool:
    """Return whether the outermost search of a context (default: the current) has an answer."""
    spans = _spans(_span.get() if context is None else context.get(_span))
    answers = [span.has_answer for span in spans if span.has_answer is not None]
    return bool(answers) and answers[-1]()


def stop(context: Context | None = None, by: str = "Ctrl-C") -> bool:
    """End the outermost search of a context now, but leave time to refine its answer.

    The time goes to the inmost search that has an answer; what runs within that one ends at once.
    A handler of Ctrl-C calls this, or another thread, which passes the search's context.

    Returns:
        Whether the search was ended; a search without an answer goes on.
    """
    if not holds_answer(context):
        return False
    spans = _spans(_span.get() if context is None else context.get(_span))
    searches = [span for span in spans if span.has_answer is not None]
    outermost = searches[-1]
    outermost.end_within(max(LEAST_FINISH_S, FINISH_SHARE * (time.monotonic() - outermost.start)))
    outermost.interrupter, outermost.was_reached = by, True
    holder = next(span for span in searches if span.has_answer and span.has_answer())
    for span in spans[: spans.index(holder)]:
        span.end_within(0.0)
    return True


def end(context: Context, by: str) -> None:
    """End all blocks in another thread's context, verification included; `by` tells who did it."""
    for span in _spans(context.get(_span)):
        span.end_within(0.0)
        span.interrupter, span.was_reached, span.verification_ended = by, True, True


def check_seconds(seconds: float) -> float:
    """Return a valid time limit as a float.

    Raises:
        InputError: If `seconds` is not a finite number above zero.
    """
    expect_number("time_limit_s", seconds, "a time limit, in seconds above 0", ABOVE_ZERO)
    return float(seconds)
