"""One thread that plans, so that the kernel can hear "stop" while it does."""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextvars import Context, copy_context
from functools import cache
from queue import SimpleQueue
from typing import Any, TypeVar

from planner.support import deadline

Value = TypeVar("Value")

Job = tuple[Callable[[], Any], Context, Future[Any]]

STOP_BUTTON = "the Stop button"

CLOSE_S = 5.0
"""Longest wait for the thread when Python ends."""


class PlanningThread:
    """A thread that does one thing after the other.

    It stays: compiled functions have buffers of their own in each thread.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Job | None] = SimpleQueue()
        self._current: Job | None = None
        self._stopped: set[Future[Any]] = set()
        self._thread = threading.Thread(target=self._run, name="explorer", daemon=True)
        self._thread.start()
        atexit.register(self._close)

    def do(self, work: Callable[[], Value]) -> Future[Value]:
        """Do this, after all that was asked for before."""
        future: Future[Value] = Future()
        self._queue.put((work, copy_context(), future))
        return future

    def stop(self, future: Future[Any], at_once: bool) -> None:
        """End what was asked for, unless at once with what it has found so far, if anything."""
        self._stopped.add(future)
        if self._current is not None and self._current[2] is future:
            self._end(self._current[1], at_once)

    def _end(self, context: Context, at_once: bool) -> None:
        if at_once or not deadline.stop(context, STOP_BUTTON):
            deadline.end(context, STOP_BUTTON)

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            work, context, future = self._current = job
            try:
                future.set_result(context.run(self._run_limited, work, future))
            except BaseException as error:
                future.set_exception(error)
            self._current = None
            self._stopped.discard(future)

    def _run_limited(self, work: Callable[[], Value], future: Future[Value]) -> Value:
        """Work in a block of its own; what was stopped before it began ends where time is asked."""
        with deadline.time_limit(None):
            if future in self._stopped:
                deadline.end(copy_context(), STOP_BUTTON)
            return work()

    def _close(self) -> None:
        """End the thread before Python ends: compiled code must not find it gone."""
        self._queue.put(None)
        until = time.monotonic() + CLOSE_S
        while self._thread.is_alive() and time.monotonic() < until:
            if (doing := self._current) is not None:  # and then what was waiting
                self._end(doing[1], at_once=True)
            self._thread.join(0.05)


@cache
def worker() -> PlanningThread:
    """The one of this process: two plans at a time would only be slower."""
    return PlanningThread()
