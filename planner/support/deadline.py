"""When a search must end, and how all of its parts hear of it.

The time belongs to the context, so that no function between `solve` and a solver has to pass it
on: whoever allows so much time opens a block, whoever takes time asks in it.

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

from planner.errors import InputError

DEFAULT_SEARCH_S = 60.0
"""Seconds of processor time after which a search ends to which nobody gave a limit. Time by the
clock would make plans depend on what else the computer does."""

SEARCH_SHARE = 0.75
"""Share of the time after which a search ends; the rest is for what is made of what it found."""

LEAST_FINISH_S, FINISH_SHARE = 3.0, 0.25
"""Time for refining after Ctrl-C: this share of what the search took, or so many seconds."""


class TimeUpError(Exception):
    """There is no time left. No refusal: what catches those to go on otherwise must not go on."""


@dataclass(eq=False)
class Span:
    """A block with an end of its own.

    Attributes:
        enclosing: The block around it, which may end earlier.
        start: By `time.monotonic`.
        end: Likewise, or in processor time; infinite where the block adds no limit.
        words: What the limit is called in a refusal.
        has_answer: Whether there is an answer to show for it, were it to end now; None where the
            block is not a search.
        was_reached: Whether something in the block was cut short.
        interrupter: Who ended it before its time ("Ctrl-C"), or "".
        condition: The end counts only once this is true; None if it always does.
        verification_ended: Whether even the verification of what was found must stop.
        counts_processor_time: Whether `end` is in processor time.
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
    counts_processor_time: bool = False

    @property
    def left(self) -> float:
        """Seconds until its end, negative afterwards."""
        return self.end - self._now

    def end_within(self, seconds: float) -> None:
        """Bring its end forward, if it is later than in so many seconds."""
        self.end = min(self.end, self._now + seconds)

    @property
    def _now(self) -> float:
        return time.process_time() if self.counts_processor_time else time.monotonic()

    def outwards(self) -> Iterator[Span]:
        """It, and the blocks around it."""
        span: Span | None = self
        while span is not None:
            yield span
            span = span.enclosing

    @property
    def ended_by(self) -> str:
        """Who ended it, or a block around it, before its time; or ""."""
        return next((span.interrupter for span in self.outwards() if span.interrupter), "")

    @property
    def why(self) -> str:
        """What cut it short, in words."""
        if self.ended_by:
            return self.ended_by
        named = [span for span in self.outwards() if span.words]
        over = [span for span in named if span.left <= 0]
        return (over or sorted(named, key=lambda span: span.left) or [self])[0].words


_span: ContextVar[Span | None] = ContextVar("span", default=None)


def time_limit(
    seconds: float | None, words: str = "", has_answer: Callable[[], bool] | None = None
) -> AbstractContextManager[Span]:
    """Nothing in the block takes longer; None adds no limit to those around.

    Args:
        seconds: Greater than zero.
        words: What the limit is called in a refusal; "the time limit of ... s" if left out.
        has_answer: Given for a search: whether it holds an answer, so that Ctrl-C need not lose it.

    Raises:
        InputError: If the seconds are no such number.
    """
    now = time.monotonic()
    if seconds is None:
        return _open_span(Span(_span.get(), now, math.inf, has_answer=has_answer))
    seconds = check_seconds(seconds)
    words = words or f"the time limit of {seconds:g} s"
    return _open_span(Span(_span.get(), now, now + seconds, words, has_answer))


def default_limit(given: float | None) -> AbstractContextManager[Span]:
    """The limit of a search where nobody gave one; no further one where somebody did."""
    if given is not None:
        return time_limit(None)
    end = time.process_time() + DEFAULT_SEARCH_S
    words = f"the default limit of {DEFAULT_SEARCH_S:g} s of processor time"
    return _open_span(Span(_span.get(), time.monotonic(), end, words, counts_processor_time=True))


def time_share(
    part: float = SEARCH_SHARE, words: str = "", condition: Callable[[], bool] | None = None
) -> AbstractContextManager[Span]:
    """The block takes no more than this share of the time that remains, by the same clock.

    Args:
        part: Of one.
        words: As for `time_limit`.
        condition: Given where the share counts only once this is true. It is a share of what is
            left then: shares around it that wait likewise count.
    """
    span = Span(_span.get(), time.monotonic(), math.inf, words, condition=condition)
    if first := _first_to_end(waiting=condition is not None):
        span.counts_processor_time = first.counts_processor_time
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
    """Seconds left, infinite without a limit; not below zero."""
    first = _first_to_end()
    return math.inf if first is None else max(0.0, first.left)


def _first_to_end(waiting: bool = False) -> Span | None:
    """Of the blocks around, the one that ends first; those that wait count where that is asked."""
    counted = (s for s in _spans() if waiting or s.condition is None or s.condition())
    return min(counted, key=lambda span: span.left, default=None)


def check() -> None:
    """To be asked wherever a search has come round once more.

    Raises:
        TimeUpError: If there is no time left.
    """
    if remaining() <= 0:
        raise time_up()


def check_stopped() -> None:
    """The same for work that a time limit must not cut short, such as a verification.

    Raises:
        TimeUpError: If `end` was called.
    """
    for span in _spans():
        if span.verification_ended:
            raise time_up()


def time_up() -> TimeUpError:
    """The exception, to be raised where a solver has noticed the end by itself."""
    for span in _spans():
        span.was_reached = True
    return TimeUpError()


def is_over() -> bool:
    """Whether time is up, or somebody has ended the search: what there is must do."""
    return remaining() <= 0 or _is_stopped()


def time_advice() -> str | None:
    """What a refusal for lack of time advises; None where somebody ended the search before."""
    return None if _is_stopped() else "a larger time limit (--time-limit, time_limit_s)"


def _is_stopped() -> bool:
    return any(span.interrupter for span in _spans())


def holds_answer(context: Context | None = None) -> bool:
    """Whether the search that is under way holds an answer."""
    search = _search(context)
    return search is not None and search.has_answer is not None and search.has_answer()


def stop(context: Context | None = None, by: str = "Ctrl-C") -> bool:
    """End the search at once, but for the refining of what it holds; whether it holds anything.

    For a handler of Ctrl-C, or for another thread, with the context that the search runs in.
    """
    outermost, now = _search(context), time.monotonic()
    if outermost is None or not holds_answer(context):
        return False
    allowed = max(LEAST_FINISH_S, FINISH_SHARE * (now - outermost.start))
    outermost.end_within(allowed)
    outermost.interrupter, outermost.was_reached = by, True
    for span in _spans(context):
        if span is outermost:
            break
        span.end_within(0.0)
    return True


def end(context: Context, by: str) -> None:
    """End all that runs in a context of another thread, verification included."""
    for span in _spans(context):
        span.end_within(0.0)
        span.interrupter, span.was_reached, span.verification_ended = by, True, True


def check_seconds(seconds: float) -> float:
    """A time limit, if it can be one.

    Raises:
        InputError: If not.
    """
    number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not number or not 0 < seconds < math.inf:
        raise InputError(
            f"time_limit_s = {seconds!r:.40} is not a time limit; give seconds above 0"
        )
    return float(seconds)


def _search(context: Context | None = None) -> Span | None:
    """The outermost search: a part of it may hold what is no answer to the whole."""
    searches = [span for span in _spans(context) if span.has_answer is not None]
    return searches[-1] if searches else None


def _spans(context: Context | None = None) -> Iterator[Span]:
    """From the innermost outwards."""
    span = _span.get() if context is None else context.get(_span)
    return iter(()) if span is None else span.outwards()
