"""Calls of compiled code that may never return.

Nothing can interrupt such code, but CasADi gives Python's lock away while it runs: in a thread of
its own it can be left behind. That thread goes on until the process ends.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Watchdog(Generic[Value]):
    """Runs calls of one kind, and none any more after one that did not return."""

    def __init__(self) -> None:
        self.lost = False

    def within(self, seconds: float, call: Callable[[], Value]) -> Value | None:
        """What a call returns; None if that takes longer, or another call already did.

        Raises:
            Exception: Whatever the call raises.
        """
        if self.lost:
            return None
        caller = _Caller(call)
        caller.start()
        caller.join(seconds)
        if caller.is_alive():
            self.lost = True
            return None
        if caller.error is not None:
            raise caller.error
        return caller.value


class _Caller(threading.Thread, Generic[Value]):
    def __init__(self, call: Callable[[], Value]) -> None:
        super().__init__(daemon=True)
        self._call = call
        self.value: Value | None = None
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            self.value = self._call()
        except BaseException as error:
            self.error = error
