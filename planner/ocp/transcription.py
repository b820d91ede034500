"""The transcription of a system: built once for each form, then reused with any numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from planner.ocp.assembly import Program, assemble
from planner.ocp.augmented import Moved
from planner.ocp.compiled import compiled
from planner.ocp.form import Form
from planner.ocp.interval import interval_functions
from planner.ocp.layout import Iterate, Layout, layout
from planner.ocp.order import order
from planner.ocp.stage import Rows, stage
from planner.problem import Problem
from planner.systems.base import Array, TriangularSystem


@dataclass(frozen=True, eq=False)
class Transcription:
    """A nonlinear programme with names; start, goal, limits, mesh and weights are numbers.

    Attributes:
        system: What is steered.
        form: Its shape.
        layout: Where each unknown sits.
        labels: What the rows of one interval mean.
        height: Rows of one interval.
        program: The functions.
        solvers: Those made for it, by their settings: they live as long as it does.
    """

    system: TriangularSystem
    form: Form
    layout: Layout
    labels: tuple[Rows, ...]
    height: int
    program: Program
    solvers: dict[Any, Any] = field(default_factory=dict)

    @property
    def moved(self) -> Moved:
        """What moves: the system, or more."""
        return self.form.augmented or self.system

    def start(self, problem: Problem) -> Array:
        """All that moves, at the start: what is not of the system begins at zero."""
        return np.append(problem.start, np.zeros(self.moved.size - self.system.size))

    def outcome(self, vector: Array, parameters: Array) -> tuple[float, Array, Iterate]:
        """What the unknowns lead to.

        Returns:
            The objective, the values of all rows, and the unknowns by name, with the collocation
            values that follow from them.
        """
        at, known = self.layout, parameters[self.form.parameters - 1]
        found = self.program.outcome(vector, parameters)
        end = 1 + at.intervals * self.height
        rows, points = found[1:end], found[end:]
        iterate = Iterate(
            duration=float(vector[at.durations[0]] if self.form.free_duration else known),
            nodes=vector[at.nodes],
            points=points.reshape(at.intervals, self.form.degree, -1),
            inputs=vector[at.inputs],
        )
        return float(found[0]), rows, iterate


@lru_cache(maxsize=64)
def transcription(system: TriangularSystem, form: Form) -> Transcription:
    """Build the transcription, or return the one built before.

    Raises:
        InputError: If it is to be compiled and cannot be.
    """
    moved = form.augmented or system
    dependencies = order(moved)
    places = layout(form, moved.size, dependencies.lifted)
    symbols = stage(system, form, dependencies)
    functions = interval_functions(symbols)
    if form.compiled:
        functions = compiled(functions)
    return Transcription(
        system=system,
        form=form,
        layout=places,
        labels=symbols.labels,
        height=symbols.height,
        program=assemble(symbols, places, functions),
    )
