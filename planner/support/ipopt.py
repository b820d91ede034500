"""IPOPT, which ends when time is up and passes Ctrl-C on."""

from __future__ import annotations

from typing import Any

import casadi as ca

from planner.support import deadline
from planner.support.interrupts import Terminated, heed_interrupts

STOPPED = "User_Requested_Stop"
"""What IPOPT says where `_Watch` has ended it."""


class Ipopt:
    """CasADi's IPOPT for one programme, to be called like CasADi's own.

    The time that remains is asked for after each iteration. It is no option of the solver, which
    may thus be kept and used again.
    """

    def __init__(self, name: str, problem: dict[str, Any], options: dict[str, Any]) -> None:
        sizes = {key: int(problem[key].numel()) for key in problem if key != "f"}
        self._watch = _Watch(sizes)  # CasADi does not keep it
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
            found: dict[str, Any] = self._solver(**given)
        if self.stats()["return_status"] == STOPPED:
            raise deadline.time_up()
        return found

    def stats(self) -> dict[str, Any]:
        """Solver statistics of the last call."""
        stats: dict[str, Any] = self._solver.stats()
        return stats


class _Watch(ca.Callback):
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
