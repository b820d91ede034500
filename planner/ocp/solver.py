"""The call of the solver: IPOPT through CasADi, kept once made."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.interrupts import heed_interrupts
from planner.ocp.bounds import Bounds
from planner.ocp.form import Form
from planner.ocp.layout import Iterate
from planner.ocp.transcription import Transcription, transcription
from planner.systems.base import Array, TriangularSystem

ACCEPTED_RESIDUAL = 1e-7
"""Largest excess of a row over its bounds, in its own unit, that counts as solved."""

NEAR = 1e-4
"""Barrier and distance to the bounds to begin with when the start is near the answer."""

_FINISHED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


@dataclass(frozen=True)
class Settings:
    """Options of the solver.

    Attributes:
        tolerance: Of optimality and of the rows.
        max_iterations: Iterations before it gives up.
        near: Whether the start is close to the answer, as from a coarser mesh or looser limits.
    """

    tolerance: float = 1e-9
    max_iterations: int = 500
    near: bool = False


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the solver stopped.

    Attributes:
        vector: The unknowns, shape (size,).
        iterate: The same by name.
        rows: Values of all rows there, evaluated anew.
        objective: Value of the objective.
        residual: Largest excess of a row over its bounds, computed from `rows`.
        ok: Whether the solver finished and the residual is small enough.
        status: What the solver says of itself.
        iterations: How many it made.
        seconds: How long it took.
    """

    vector: Array
    iterate: Iterate
    rows: Array
    objective: float
    residual: float
    ok: bool
    status: str
    iterations: int
    seconds: float


def solve(made: Transcription, data: Bounds, start: Iterate, settings: Settings) -> Solution:
    """Solve from one start. The solver's word is not taken for it: rows are evaluated anew."""
    call = solver(made.system, made.form, settings)
    inputs = {
        "x0": np.clip(made.layout.pack(start), data.lower, data.upper),
        "p": data.parameters,
        "lbx": data.lower,
        "ubx": data.upper,
        "lbg": data.row_lower,
        "ubg": data.row_upper,
    }
    began = time.perf_counter()
    with heed_interrupts():
        found = call(**inputs)
    seconds = time.perf_counter() - began
    vector = _flat(found["x"])
    rows = _flat(made.program.rows(vector, data.parameters))
    residual = float(np.max(excess(rows, data.row_lower, data.row_upper), initial=0.0))
    stats = call.stats()
    return Solution(
        vector=vector,
        iterate=made.layout.unpack(vector),
        rows=rows,
        objective=float(found["f"]),
        residual=residual,
        ok=stats["return_status"] in _FINISHED and residual <= ACCEPTED_RESIDUAL,
        status=stats["return_status"],
        iterations=int(stats["iter_count"]),
        seconds=seconds,
    )


def excess(values: Array, lower: Array, upper: Array) -> Array:
    """How far each value lies outside its bounds, ≥ 0; infinite for NaN."""
    out = np.maximum(np.maximum(lower - values, values - upper), 0.0)
    return np.where(np.isnan(values), np.inf, out)


def prepare(
    system: TriangularSystem, form: Form, settings: Settings
) -> tuple[Transcription, float]:
    """The transcription and its solver, made now or before.

    Returns:
        The transcription, and the seconds it took to make: zero when it was there.
    """
    before = _made()
    began = time.perf_counter()
    made = transcription(system, form)
    solver(system, form, settings)
    return made, time.perf_counter() - began if _made() > before else 0.0


@lru_cache(maxsize=64)
def solver(system: TriangularSystem, form: Form, settings: Settings) -> Any:
    """CasADi's solver for a transcription and settings."""
    program = transcription(system, form).program
    options = {
        **program.derivatives,
        "no_nlp_grad": True,
        "calc_lam_p": False,
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt": _ipopt(settings),
    }
    return ca.nlpsol("collocation", "ipopt", program.problem, options)


def _ipopt(settings: Settings) -> dict[str, Any]:
    """Limits hold exactly at every iterate: bounds are not relaxed.

    A near start keeps its distance to the bounds and begins with a small barrier. IPOPT's own warm
    start, with multipliers, saved a few iterations more on easy problems and failed on long ones.
    """
    options: dict[str, Any] = {
        "print_level": 0,
        "sb": "yes",
        "tol": settings.tolerance,
        "constr_viol_tol": settings.tolerance,
        "max_iter": settings.max_iterations,
        "bound_relax_factor": 0.0,
    }
    if settings.near:
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
        options |= {"mu_init": NEAR, **dict.fromkeys(pushes, NEAR)}
    return options


def _made() -> int:
    return transcription.cache_info().misses + solver.cache_info().misses


def _flat(values: Any) -> Array:
    return np.asarray(values, dtype=float).ravel()
