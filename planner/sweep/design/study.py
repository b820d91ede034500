"""A design study: plans every task on every mechanism, on the sweep engine, and compares them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.problem.feasibility import TravelWindow, travel_window
from planner.support.progress import expect_listener
from planner.sweep.design.design_file import StudyInput, read_design
from planner.sweep.design.figures import (
    DesignRow,
    Figure,
    TaskOutcome,
    able,
    best,
    chosen,
    commonest,
    judged_by,
    pareto,
    reason,
)
from planner.sweep.design.result import DesignStudy, folder_made
from planner.sweep.results import read
from planner.sweep.run import run_sweep

Progress = Callable[[str, float], None]
"""Called with the current step and the completed share, 0 … 1."""

CASES = "cases.sqlite"
"""The database of finished cases in a study's folder."""


def design_study(
    design: Mapping[str, Any] | str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> DesignStudy:
    """Compare designs of the mechanism on a set of tasks.

    Every task is planned on every design, verified, replayed on emulated machines and, where asked
    for, compensated for them. Each finished case is saved in the folder at once, so the same
    call continues a study that ended early for any reason.

    Args:
        design: A design file (TOML), or its tables; `problem` may be a `Problem`. See
            `planner.sweep.design.design_file.DesignFile` for the keys.
        folder: Where finished cases are kept; nowhere when left out. `DesignStudy.save` writes
            the results.
        workers: Processes of this computer, as many as it has cores when left out; 0 plans in this
            process.
        cluster: Address of a Dask scheduler to use instead.
        progress: Called with the current step and the completed share.

    Returns:
        All designs; those that cannot be built carry the inequality that they violate.

    Raises:
        InputError: If the file is wrong, no design can be built, or the folder cannot be used.
        KeyboardInterrupt: If interrupted; finished cases are kept.
    """
    expect_listener(progress)
    tell = progress or (lambda _, __: None)
    tell("reading", 0.0)
    asked = read_design(design)
    first, *others = asked.methods
    compensated = others.pop() if asked.table.compensated else None
    judged = judged_by([first, *others], compensated)
    figures = [figure for figure, _ in judged]
    link = Figure("least_link", "least link")
    traded = chosen(asked.table.front, [*figures, link], asked.source)
    windows = _windows(asked)
    place = tempfile.TemporaryDirectory() if folder is None else nullcontext(folder_made(folder))
    with place as made:
        db = Path(made) / CASES
        outcome = run_sweep(asked.sweep(), db, workers=workers, cluster=cluster, progress=progress)
        tell("comparing", 1.0)
        records = iter(read(db)[1])
    rows = []
    for each in asked.designs:
        if each.refused:
            rows.append(DesignRow(each, {}))
            continue
        outcomes = [
            TaskOutcome(window, {method: next(records) for method in asked.methods})
            for window in windows[each.name]
        ]
        values = {figure.key: value(outcomes) for figure, value in judged}
        values[link.key] = each.least_link
        rows.append(DesignRow(each, values, why=commonest(outcomes, first)))
    return replace(_recommended(asked, rows, [*figures, link], traded), bugs=outcome.bugs)


def _windows(asked: StudyInput) -> dict[str, list[TravelWindow]]:
    """Of every task on each design that can be built; raises for an impossible problem."""
    out: dict[str, list[TravelWindow]] = {}
    for each in asked.designs:
        if not each.refused:
            posed = (asked.posed(each, task) for task in asked.tasks[each.joints])
            found = map(travel_window, posed)
            out[each.name] = [window for window in found if window is not None]
    return out


def _recommended(
    asked: StudyInput, rows: list[DesignRow], figures: Sequence[Figure], traded: Sequence[Figure]
) -> DesignStudy:
    kept = able(rows, traded, f"solved {asked.methods[0]}")
    taken = best(rows, kept, traded) if kept else None
    values = np.array([rows[k][figure.key] for k in kept for figure in traded])
    unbeaten = pareto(values.reshape(len(kept), len(traded)), [f.better for f in traded])
    for k, on_front in zip(kept, unbeaten, strict=True):
        rows[k] = replace(rows[k], on_front=bool(on_front))
    tasks = len(next(iter(asked.tasks.values())))
    said = reason(rows, taken, kept, traded, asked.methods, tasks)
    return DesignStudy(
        asked=asked,
        rows=tuple(rows),
        figures=tuple(figures),
        front_by=tuple(traded),
        recommended=None if taken is None else rows[taken],
        reason=said,
    )
