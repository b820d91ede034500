"""The call of a solver, kept once made; what it says of itself is checked."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from planner.methods.collocation.solvers.backends import (
    Answer,
    Backend,
    Settings,
    SolverName,
    backend,
    names,
)
from planner.methods.collocation.transcription.bounds import Bounds
from planner.methods.collocation.transcription.form import Form
from planner.methods.collocation.transcription.transcription import Transcription, transcription
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.support import deadline, progress
from planner.support.arrays import Array
from planner.systems.triangular_system import TriangularSystem

ACCEPTED_RESIDUAL = 1e-7
"""Largest excess of a row over its bounds, in its own unit, that counts as solved."""

FEASIBLE = 1e-5
"""Residual up to which one solver's last iterate is a better start for the other than the first."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the solver stopped.

    Attributes:
        solver: Who it was, or None for an iterate taken as it is.
        vector: The unknowns, shape (size,).
        iterate: The same by name.
        rows: Values of all rows there, evaluated anew.
        objective: Value of the objective.
        residual: Largest excess of a row or unknown over its bounds, computed from `rows`.
        ok: Whether the solver finished and the residual is small enough.
        status: What the solver says of itself.
        iterations: How many it made.
        seconds: Computing time, in seconds.
    """

    solver: SolverName | None
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
    """Solve from one start, by the other solver where the first fails and both are allowed."""
    first, *others = names(made, settings)
    solution = _solve(first, made, data, start, settings)
    for name in others:
        if solution.ok:
            break
        if solution.residual <= FEASIBLE:
            start, settings = solution.iterate, replace(settings, near=True)
        other = _solve(name, made, data, start, settings)
        solution = replace(
            other,
            iterations=solution.iterations + other.iterations,
            seconds=solution.seconds + other.seconds,
        )
    return solution


def _solve(
    name: SolverName, made: Transcription, data: Bounds, start: Iterate, settings: Settings
) -> Solution:
    """One solver's answer."""
    deadline.check()
    progress.solved()
    call = solver(made, replace(settings, solver=name))
    packed = made.layout.pack(start, data.widths).clip(data.lower, data.upper)
    began = time.perf_counter()
    answer = call(packed, data)
    seconds = time.perf_counter() - began
    inside = replace(answer, vector=answer.vector.clip(data.lower, data.upper))
    return _checked(made, data, inside, ACCEPTED_RESIDUAL, name, seconds)


def judged(made: Transcription, data: Bounds, iterate: Iterate) -> Solution:
    """An iterate that no solver has touched, as a solution; ok if it keeps rows and bounds."""
    answer = Answer(made.layout.pack(iterate, data.widths), True, "a motion, not the best", 0)
    return _checked(made, data, answer, FEASIBLE)


def _checked(
    made: Transcription,
    data: Bounds,
    answer: Answer,
    accepted: float,
    name: SolverName | None = None,
    seconds: float = 0.0,
) -> Solution:
    """An answer, whose word is not taken for it: rows are evaluated anew."""
    objective, rows, iterate = made.outcome(answer.vector, data.parameters)
    over = (
        excess(rows, data.row_lower, data.row_upper),
        excess(answer.vector, data.lower, data.upper),
    )
    residual = float(np.concatenate(over).max())
    return Solution(
        solver=name,
        vector=answer.vector,
        iterate=iterate,
        rows=rows,
        objective=objective,
        residual=residual,
        ok=answer.finished and residual <= accepted,
        status=answer.status,
        iterations=answer.iterations,
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
    built = transcription.cache_info().misses
    began = time.perf_counter()
    made = transcription(system, form)
    wanted = replace(settings, solver=names(made, settings)[0])
    new = transcription.cache_info().misses > built or wanted not in made.solvers
    solver(made, wanted)
    return made, time.perf_counter() - began if new else 0.0


def solver(made: Transcription, settings: Settings) -> Backend:
    """The solver of a transcription, made once for each settings (which name one solver)."""
    if settings not in made.solvers:
        made.solvers[settings] = backend(made, settings)
    found: Backend = made.solvers[settings]
    return found
