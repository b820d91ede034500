"""A design study, run as a sweep, and its result: a table, a picture, a folder."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from html import escape
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.machine.machine import Machine
from planner.plan.samples import import_library
from planner.problem.feasibility import travel_window
from planner.support.arrays import Frozen, jsonable
from planner.support.files import make_folder, write_figure, write_json, write_text
from planner.support.package import DataFrame, Figure, Table, draw_figure, provenance, versions
from planner.support.progress import Tell, expect_listener
from planner.support.tables import (
    Column,
    csv_table,
    html_table,
    markdown,
    markdown_table,
    number,
    short_number,
    terminal_table,
)
from planner.sweep.case import cases
from planner.sweep.description import Sweep
from planner.sweep.design.design_file import StudyInput, read_design
from planner.sweep.design.figures import DesignFigure, DesignRow, outcome, recommend
from planner.sweep.design.geometry import gear_table
from planner.sweep.results import read
from planner.sweep.run import expect_workers, run_sweep

FORMAT, VERSION = "planner-design", 1


@dataclass(frozen=True, eq=False)
class DesignStudy(Frozen):
    """Designs of the mechanism, compared on a set of tasks; see `design_study`.

    Attributes:
        input: The contents of the design file.
        rows: The designs in the order of the file; the base mechanism, if included, is first.
        figures: The criteria that compare the designs.
        front_by: The criteria to trade off.
        recommended: The row of the recommended design; None if no design solves a task.
        reason: The reason for the recommendation, in sentences.
        bugs: Number of cases that ended with an unexpected error, a bug of this program.
        seconds: Total time of the cases of each method, in seconds, without parallelism.
    """

    input: StudyInput
    rows: tuple[DesignRow, ...]
    figures: tuple[DesignFigure, ...]
    front_by: tuple[DesignFigure, ...]
    recommended: DesignRow | None
    reason: str
    bugs: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        choice = self.recommended
        answer = "no design solves a task" if choice is None else f"take {choice.design.name}"
        tasks = f"{self.tasks} task{'s' if self.tasks > 1 else ''}"
        return f"DesignStudy({self.input.title!r}, {len(self.rows)} designs, {tasks}: {answer})"

    def __getitem__(self, name: str) -> DesignRow:
        by_name = {row.design.name: row for row in self.rows}
        if name not in by_name:
            raise InputError(f"no design '{name}'; there are: {'; '.join(by_name)}")
        return by_name[name]

    @property
    def title(self) -> str:
        """The question of the study."""
        return self.input.title

    @property
    def tasks(self) -> int:
        """Number of tasks of each design."""
        return len(next(iter(self.input.tasks.values())))

    @property
    def front(self) -> tuple[DesignRow, ...]:
        """The Pareto front: designs that no other beats in the figures to trade off.

        Only candidates are compared: designs that can be built, solve as many tasks as any, and
        have contacts that do not slip.
        """
        return tuple(row for row in self.rows if row.on_front)

    @property
    def columns(self) -> list[Column[DesignRow]]:
        """The columns of the study's tables."""
        return _columns(self)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data: designs with geometry and figures, front, recommendation."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "title": self.title,
            "source": self.input.source,
            "tasks": self.tasks,
            "methods": self.input.methods,
            "front_by": [figure.key for figure in self.front_by],
            "recommended": None if self.recommended is None else self.recommended.design.name,
            "reason": self.reason,
            "seconds": dict(self.seconds),
            "designs": [
                {k: v for k, v in _record(row).items() if k not in row.figures}
                | {"values": row.design.values, "figures": row.figures, "why": row.why}
                for row in self.rows
            ],
            "study": self.input.table.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "versions": versions(),
        }
        return dict(jsonable(data))

    def to_frame(self) -> DataFrame:
        """Return one row per design: variables, geometry, figures, `on_front`, `refused`.

        The index is the name of the design. Shares are from 0 to 1.

        Raises:
            InputError: If pandas is not installed.
        """
        frame = import_library("pandas").DataFrame.from_records([_record(row) for row in self.rows])
        frame.attrs = {"title": self.title, "tasks": self.tasks}
        return frame.set_index("design")

    def table(self) -> Table:
        """Return the study's table for a terminal: `rich.print(study.table())`."""
        narrow = {"design", "front", *(figure.title for figure in self.front_by), *TERMINAL_COLUMNS}
        narrow.add(f"solved, {self.input.reaching}")
        return terminal_table(
            [column for column in self.columns if column.title in narrow],
            self.rows,
            caption=self._caption,
            ruled=True,
            style=lambda row: "dim" * bool(row.design.refused),
        )

    def markdown(self) -> str:
        """Return the study's table and recommendation as Markdown."""
        built = [row for row in self.rows if not row.design.refused]
        lines = [f"# {markdown(self.title)}", "", self.reason, ""]
        lines.append(markdown_table(self.columns, built))
        if len(built) < len(self.rows):
            lines += ["", "Cannot be built:", ""]
        for each in (row.design for row in self.rows if row.design.refused):
            lines.append(f"- {markdown(each.name)}: {markdown(each.refused)}")
        return "\n".join([*lines, "", self._caption]) + "\n"

    def _repr_html_(self) -> str:
        """Return the study's table and recommendation as HTML for a notebook."""
        table = html_table(self.columns, self.rows, self.title)
        return f"{table}<p>{escape(self.reason)}</p><p><small>{escape(self._caption)}</small></p>"

    @property
    def _caption(self) -> str:
        replay = self.input.table.replay
        before = Machine.from_table(self.input.base.machine).start_words
        return (
            f"{self.tasks} tasks; figures of the plans by {self.input.methods[0]}: effort, chart"
            " margin, errors and spread are medians over the tasks, peaks and loads the largest."
            " Contacts: load over the load at which a contact slips; motor torque: of motor 1;"
            " both are the 99th percentile of the machines; motor power: motor torque times the"
            " largest speed. E: largest joint error at any time, median; error at the end: 95th"
            " percentile; spread: largest standard deviation of a joint at the end"
            f" ({replay.samples} machines, {before}, seed {replay.seed}). Least link:"
            " the length that the parts need to clear each other. Front: no other design beats it"
            f" in {' and '.join(figure.title for figure in self.front_by)}.{self._price}"
        )

    @property
    def _price(self) -> str:
        """A sentence on the computing time of all plans and of compensated plans, or ""."""
        if not self.input.table.compensated:
            return ""
        most = sum(self.seconds.values())
        part = self.seconds.get(self.input.reaching, 0.0)
        return (
            f" Planning and replays took {number(most)} s of one processor, {number(part)} s of"
            " them for the compensated plans."
        )

    def plot(self) -> Figure:
        """Draw the study with `planner.report.plot_design`."""
        return draw_figure("design.plot_design", self)

    def save(self, folder: str | Path) -> Path:
        """Write design.md, design.csv, design.json and design.png to a folder.

        The folder is created if missing. Each file is written completely or not at all; files of an
        earlier study are replaced.

        Raises:
            InputError: If the folder or a file cannot be written.
        """
        place = make_folder(folder)
        again = provenance(f"planner design {self.input.source} --out {folder}")
        write_text(place / "design.md", f"{self.markdown()}\n![The study](design.png)\n\n{again}\n")
        write_text(place / "design.csv", csv_table(self.columns, self.rows))
        write_json(place / "design.json", self.to_dict())
        write_figure(place / "design.png", self.plot())
        return place


TERMINAL_COLUMNS = ("contacts", "error at the end")
"""Columns shown on a terminal, in addition to the columns of the figures to trade off."""


def _columns(study: DesignStudy) -> list[Column[DesignRow]]:
    def column(key: str, title: str = "", unit: str = "", format: Any = None) -> Column[DesignRow]:
        name = key.replace(" ", "_")
        return Column(title or key, unit, lambda r: _record(r).get(key, np.nan), format, key=name)

    def count_tasks(value: float) -> str:
        return f"{value * study.tasks:.0f} of {study.tasks}" if np.isfinite(value) else "-"

    out = [
        Column("design", "", lambda row: row.design.name, left=True),
        Column("front", "", lambda row: "take" if row is study.recommended else "*" * row.on_front),
        column("rho", format=short_number),
        column("kappa", format=short_number),
        *map(column, ("r1", "R", "r3", "lambda", "eta", "joints", "contact_force_n")),
    ]
    for figure in sorted(study.figures, key=lambda f: not f.key.startswith("solved")):
        unit, format = figure.unit, count_tasks if figure.reduction == "part" else number
        if figure.key == "window":
            unit, format = "%", lambda value: number(100 * value)
        out.append(column(figure.key, figure.title, unit, format))
    return [*out, column("refused")]


def _record(row: DesignRow) -> dict[str, Any]:
    each = row.design
    return {
        "design": each.name,
        "joints": each.joints,
        "rho": each.gear.rho,
        "kappa": each.gear.k(1),
        **gear_table(each.gear),
        "contact_force_n": each.values.get("contact_force_n"),
        "link_lengths": None if each.link_lengths is None else list(each.link_lengths),
        **row.figures,
        "on_front": row.on_front,
        "refused": each.refused,
    }


CASES_FILE = "cases.sqlite"
"""File name of the database of finished cases in a study's folder."""


def design_study(
    design: Mapping[str, Any] | str | Path,
    folder: str | Path | None = None,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Tell | None = None,
) -> DesignStudy:
    """Compare designs of the mechanism on a set of tasks.

    Every task is planned on every design, verified, replayed on emulated machines and, if
    requested, compensated for them. Each finished case is saved in the folder at once, so the same
    call continues an interrupted study.

    Args:
        design: A design file (TOML), or its tables; `problem` may be a `Problem`. See
            `planner.sweep.design.design_file.DesignFile` for the keys.
        folder: Folder for finished cases, which by default are not kept. `DesignStudy.save` writes
            the results.
        workers: Number of processes on this computer. By default one per core; 0 plans in this
            process.
        cluster: Address of a Dask scheduler to use instead.
        progress: Called with the current step and the completed share.

    Returns:
        The study with all designs; a design that cannot be built has the violated inequality.

    Raises:
        InputError: If the file is wrong, no design can be built, or the folder cannot be used.
        KeyboardInterrupt: If interrupted; finished cases are kept.
    """
    tell = expect_listener(progress)
    expect_workers(workers, cluster)
    tell("reading", 0.0)
    study = read_design(design)
    # This refuses an impossible task before anything is planned.
    windows = iter([travel_window(study.problem_of(*pair)) for pair in study.pairs])
    place = tempfile.TemporaryDirectory() if folder is None else nullcontext(make_folder(folder))
    with place as kept_folder:
        db = Path(kept_folder) / CASES_FILE
        task = Sweep.from_dict(study.sweep())
        run = run_sweep(task, db, workers=workers, cluster=cluster, progress=progress)
        tell("comparing", 1.0)
        results = {record["case"]: record for record in read(db, run.sweep)[1]}
    found = (results[case.key] for case in cases(task))
    rows, seconds = [], dict.fromkeys(study.methods, 0.0)
    for each in study.designs:
        if each.refused:
            rows.append(DesignRow(each, {}))
            continue
        of_tasks = [{m: next(found) for m in study.methods} for _ in study.tasks[each.joints]]
        outcomes = [outcome(each, next(windows), of_methods) for of_methods in of_tasks]
        for method, case in chain.from_iterable(task.items() for task in of_tasks):
            seconds[method] += case["case_time_s"] or 0.0
        first = [of_methods[study.reaching] for of_methods in of_tasks]
        whys = Counter(case["why"] for case in first if not case["solved"]).most_common(1)
        values = {figure.key: figure.value(outcomes) for figure in study.figures}
        rows.append(DesignRow(each, values, why=whys[0][0] if whys else ""))
    tasks = len(next(iter(study.tasks.values())))
    marked, choice, reason = recommend(rows, study.front_by, study.reaching, tasks)
    return DesignStudy(
        study, marked, study.figures, study.front_by, choice, reason, run.bugs, seconds
    )
