"""Calls of compiled code that may never return.

Nothing can interrupt such code, but CasADi gives Python's lock away while it runs: in a thread of
its own it can be left behind. That thread goes on until the process ends.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from planner import deadline

Value = TypeVar("Value")

LOOK_S = 0.5
"""Time between two looks at the clock; a call that returns is noticed at once."""


def within(seconds: float, call: Callable[[], Value]) -> Value | None:
    """What a call returns; None if that takes the process more of the processor's time than this.

    A loaded machine slows the call and this clock alike, so that it changes no answer.

    Raises:
        TimeUpError: If time is up sooner; the call is left behind too, but may yet return.
        Exception: Whatever the call raises.
    """
    out: list[Value] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            out.append(call())
        except BaseException as error:
            errors.append(error)

    caller = threading.Thread(target=run, daemon=True)
    began = time.process_time()
    caller.start()
    while caller.is_alive() and time.process_time() - began <= seconds:
        left = deadline.remaining()
        caller.join(min(LOOK_S, left))
        if caller.is_alive() and left <= 0:
            raise deadline.time_up()
    if errors:
        raise errors[0]
    return out[0] if out else None
