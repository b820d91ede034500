"""What a comparison holds, the ways to look at it, and how it is made again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.comparison.rows import CLOSED, INTERVALS, NAME_WIDTH, WIDTH, Column, Row, verdict
from planner.errors import InputError
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.problem.problem import Problem, load_problem
from planner.support import tables
from planner.support.arrays import jsonable
from planner.support.files import toml
from planner.support.package import handed_to
from planner.support.statistics import Difference, differences
from planner.support.tables import clean, html_table, markdown_code, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

FORMAT = "planner-comparison"
VERSION = 1


@dataclass(frozen=True, eq=False)
class Comparison:
    """One row a method; see `compare`.

    Attributes:
        problem: What all of them solve.
        rows: In the order asked for.
        machine: The distribution of machines that every plan met.
        samples: Number of machines drawn from it.
        seed: Seed of the draws.
        chosen: Their numbers in the draw; None for the first `samples`.
        complete: Whether all that was asked for was done; False after Ctrl-C.
    """

    problem: Problem
    rows: tuple[Row, ...]
    machine: Machine
    samples: int
    seed: int
    chosen: tuple[int, ...] | None = None
    complete: bool = True

    def __repr__(self) -> str:
        rows = "".join(f"\n  {row!r}" for row in self.rows)
        partial = "" if self.complete else ", interrupted"
        machines = f"{self.samples} machine{'s' if self.samples > 1 else ''}, seed {self.seed}"
        return f"Comparison({self.problem.name!r}, {machines}{partial}:{rows})"

    def __getitem__(self, label: str) -> Row:
        for row in self.rows:
            if row.label == label:
                return row
        raise InputError(f"no row '{label}'; there are: {', '.join(r.label for r in self.rows)}")

    @property
    def plans(self) -> Mapping[str, Plan | None]:
        """Each label's plan, as the figures take them."""
        return {row.label: row.plan for row in self.rows if not row.feedback}

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Every two replayed plans, machine by machine; see `significance`."""
        runs = {row.label: row.replay for row in self.rows if row.worst is not None}
        return differences({k: run.index_E_deg for k, run in runs.items() if run is not None})

    @property
    def best(self) -> str | None:
        """Label of the plan with the least median error; verified ones go first."""
        ranked = [(not row.solved, row.E_median_deg, row.label) for row in self.rows]
        ranked = [entry for entry in ranked if np.isfinite(entry[1])]
        return min(ranked)[2] if ranked else None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: rows, problem, machine, seed, versions and the command that repeats it."""
        from planner.support.package import versions

        data = {
            "format": FORMAT,
            "version": VERSION,
            "source": self.problem.source,
            "command": command(self),
            "samples": self.samples,
            "seed": self.seed,
            "complete": self.complete,
            "rows": [self._row(row) for row in self.rows],
            "differences": [{**asdict(d), "significant": d.significant} for d in self.differences],
            "problem": self.problem.to_dict(),
            "machine": self.machine.to_dict(),
            "versions": versions(),
        }
        return dict(jsonable(data))

    def _row(self, row: Row) -> dict[str, Any]:

        return {**row.to_dict(), "worst_command": worst_command(self, row)}

    def table(self) -> Table:
        """For a terminal, at most 100 columns wide: `rich.print(comparison.table())`."""

        return comparison_table(self)

    def _repr_html_(self) -> str:
        """The table, as a notebook shows it."""

        return comparison_html(self)

    def markdown(self) -> str:
        """The table as Markdown text."""

        return comparison_markdown(self)

    def figures(self) -> dict[str, Figure]:
        """Figures by name: z, joints, inputs, arm, errors, effort, replay; those that apply."""
        made: dict[str, Figure] = handed_to("planner.report.folders.figures")(self)
        return made

    def save(self, folder: str | Path, *, report: bool = False) -> Path:
        """Write table, figures, plans and data to a folder, all or nothing.

        Args:
            folder: An earlier run's is replaced.
            report: Whether to add report.html, a page that opens from disk.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        saved: Path = handed_to("planner.report.folders.save")(self, folder, report=report)
        return saved


def command(comparison: Comparison, out: str | None = None, *, report: bool = False) -> str | None:
    """The command line that repeats a comparison.

    Whatever the problem or the machine changes against the problem's file becomes a `--set`.

    Args:
        comparison: What to repeat.
        out: The folder to name.
        report: Whether that folder holds a page.

    Returns:
        The command, or None if no command gives this problem (its file is gone, or lacks what
        only the file can take away).
    """
    settings = _settings(comparison)
    if settings is None:
        return None
    words = ["planner", "compare", comparison.problem.source]
    words += ["--methods", ",".join(dict.fromkeys(row.spec for row in comparison.rows))]
    words += ["--feedback"] * any(row.feedback for row in comparison.rows)
    for drawn in comparison.chosen or ():
        words += ["--sample", str(drawn)]
    if comparison.chosen is None:
        words += ["--samples", str(comparison.samples)]
    words += ["--seed", str(comparison.seed)]
    for key, value in settings.items():
        words += ["--set", f"{key}={toml(value)}"]
    if out is not None:
        words += ["--out", out, *["--report"] * report]
    return shlex.join(words)


def worst_command(comparison: Comparison, row: Row) -> str | None:
    """The command line that replays a row's worst machine alone; None where there is none."""
    if row.worst is None:
        return None
    alone = replace(comparison, rows=(row,), chosen=(row.worst,))
    return command(alone)


def _settings(comparison: Comparison) -> dict[str, Any] | None:
    problem, machine = comparison.problem, comparison.machine
    try:
        filed = load_problem(problem.source)
    except InputError:
        return None
    settings = _changes(filed.to_dict(), problem.to_dict())
    if settings is None:
        return None
    usual = Machine.from_table(problem.machine).to_dict()
    own = machine.to_dict()
    changed = {f"machine.{key}": own[key] for key in own if own[key] != usual[key]}
    return {**settings, **changed}


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any] | None:
    """Dotted keys to values that turn one table into another; None if a key would have to go."""
    out: dict[str, Any] = {}
    if before.keys() - after.keys():
        return None
    for key, value in after.items():
        old = before.get(key, {} if isinstance(value, Mapping) else None)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            inner = _changes(old, value)
            if inner is None:
                return None
            out |= {f"{key}.{name}": item for name, item in inner.items()}
        elif value != old:
            out[key] = value
    return out


def columns(comparison: Comparison) -> list[Column]:
    """The columns of issue and design, in their order."""
    system = comparison.problem.system
    length, (first, second) = system.coordinates[0].unit, system.inputs
    return [
        Column("travel", length, lambda r: number(r.travel_rad, 4)),
        Column("effort", "", lambda r: number(r.effort, 4)),
        Column("|u1|", first.unit, lambda r: number(r.peak_u[0])),
        Column("|u2|", second.unit, lambda r: number(r.peak_u[1])),
        Column("domain margin", "", lambda r: number(r.domain_margin)),
        Column("ideal error", "deg", lambda r: number(r.terminal_error_deg, 2)),
        Column("E 50 %", "deg", lambda r: number(r.E_median_deg)),
        Column("E 95 %", "deg", lambda r: number(r.E_p95_deg)),
        Column("solve", "s", lambda r: number(r.solve_time_s, 2)),
    ]


def comparison_table(comparison: Comparison) -> Table:
    """For a terminal, at most 100 columns wide."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        box=SIMPLE_HEAD,
        padding=0,
        show_edge=False,
        pad_edge=False,
        caption=_explained(comparison),
        caption_justify="left",
    )
    shown = columns(comparison)
    heads = [c.title.replace(" ", "\n", 1) + (f"\n{c.unit}" if c.unit else "") for c in shown]
    cells = [[column.text(row) for column in shown] for row in comparison.rows]
    names = [row.label.replace(":", ":\n") for row in comparison.rows]
    name_width = min(NAME_WIDTH, _width(["method", *names]))
    figures = sum(1 + _width([head, *column]) for head, *column in zip(heads, *cells, strict=True))
    table.add_column("method", width=name_width, overflow="fold")
    table.add_column("solved", max_width=WIDTH - name_width - 1 - figures, overflow="fold")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for row, name, texts in zip(comparison.rows, names, cells, strict=True):
        table.add_row(name, verdict(row), *texts, style="" if row.solved else "dim")
    return table


def _width(texts: Sequence[str]) -> int:
    """Columns that the widest line takes."""
    return max(len(part) for text in texts for part in text.split("\n"))


def comparison_markdown(comparison: Comparison) -> str:
    """Markdown text with a heading, the table, what it says, and how to make it again."""
    shown = [*columns(comparison), *INTERVALS]
    titles = ["method", "solved", *(_titled(column) for column in shown)]
    rule = ["---", "---", *("---:" for _ in shown)]
    body = [
        [markdown_code(row.label), tables.markdown(verdict(row)), *(c.text(row) for c in shown)]
        for row in comparison.rows
    ]
    lines = ["| " + " | ".join(cells) + " |" for cells in (titles, rule, *body)]
    repeat = command(comparison)
    again = (
        f"Made by:\n\n    {clean(repeat)}\n"
        if repeat
        else "Made from Python; `comparison.json` holds the problem, the machine and the seed.\n"
    )
    heading = f"# Comparison: {tables.markdown(comparison.problem.name)}\n"
    if not comparison.complete:
        heading += "\n**Partial: interrupted before all methods were done.**\n"
    after = ["", _explained(comparison), "", *_worst(comparison), again]
    return "\n".join([heading, *lines, *after])


def comparison_html(comparison: Comparison) -> str:
    """What a notebook shows: the table of the terminal."""
    shown = columns(comparison)
    titles = [column.title + (f" ({column.unit})" if column.unit else "") for column in shown]
    rows = [(row.label, verdict(row), *(c.text(row) for c in shown)) for row in comparison.rows]
    table = html_table(("method", "solved", *titles), rows, comparison.problem.name)
    return f"{table}<p><small>{escape(_explained(comparison))}</small></p>"


def _worst(comparison: Comparison) -> list[str]:
    """The machine with the largest error of each plan, and the command that replays it alone."""
    lines = [
        f"- {markdown_code(row.label)}: E {number(float(row.replay.index_E_deg.max()))} deg"
        f" on machine {row.worst}: `{clean(str(worst_command(comparison, row)))}`"
        for row in comparison.rows
        if row.replay is not None and row.worst is not None
    ]
    if not lines or command(comparison) is None:
        return []
    return ["Worst machine of each plan:", "", *lines, ""]


def comparison_csv(comparison: Comparison) -> str:
    """One line a method, full precision, empty where a number is not defined."""
    rows = [_flat(row) for row in comparison.rows]
    return tables.csv_text([list(rows[0]), *(list(row.values()) for row in rows)])


def _flat(row: Row) -> dict[str, Any]:
    data = row.to_dict()
    data["peak_u1_rad_s"], data["peak_u2_rad_s"] = data.pop("peak_u_rad_s")
    for name in ("E_median", "E_p95"):
        low, high = data.pop(f"{name}_interval_deg")
        data |= {f"{name}_low_deg": low, f"{name}_high_deg": high}
    del data["replay"]
    return data


def _titled(column: Column) -> str:
    return tables.markdown(column.title + (f" ({column.unit})" if column.unit else ""))


def _explained(comparison: Comparison) -> str:
    return (
        "effort: integral of u1^2 + u2^2 dt; ideal error: largest joint error at the goal by exact"
        " kinematics; E: largest joint error on the machine at any time (eq. 29), median and 95th"
        f" percentile over {comparison.samples} machines ({comparison.machine.preset}), seed"
        f" {comparison.seed}, the same machines for every plan; refused plans that can be executed"
        " are replayed for study."
        + (CLOSED if any(row.feedback for row in comparison.rows) else "")
        + "".join(f" {row.label}: {row.note}." for row in comparison.rows if row.note)
    )
