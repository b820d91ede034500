"""One thread that plans, so that the kernel can hear "stop" while it does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextvars import Context, copy_context
from functools import cache
from queue import SimpleQueue
from typing import Any, TypeVar

from planner.support import deadline

Value = TypeVar("Value")

BUTTON = "the Stop button"


class Worker:
    """A thread that does one thing after the other.

    It stays: compiled functions have buffers of their own in each thread.
    """

    def __init__(self) -> None:
        self._todo: SimpleQueue[tuple[Callable[[], Any], Context, Future[Any]]] = SimpleQueue()
        self._doing: Context | None = None
        threading.Thread(target=self._run, name="explorer", daemon=True).start()

    def do(self, work: Callable[[], Value]) -> Future[Value]:
        """Do this, after all that was asked for before."""
        future: Future[Value] = Future()
        self._todo.put((work, copy_context(), future))
        return future

    def stop(self, at_once: bool) -> None:
        """End what is being done, unless at once with what it has found so far, if anything."""
        doing = self._doing
        if doing is not None and (at_once or not deadline.stop(doing, BUTTON)):
            deadline.end(doing, BUTTON)

    def _run(self) -> None:
        while True:
            work, self._doing, future = self._todo.get()
            try:
                future.set_result(self._doing.run(work))
            except BaseException as error:
                future.set_exception(error)
            self._doing = None


@cache
def worker() -> Worker:
    """The one of this process: two plans at a time would only be slower."""
    return Worker()
