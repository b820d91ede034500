"""Calls of solvers, which may never return.

Nothing can interrupt compiled code, but CasADi gives Python's lock away while it runs: in a thread
of its own it can be left behind. That thread goes on until the process ends.

IPOPT is told when time is up, and passes Ctrl-C on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import casadi as ca

from planner.support import deadline
from planner.support.interrupts import Terminated, heed_interrupts

Value = TypeVar("Value")

CLOCK_INTERVAL_S = 0.5
"""Time between two looks at the clock; a call that returns is noticed at once."""


def call_within(seconds: float, call: Callable[[], Value]) -> Value | None:
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
        caller.join(min(CLOCK_INTERVAL_S, left))
        if caller.is_alive() and left <= 0:
            raise deadline.time_up()
    if errors:
        raise errors[0]
    return out[0] if out else None


STOPPED_STATUS = "User_Requested_Stop"
"""What IPOPT says where `_IterationWatch` has ended it."""


class IpoptCall:
    """CasADi's IPOPT for one programme, to be called like CasADi's own.

    The time that remains is asked for after each iteration. It is no option of the solver, which
    may thus be kept and used again.
    """

    def __init__(self, name: str, problem: dict[str, Any], options: dict[str, Any]) -> None:
        sizes = {key: int(problem[key].numel()) for key in problem if key != "f"}
        self._watch = _IterationWatch(sizes)  # CasADi does not keep it
        watched = {**options, "iteration_callback": self._watch}
        self._solver = ca.nlpsol(name, "ipopt", problem, watched)

    def __call__(self, **given: Any) -> dict[str, Any]:
        """What the solver returns.

        Raises:
            TimeUpError: If time was up before it had finished.
            KeyboardInterrupt: If Ctrl-C was pressed.
        """
        deadline.check()
        with heed_interrupts():
            answer: dict[str, Any] = self._solver(**given)
        if self.stats()["return_status"] == STOPPED_STATUS:
            raise deadline.time_up()
        return answer

    def stats(self) -> dict[str, Any]:
        """Solver statistics of the last call."""
        stats: dict[str, Any] = self._solver.stats()
        return stats


class _IterationWatch(ca.Callback):
    """Called after each iteration: one ends the solver."""

    def __init__(self, sizes: dict[str, int]) -> None:
        ca.Callback.__init__(self)
        x, g, p = (sizes.get(key, 0) for key in ("x", "g", "p"))
        self._sizes = {"x": x, "f": 1, "g": g, "lam_x": x, "lam_g": g, "lam_p": p}
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, k: int) -> str:
        return str(ca.nlpsol_out(k))

    def get_name_out(self, k: int) -> str:
        return "ret"

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(self._sizes.get(ca.nlpsol_out(k), 0), 1)

    def eval(self, arguments: Any) -> list[float]:
        try:
            return [float(deadline.remaining() <= 0)]
        except (KeyboardInterrupt, Terminated):  # `heed_interrupts` raises it again
            return [1.0]
