"""Calls of compiled code: CasADi functions on NumPy arrays, and calls that may never return.

Nothing can interrupt such code, but CasADi gives Python's lock away while it runs: in a thread of
its own it can be left behind. That thread goes on until the process ends.

IPOPT is told when time is up, and passes Ctrl-C on.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from planner.support import deadline
from planner.support.arrays import Array
from planner.support.interrupts import Terminated, heed_interrupts


class Call(threading.local):
    """A CasADi function's first value on NumPy arrays; each thread has a buffer of its own.

    The arrays' own memory is handed over; neither their shapes nor their sizes are checked.
    """

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._size = function.nnz_out(0)

    def __call__(self, *arguments: Array) -> Array:
        """All nonzeros, shape (n,); those of matrices by columns, as CasADi stores them."""
        out, buffer, kept_alive = np.empty(self._size), self._buffer, []
        for i, given in enumerate(arguments):
            kept_alive.append(np.ascontiguousarray(given, dtype=float).reshape(-1))
            buffer.set_arg(i, kept_alive[i].data)
        buffer.set_res(0, out.data)
        self._evaluate()
        return out


class Pointwise:
    """A function of column vectors that maps over the leading axes of its arguments.

    CasADi stores matrices by columns, so a row-major array (m, k) of m points is the (k, m) matrix
    its `map` wants: the arrays' own memory is handed over.

    Args:
        name: For messages.
        arguments: CasADi column vectors.
        value: Expression of them, a column vector or matrix.
    """

    def __init__(self, name: str, arguments: Sequence[Any], value: Any) -> None:
        self.function = ca.Function(name, list(arguments), [ca.densify(value)])
        self.shape = self.function.size_out(0)
        self._mapped = {0: Call(self.function)}  # by the power of two of the points they take

    def __call__(self, *arguments: Array) -> Array:
        """Values at points given by arrays (…, k) whose leading axes agree.

        Returns:
            Array (…, r) of a column of r, or (…, r, c) of a matrix.
        """
        lead = arguments[0].shape[:-1]
        count = math.prod(lead)
        rows, columns = self.shape
        points = [a.reshape(count, a.shape[-1]) for a in arguments]
        done, parts = 0, [np.empty(0)]
        # any count is a sum of few powers of two, and a map takes long to make
        for power in range(count.bit_length() - 1, -1, -1):
            if count & 2**power:
                if power not in self._mapped:
                    self._mapped[power] = Call(self.function.map(2**power))
                parts.append(self._mapped[power](*[p[done : done + 2**power] for p in points]))
                done += 2**power
        out = parts[1] if len(parts) == 2 else np.concatenate(parts)
        out = out.reshape(count, columns, rows)
        if columns == 1:
            return out.reshape(*lead, rows)
        return np.ascontiguousarray(out.swapaxes(-1, -2)).reshape(*lead, rows, columns)


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
