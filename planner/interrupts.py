"""Ctrl-C that compiled code cannot swallow."""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import Any

from planner.unsaid import unsaid


@contextmanager
def heed_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt after the block if Ctrl-C was pressed in it.

    CasADi catches the exception inside its solvers and returns as if the solver had failed; a
    caller would then try the next start instead of stopping.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    pressed = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        before(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed:
        raise KeyboardInterrupt


HANDOVER_S = 0.05
"""Time for the main thread to take a signal before OSQP takes signals again."""

_osqp_alone = threading.RLock()
"""OSQP puts back the handler of Ctrl-C that it found: where two threads solve at once, the first to
end brings back the second's own, which stays for good, and the process never hears Ctrl-C again."""


def osqp_result(solver: Any) -> Any:
    """Run a set-up OSQP solver, and return its result whatever that is.

    While it runs OSQP takes Ctrl-C for itself, says so on standard output and returns as if it had
    failed; a caller would then try the next solver, or count it as late, instead of stopping. In
    its last iteration it takes it and says nothing at all.
    Here whoever would have had Ctrl-C without OSQP gets it; if that does not raise, as in a thread
    beside the main one, OSQP goes on from where it was.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed, and Python's own handler is in place.
    """
    from osqp import SolverStatus

    with _osqp_alone:
        while True:
            with unsaid("Solver interrupted", "stdout"):
                result = solver.solve(raise_error=False)
            stopped = result.info.status_val == SolverStatus.OSQP_SIGINT
            if stopped or _osqp_mark()():
                _pass_on()
            if not stopped:
                return result


@cache
def _osqp_mark() -> Callable[[], int]:
    """OSQP's own mark of a Ctrl-C since its last solve began, where its library shows that."""
    try:
        from osqp import ext_builtin

        mark: Callable[[], int] = ctypes.CDLL(ext_builtin.__file__).osqp_is_interrupted
    except (ImportError, OSError, AttributeError):
        return lambda: 0
    return mark


def _pass_on() -> None:
    """Give Ctrl-C to the main thread, which may be asleep; only while OSQP does not run."""
    main = threading.main_thread()
    if threading.current_thread() is main or sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)
        return
    assert main.ident is not None
    signal.pthread_kill(main.ident, signal.SIGINT)
    time.sleep(HANDOVER_S)
