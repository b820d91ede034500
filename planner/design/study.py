"""A study of designs: every task planned on every mechanism, on the sweep engine, and judged."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.design.design_file import Asked, read_design
from planner.design.figures import (
    DesignRow,
    Figure,
    Outcome,
    able,
    best,
    chosen,
    commonest,
    judged_by,
    pareto,
    reason,
)
from planner.design.geometry import Design, kappa_of
from planner.errors import InputError
from planner.plan.samples import imported
from planner.problem.feasibility import TravelWindow, travel_window
from planner.support.arrays import jsonable
from planner.support.files import named, write_bytes, write_text
from planner.support.package import handed_to, versions
from planner.support.tables import (
    Column,
    csv_table,
    html_table,
    markdown,
    markdown_table,
    number,
    terminal_table,
)
from planner.sweep.results import read
from planner.sweep.run import run_sweep

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure as Picture
    from rich.table import Table

Progress = Callable[[str, float], None]
"""Told what is being done, and the share done, 0 … 1."""

CASES = "cases.sqlite"
"""The database of finished cases in a study's folder."""

FORMAT, VERSION = "planner-design", 1


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Designs of the mechanism, and what they are worth for a set of tasks; see `design_study`.

    Attributes:
        asked: The design file, read.
        rows: The designs in the order of the file; first the mechanism as it is, where asked for.
        figures: What they are judged by.
        front_by: Those that are traded.
        recommended: The row to take; None where no design solves a task.
        reason: Why that one, in sentences.
        bugs: Cases that ended in a way this program never should.
    """

    asked: Asked
    rows: tuple[DesignRow, ...]
    figures: tuple[Figure, ...]
    front_by: tuple[Figure, ...]
    recommended: DesignRow | None
    reason: str
    bugs: int = 0

    def __repr__(self) -> str:
        taken = self.recommended
        said = "no design solves a task" if taken is None else f"take {taken.design.name}"
        tasks = f"{self.tasks} task{'s' if self.tasks > 1 else ''}"
        return f"DesignStudy({self.asked.title!r}, {len(self.rows)} designs, {tasks}: {said})"

    def __getitem__(self, name: str) -> DesignRow:
        for row in self.rows:
            if row.design.name == name:
                return row
        raise InputError(
            f"no design '{name}'; there are: {'; '.join(r.design.name for r in self.rows)}"
        )

    @property
    def title(self) -> str:
        """What was asked."""
        return self.asked.title

    @property
    def tasks(self) -> int:
        """Number of tasks of each design."""
        return len(next(iter(self.asked.tasks.values())))

    @property
    def front(self) -> tuple[DesignRow, ...]:
        """The designs that no other beats in the figures traded.

        Those alone are compared that may be recommended: they can be built, solve as many tasks as
        any, and have contacts that hold.
        """
        return tuple(row for row in self.rows if row.on_front)

    @property
    def columns(self) -> list[Column[DesignRow]]:
        """What tables show of a row."""
        return _columns(self)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: designs with geometry and figures, the front, the recommendation."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "title": self.title,
            "source": self.asked.source,
            "tasks": self.tasks,
            "methods": self.asked.methods,
            "front_by": [figure.key for figure in self.front_by],
            "recommended": None if self.recommended is None else self.recommended.design.name,
            "reason": self.reason,
            "designs": [_row(row) for row in self.rows],
            "study": self.asked.table.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "versions": versions(),
        }
        return dict(jsonable(data))

    def to_frame(self) -> pandas.DataFrame:
        """One row a design: the variables that vary, geometry, figures, `on_front`, `refused`.

        Index: the design's name. Shares are 0 … 1.

        Raises:
            InputError: If pandas is not installed.
        """
        rows = [_flat(row) for row in self.rows]
        frame = imported("pandas").DataFrame.from_records(rows)
        frame.attrs = {"title": self.title, "tasks": self.tasks}
        return frame.set_index("design")

    def table(self) -> Table:
        """For a terminal: `rich.print(study.table())`."""
        narrow = {"design", *(figure.title for figure in self.front_by), *TERMINAL}
        narrow |= {f"solved, {method}" for method in self.asked.methods[:2]}
        shown = [c for c in self.columns if c.title in narrow]
        return terminal_table(
            shown,
            self.rows,
            caption=self._explained,
            ruled=True,
            gap=1,
            dim=lambda row: bool(row.design.refused),
        )

    def markdown(self) -> str:
        """The table and the recommendation as Markdown text."""
        refused = [
            f"- {markdown(row.design.name)}: {markdown(row.design.refused)}"
            for row in self.rows
            if row.design.refused
        ]
        cannot = ["", "Cannot be built:", "", *refused] if refused else []
        lines = [f"# {markdown(self.title)}", "", self.reason, ""]
        built = [row for row in self.rows if not row.design.refused]
        lines += [markdown_table(self.columns, built), *cannot, "", self._explained]
        return "\n".join(lines) + "\n"

    def _repr_html_(self) -> str:
        """The table, as a notebook shows it."""
        table = html_table(self.columns, self.rows, self.title)
        return f"{table}<p>{escape(self.reason)}</p><p><small>{escape(self._explained)}</small></p>"

    @property
    def _explained(self) -> str:
        replay = self.asked.table.replay
        return (
            f"{self.tasks} tasks; figures are of the plans by {self.asked.methods[0]}: effort,"
            " chart margin, errors and spread in the median over the tasks, peaks and contacts the"
            " largest. Contacts: torque over what they transmit, on 99 % of the machines. E:"
            " largest joint error at any time, in the median; error at the end: of 95 % of them"
            "; spread: largest standard deviation of a joint at the end"
            f" ({replay.samples} machines, seed {replay.seed}). Least link: the length that the"
            " parts need to clear each other. *: no other design beats it in"
            f" {' and '.join(figure.title for figure in self.front_by)}."
        )

    def plot(self, *, axes: Any = None) -> tuple[Picture, Any]:
        """One picture for a designer; see `planner.report.plot_design`."""
        drawn: tuple[Picture, Any] = handed_to("planner.report.figures.design.plot_design")(
            self, axes=axes
        )
        return drawn

    def save(self, folder: str | Path) -> Path:
        """Write design.md, design.csv, design.json and design.png to a folder, made when missing.

        Each file is written whole or not at all; those of an earlier study are replaced.

        Raises:
            InputError: If the folder or a file cannot be written.
        """
        place = _made(folder)
        write_text(place / "design.md", self.markdown() + "\n![The study](design.png)\n")
        write_text(place / "design.csv", csv_table(self.columns, self.rows))
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
        write_text(place / "design.json", text + "\n")
        write_bytes(place / "design.png", _png(self.plot()[0]))
        return place


def design_study(
    design: Mapping[str, Any] | str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> DesignStudy:
    """Compare designs of the mechanism by what they are worth for a set of tasks.

    Every task is planned on every design, verified, replayed on emulated machines and, where asked
    for, compensated for them. Each finished case is kept in the folder at once, so that a study
    that ends early, however it ends, is continued by the same call.

    Args:
        design: A design file (TOML), or its tables; `problem` may be a `Problem`. See
            `planner.design.design_file.DesignFile` for the keys.
        folder: Where finished cases are kept; nowhere when left out. `DesignStudy.save` writes
            the results.
        workers: Processes of this computer, as many as it has cores when left out; 0 plans in this
            process.
        cluster: Address of a Dask scheduler to use instead.
        progress: Told how far it is.

    Returns:
        All designs, those that cannot be built with the inequality that rules them out.

    Raises:
        InputError: If the file is wrong, no design can be built, or the folder cannot be used.
        KeyboardInterrupt: If interrupted; finished cases are kept.
    """
    asked = read_design(design)
    first, *others = asked.methods
    compensated = others.pop() if asked.table.compensated else None
    judged = judged_by([first, *others], compensated)
    figures = [figure for figure, _ in judged]
    link = Figure("least_link", "least link")
    traded = chosen(asked.table.front, [*figures, link], asked.source)
    windows = _windows(asked)
    place = tempfile.TemporaryDirectory() if folder is None else nullcontext(_made(folder))
    with place as made:
        db = Path(made) / CASES
        outcome = run_sweep(asked.sweep(), db, workers=workers, cluster=cluster, progress=progress)
        records = iter(read(db)[1])
    rows = []
    for each in asked.designs:
        if each.refused:
            rows.append(DesignRow(each, {}))
            continue
        outcomes = [
            Outcome(window, {method: next(records) for method in asked.methods})
            for window in windows[each.name]
        ]
        values = {figure.key: value(outcomes) for figure, value in judged}
        values[link.key] = each.least_link
        rows.append(DesignRow(each, values, why=commonest(outcomes, first)))
    return replace(_recommended(asked, rows, [*figures, link], traded), bugs=outcome.bugs)


def _windows(asked: Asked) -> dict[str, list[TravelWindow]]:
    """Of every task on each design that can be built; what cannot be a problem is refused here."""
    out: dict[str, list[TravelWindow]] = {}
    for each in asked.designs:
        if not each.refused:
            posed = (asked.posed(each, task) for task in asked.tasks[each.joints])
            found = map(travel_window, posed)
            out[each.name] = [window for window in found if window is not None]
    return out


def _recommended(
    asked: Asked, rows: list[DesignRow], figures: Sequence[Figure], traded: Sequence[Figure]
) -> DesignStudy:
    kept = able(rows, traded, f"solved {asked.methods[0]}")
    taken = best(rows, kept, traded) if kept else None
    values = np.array([[rows[k][figure.key] for figure in traded] for k in kept])
    if kept:
        for k, kept_one in zip(kept, pareto(values, [f.better for f in traded]), strict=True):
            rows[k] = replace(rows[k], on_front=bool(kept_one))
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


TERMINAL = ("effort", "one-way", "contacts", "error at the end")
"""Columns of a terminal, beside those of the figures traded."""


GEAR = ("r1", "R", "r3", "lam", "eta")


def _of_gear(key: str, row: DesignRow) -> float:
    return float(getattr(row.design.gear, key))


def _columns(study: DesignStudy) -> list[Column[DesignRow]]:
    def of(key: str) -> Callable[[DesignRow], float]:
        return lambda row: row.figures.get(key, np.nan)

    def counted(value: float) -> str:
        return f"{value * study.tasks:.0f} of {study.tasks}" if np.isfinite(value) else "-"

    def percent(value: float) -> str:
        return f"{100 * value:.3g}" if np.isfinite(value) else "-"

    out: list[Column[DesignRow]] = [
        Column("design", "", _name, left=True),
        Column("rho", "", lambda row: row.design.gear.rho),
        Column("kappa", "", lambda row: kappa_of(row.design.gear)),
        *(
            Column(name, "", partial(_of_gear, key), shown=None)
            for key, name in zip(GEAR, ("r1", "R", "r3", "lambda", "eta"), strict=True)
        ),
        Column("joints", "", lambda row: row.design.joints, shown=None),
    ]
    solved = [f for f in study.figures if f.key.startswith("solved")]
    for figure in [*solved, *(f for f in study.figures if f not in solved)]:
        shown: Any = number
        unit = figure.unit
        if figure.key == "one_way" or figure in solved:
            shown = counted
        elif figure.key == "window":
            shown, unit = percent, "%"
        out.append(
            Column(figure.title, unit, of(figure.key), shown, key=figure.key.replace(" ", "_"))
        )
    out.append(Column("on_front", "", lambda row: row.on_front, shown=None))
    out.append(Column("refused", "", lambda row: row.design.refused, shown=None))
    return out


def _name(row: DesignRow) -> str:
    return row.design.name + " *" * row.on_front


def _row(row: DesignRow) -> dict[str, Any]:
    own = _flat(row)
    figures = {key: own.pop(key) for key in row.figures}
    return {**own, "values": dict(row.design.values), "figures": figures, "why": row.why}


def _flat(row: DesignRow) -> dict[str, Any]:
    each: Design = row.design
    gear = {"r1": each.gear.r1, "R": each.gear.R, "r3": each.gear.r3}
    gear |= {"lambda": each.gear.lam, "eta": each.gear.eta}
    return {
        "design": each.name,
        "joints": each.joints,
        "rho": each.gear.rho,
        "kappa": kappa_of(each.gear),
        **gear,
        "link_lengths": None if each.link_lengths is None else list(each.link_lengths),
        **row.figures,
        "on_front": row.on_front,
        "refused": each.refused,
    }


def _made(folder: str | Path) -> Path:
    """The folder, made when missing.

    Raises:
        InputError: If it is a file or cannot be made.
    """
    place = named(folder)
    if place.exists() and not place.is_dir():
        raise InputError(f"{place} is a file; name a folder")
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {place}: {error.strerror or error}") from None
    return place


def _png(figure: Picture) -> bytes:
    from io import BytesIO

    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()
