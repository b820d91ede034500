"""Ctrl-C that compiled code cannot swallow."""

from __future__ import annotations

import io
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from types import FrameType
from typing import Any


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


def osqp_result(solver: Any) -> Any:
    """Run a set-up OSQP solver, and return its result whatever that is.

    While it runs OSQP takes Ctrl-C for itself, says so on standard output and returns as if it had
    failed; a caller would then try the next solver instead of stopping.

    Raises:
        KeyboardInterrupt: If Ctrl-C was pressed.
    """
    from osqp import SolverStatus

    with redirect_stdout(io.StringIO()):
        result = solver.solve(raise_error=False)
    if result.info.status_val == SolverStatus.OSQP_SIGINT:
        raise KeyboardInterrupt
    return result
