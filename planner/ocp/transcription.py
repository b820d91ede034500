"""The transcription of a system: built once for each form, then reused with any numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from planner.ocp.assembly import Program, assemble
from planner.ocp.form import Form
from planner.ocp.layout import Layout, layout
from planner.ocp.stage import Rows, stage
from planner.systems.base import TriangularSystem


@dataclass(frozen=True, eq=False)
class Transcription:
    """A nonlinear programme with names; start, goal, limits, mesh and weights are numbers.

    Attributes:
        system: What moves.
        form: Its shape.
        layout: Where each unknown sits.
        labels: What the rows of one interval mean.
        height: Rows of one interval.
        program: The functions.
    """

    system: TriangularSystem
    form: Form
    layout: Layout
    labels: tuple[Rows, ...]
    height: int
    program: Program


@lru_cache(maxsize=64)
def transcription(system: TriangularSystem, form: Form) -> Transcription:
    """Build the transcription, or return the one built before."""
    places, symbols = layout(form, system.size), stage(system, form)
    return Transcription(
        system=system,
        form=form,
        layout=places,
        labels=symbols.labels,
        height=symbols.rows.numel(),
        program=assemble(symbols, places),
    )
