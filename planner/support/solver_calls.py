"""Call solvers that may never return.

Nothing can interrupt compiled code. CasADi releases Python's lock while solving, so a solver can
run in its own thread and be abandoned there (`call_within`) until the process ends.

`NlpCall` stops a solver after an iteration if time is up or Ctrl-C was pressed. Within an iteration
nothing stops it. Never use both: a call abandoned with a callback aborts the process at its end.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

import casadi as ca

from planner.support import deadline
from planner.support.interrupts import hold_signals

Value = TypeVar("Value")

CLOCK_INTERVAL_S = 0.5
"""Seconds between two looks at the clock while a call runs."""

ITERATION_S = 3e-6
"""Work of one iteration per unknown and row of the programme, s (`planner.support.deadline.spend`).
IPOPT takes 2.3 to 4.1 and Fatrop 1.3 to 2.6 microseconds on programmes of 300 to 7,000."""


QUIET: dict[str, Any] = dict.fromkeys(("print_time", "show_eval_warnings", "calc_lam_p"), False)
QUIET_IPOPT = {"print_level": 0, "sb": "yes"}
"""Options of all solvers of CasADi, and of IPOPT: no words, and no derivatives by parameters."""


def iteration_work(problem: dict[str, Any]) -> float:
    """Return the work, s, of one iteration of a solver on a programme of CasADi."""
    return ITERATION_S * float(sum(problem[key].numel() for key in ("x", "g") if key in problem))


def call_within(seconds: float, call: Callable[[], Value]) -> Value | None:
    """Return the value of a call; None if it takes more than `seconds` of processor time.

    This is for calls that may never return: `seconds` is many times what any other call needs. It
    is time of the call's own thread where the system can tell, so that neither the computer's load
    nor another abandoned call counts.

    Raises:
        TimeUpError: If a time limit ends first; the call then runs on, unheard, in its thread.
        Exception: Any exception of the call.
    """
    answer: Future[Value] = Future()
    clocks = list[int]()

    def run() -> None:
        if sys.platform == "linux":
            clocks.append(time.pthread_getcpuclockid(threading.get_ident()))
        try:
            answer.set_result(call())
        except BaseException as error:
            answer.set_exception(error)

    caller = threading.Thread(target=run, daemon=True)
    began = time.process_time()
    caller.start()

    def spent() -> float:
        if not clocks:
            return time.process_time() - began
        with suppress(OSError):  # the thread has ended
            return time.clock_gettime(clocks[0])
        return 0.0

    while caller.is_alive() and spent() <= seconds:
        caller.join(min(CLOCK_INTERVAL_S, deadline.remaining()))
        if caller.is_alive():
            deadline.check()
    if not answer.done():
        deadline.spend(seconds)
        return None
    return answer.result()


class NlpCall:
    """A CasADi solver of one program that stops when time is up; called like CasADi's own solver.

    The remaining time is checked after each iteration instead of being an option of the solver, so
    that a solver can be kept and used again.
    """

    def __init__(
        self, solver: str, name: str, problem: dict[str, Any], options: dict[str, Any]
    ) -> None:
        self._watch = _IterationWatch(iteration_work(problem))  # CasADi holds no reference to it
        watched = {**options, "iteration_callback": self._watch}
        self._solver = ca.nlpsol(name, solver, problem, watched)

    def __call__(self, **given: Any) -> dict[str, Any]:
        """Solve the program and return CasADi's result.

        Raises:
            TimeUpError: If time was up before the solver finished.
            KeyboardInterrupt: If Ctrl-C was pressed.
        """
        deadline.check()
        self._watch.error = None
        with hold_signals():
            answer: dict[str, Any] = self._solver(**given)
        error, self._watch.error = self._watch.error, None  # it would keep all frames alive
        if error is not None:
            raise error
        return answer

    def stats(self) -> dict[str, Any]:
        """Return the solver statistics of the last call."""
        return dict(self._solver.stats())


class _IterationWatch(ca.Callback):
    """CasADi's callback after each solver iteration, which takes `work`; stops the solver and keeps
    the reason."""

    def __init__(self, work: float) -> None:
        ca.Callback.__init__(self)
        self._work = work
        self.error: BaseException | None = None
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity(0, 0)  # CasADi then passes no values, and none is needed

    def eval(self, arguments: Any) -> list[float]:
        try:
            deadline.spend(self._work)
            deadline.check()
        except BaseException as error:  # CasADi would swallow it
            self.error = error
        return [float(self.error is not None)]
