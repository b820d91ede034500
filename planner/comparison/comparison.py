"""The result of a comparison, its tables and texts, and the command that repeats it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from planner.comparison.headline import By, compare_pairs, headline, recommend, what_decides
from planner.comparison.rows import FEEDBACK_NOTE, Row, column_names, columns, intervals, verdict
from planner.errors import InputError, UnknownRowError
from planner.machine.feedforward.legs import compensable
from planner.machine.machine import Machine, load_machine
from planner.machine.replay import ERROR_WORDS, PERCENTILE_WORDS
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.settings import changed_settings, set_words
from planner.support.arrays import Frozen, jsonable
from planner.support.package import Figure, Table, import_function, provenance, versions
from planner.support.statistics import LEAST_DIFFERENCE_DEG, Difference
from planner.support.tables import (
    Column,
    CommandLine,
    clean_text,
    csv_table,
    html_table,
    markdown,
    markdown_code,
    markdown_table,
    number,
    terminal_table,
)

FORMAT = "planner-comparison"
VERSION = 1


@dataclass(frozen=True, eq=False)
class Comparison(Frozen):
    """Result of `compare`: one row per method.

    Attributes:
        problem: The problem that all methods solve.
        rows: One row per method, and one more per method with feedback, in the requested order.
        machine: The distribution of machines on which every plan was replayed.
        samples: Number of random machines drawn from that distribution.
        seed: Random seed.
        chosen: Sample numbers of the machines; None for the first `samples`.
        complete: Whether all rows are finished; False after Ctrl-C.
        threshold_deg: Differences of E below this count as neither better nor worse, degrees.
        by: What the recommended plan is chosen by.
    """

    problem: Problem
    rows: tuple[Row, ...]
    machine: Machine
    samples: int
    seed: int
    chosen: tuple[int, ...] | None = None
    complete: bool = True
    threshold_deg: float = LEAST_DIFFERENCE_DEG
    by: By = "way"

    def __repr__(self) -> str:
        rows = "".join(f"\n  {row!r}" for row in self.rows)
        partial = "" if self.complete else ", interrupted"
        machines = f"{self.samples} machine{'s' if self.samples > 1 else ''}, seed {self.seed}"
        return f"Comparison({self.problem.name!r}, {machines}{partial}:{rows})"

    def __getitem__(self, label: str) -> Row:
        for row in self.rows:
            if row.label == label:
                return row
        known = ", ".join(row.label for row in self.rows)
        raise UnknownRowError(f"no row '{label}'; there are: {known}")

    @property
    def plans(self) -> Mapping[str, Plan | None]:
        """The plans by label, without the rows with feedback."""
        return {row.label: row.plan for row in self.rows if not row.feedback}

    @property
    def columns(self) -> list[Column[Row]]:
        """Columns of the table: label, verdict, then the numbers."""
        return columns(self.problem.system)

    @cached_property
    def differences(self) -> tuple[Difference, ...]:
        """Differences of E for every pair of replayed plans, with the result of the paired test."""
        return compare_pairs(self.rows, "E", self.threshold_deg)

    @cached_property
    def end_differences(self) -> tuple[Difference, ...]:
        """Differences of the largest joint error at the end, for every pair of replayed plans."""
        return compare_pairs(self.rows, "end", self.threshold_deg)

    @cached_property
    def headline(self) -> str:
        """Up to three lines: the plan to take and what it gains; its price; what to beware of."""
        return "\n".join(self.headline_lines)

    @property
    def headline_lines(self) -> list[str]:
        """The lines of the headline."""
        start, label, (first, *others) = self.headline_parts
        return [start + label + first, *others]

    @cached_property
    def headline_parts(self) -> tuple[str, str, tuple[str, ...]]:
        """The headline before the first mention of the recommended plan's label, that label, and
        the lines after it."""
        start, label, rest = headline(self.rows, self.threshold_deg, self.machine, self.by)
        partial = "" if self.complete else "Interrupted: only the finished rows count. "
        worth = self.machine.worth
        known = "" if worth is None else f"The machine was identified: {worth.words}. "
        return partial + known + start, label, rest

    @cached_property
    def recommended(self) -> Row | None:
        """The row of the plan to take without feedback; None if no method has a verified plan."""
        return recommend(self.rows, self.threshold_deg, self.by)

    @property
    def advice(self) -> Mapping[str, str]:
        """Changes that may help, in words, by row label; empty if any method has a plan."""
        if any(row.solved for row in self.rows):
            return {}
        return {row.label: row.advice for row in self.rows if row.advice and not row.feedback}

    @property
    def best(self) -> Row | None:
        """The row with the smallest median E, verified plans first; None without a replay."""
        ranked = [row for row in self.rows if np.isfinite(row.E_median_deg)]
        return min(ranked, key=lambda r: (not r.solved, r.E_median_deg, r.label), default=None)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data: rows, problem, machine, seed, versions, command to repeat it."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "source": self.problem.source,
            "command": command(self),
            "samples": self.samples,
            "seed": self.seed,
            "chosen": self.chosen,
            "threshold_deg": self.threshold_deg,
            "by": self.by,
            "complete": self.complete,
            "rows": [
                {**row.to_dict(self.problem.system), "worst_command": worst_command(self, row)}
                for row in self.rows
            ],
            "headline": self.headline,
            "differences": [
                {**_facts(d), "end": _facts(end)}
                for d, end in zip(self.differences, self.end_differences, strict=True)
            ],
            "problem": self.problem.to_dict(),
            "machine": self.machine.to_dict(),
            "machine_file": self.machine.source,
            "versions": versions(),
        }
        return dict(jsonable(data))

    def table(self) -> Table:
        """Return a table at most 80 characters wide, for `rich.print(comparison.table())`.

        Files have more columns. Remarks about plans are below the table.
        """
        names = column_names(self.problem.system)
        hidden = {names[name] for name in NOT_IN_TERMINALS}
        tries = {label: f" Try: {advice}" for label, advice in self.advice.items()}
        told = [f"{r.label}: {r.remark}.{tries.get(r.label, '')}" for r in self.rows if r.remark]
        shown = columns(self.problem.system, lambda row: "yes" if row.solved else "no")
        return terminal_table(
            [c for c in shown if c.name not in hidden],
            self.in_order,
            caption="\n".join([*told, _caption(self, terminal=True)]),
            ruled=True,
            style=lambda row: "bold" * (row is self.recommended) if row.solved else "dim",
        )

    def _repr_html_(self) -> str:
        """Return the comparison's table as HTML for a notebook."""
        tries = {label: f"\nTry: {advice}" for label, advice in self.advice.items()}
        shown = columns(self.problem.system, lambda row: verdict(row) + tries.get(row.label, ""))
        table = html_table(shown, self.in_order, self.problem.name)
        return f"{table}<p><small>{escape(_caption(self))}</small></p>"

    @property
    def in_order(self) -> list[Row]:
        """The rows, that of the recommended plan first."""
        return sorted(self.rows, key=lambda row: row is not self.recommended)

    def markdown(self) -> str:
        """Return the comparison as Markdown: headline, table, and the command that repeats it."""
        again = "Made from Python; `comparison.json` holds the problem, the machine and the seed."
        if repeat := command(self):
            again = provenance(clean_text(repeat))
        heading = f"# Comparison: {markdown(self.problem.name)}\n"
        if not self.complete:
            heading += "\n**Partial: interrupted before all methods were finished.**\n"
        heading += "".join(f"\n{clean_text(line)}\n" for line in self.headline_lines)
        tries = [f"- Try, for {markdown_code(k)}: {clean_text(v)}" for k, v in self.advice.items()]
        advice = [*tries, ""] if tries else []
        table = markdown_table([*self.columns, *intervals(self.problem.system)], self.in_order)
        after = ["", *advice, _caption(self), "", *_worst_machines(self), again, ""]
        return "\n".join([heading, table, *after])

    def figures(self) -> dict[str, Figure]:
        """Return the figures by name: those of plans (`PLAN_FIGURES`), "arm", `REPLAY_FIGURES`."""
        return dict(import_function("planner.report.folders.figures")(self))

    def plot(self, figure: str = "errors") -> Figure:
        """Draw one of `figures`, by name.

        Raises:
            InputError: If the name is unknown, or no plan has the data for it.
        """
        picture: Figure = import_function("planner.report.folders.draw")(self, figure)
        return picture

    def save(self, folder: str | Path, *, report: bool = False) -> Path:
        """Save table, figures, plans and data in a folder, all or nothing.

        Args:
            folder: The folder; a folder of an earlier run is replaced.
            report: Whether to add report.html, a page that opens without a network.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        return Path(import_function("planner.report.folders.save")(self, folder, report=report))


def _facts(d: Difference) -> dict[str, Any]:
    return {**asdict(d), "significant": d.significant, "matters": d.matters}


def command(
    comparison: Comparison, out: str | None = None, *, report: bool = False
) -> CommandLine | None:
    """Return the command line that repeats a comparison.

    Where the problem or the machine differs from its file, the command has a `--set` option.

    Args:
        comparison: The comparison to repeat.
        out: The folder for `--out`.
        report: Whether to write the page in that folder.

    Returns:
        The command, or None if no command gives this comparison (the problem's file is missing, or
        has a key that `--set` cannot remove, or the threshold is not the usual one).
    """
    settings = _settings(comparison)
    if settings is None or comparison.threshold_deg != LEAST_DIFFERENCE_DEG:
        return None
    words = ["planner", "compare", comparison.problem.source]
    words += ["--methods", ",".join({row.spec.text: row.label for row in comparison.rows}.values())]
    for sample in comparison.chosen or ():
        words += ["--sample", str(sample)]
    if comparison.chosen is None:
        words += ["--samples", str(comparison.samples)]
    words += ["--seed", str(comparison.seed), *["--by", comparison.by] * (comparison.by != "way")]
    if file := comparison.machine.source:
        words += ["--machine", file]
    words += set_words(settings)
    if out is not None:
        words += ["--out", out, *["--report"] * report]
    return CommandLine.of(*words)


def worst_command(comparison: Comparison, row: Row) -> CommandLine | None:
    """Return the command line that replays a row's plan on its worst machine alone.

    Return None if the row has no replay with angles, or no command gives the problem.
    """
    if row.worst is None:
        return None
    return command(replace(comparison, rows=(row,), chosen=(row.worst,)))


def _settings(comparison: Comparison) -> dict[str, Any] | None:
    problem, machine = comparison.problem, comparison.machine
    try:
        changes = machine.source and {"machine": load_machine(machine.source).to_dict()}
    except InputError:
        return None
    settings = changed_settings(problem, changes or None)
    if settings is None:
        return None
    usual = Machine.from_table(problem.machine).to_dict()
    return settings | {f"machine.{k}": v for k, v in machine.to_dict().items() if v != usual.get(k)}


def _worst_machines(comparison: Comparison) -> list[str]:
    """Return Markdown lines with each plan's worst machine and the command that replays it."""
    lines = [
        f"- {markdown_code(row.label)}: E {number(float(row.replay.index_E_deg.max()))} deg"
        f" on machine {row.worst}: `{clean_text(str(worst_command(comparison, row)))}`"
        for row in comparison.rows
        if row.replay is not None and row.worst is not None
    ]
    if not lines or command(comparison) is None:
        return []
    return ["Worst machine of each plan:", "", *lines, ""]


PEAKS = ("peak_u1", "peak_u2")
"""Names, without units, of the columns that are last in CSV, as in earlier files."""


def comparison_csv(comparison: Comparison) -> str:
    """Return a comparison as CSV: one line per row, full precision, empty where undefined."""
    names = column_names(comparison.problem.system)
    last = {names[peak] for peak in PEAKS}
    columns = sorted(comparison.columns, key=lambda c: c.name in last)
    return csv_table([*columns, *intervals(comparison.problem.system)], comparison.rows)


def _caption(comparison: Comparison, *, terminal: bool = False) -> str:
    machines = comparison.machine.origin
    if compensable(comparison.problem.system):
        machines += f", {comparison.machine.start_words}"
    over = f"{PERCENTILE_WORDS} over {comparison.samples} machines ({machines})"
    if comparison.samples == 1:
        over = f"one machine ({machines}) has no percentiles, so both columns show its error"
    took = "" if terminal else " took: planning and verification;"
    return (
        "time: whole duration, with preparation and holds; effort: integral of u1^2 + u2^2 dt;"
        f" {ERROR_WORDS}; {over}, seed {comparison.seed}, the same machines for every"
        f" plan;{took} refused plans that can be executed are replayed for study."
        + (FEEDBACK_NOTE if any(row.feedback for row in comparison.rows) else "")
        + "".join(f" {row.label}: {row.note}." for row in comparison.rows if row.note)
        + _longer_words(comparison)
        + what_decides(comparison.rows, comparison.threshold_deg)
        + "".join(
            f" {row.label}: {words}."
            for row in comparison.rows
            if row.replay is not None
            for words in (row.replay.slip_words, row.replay.limit_words)
            if words
        )
    )


NOT_IN_TERMINALS = ("travel", "path_length", "took_s")
"""Names, without units, of the columns that a table for terminals (80 characters) leaves out."""

TINY_S = 1e-6
"""Difference of durations below which plans count as equally long, in seconds."""


def _longer_words(comparison: Comparison) -> str:
    """Return a sentence, with a leading space, on plans longer than `goal.duration`; else ""."""
    duration = comparison.problem.duration
    longer = [
        f"{row.label} by {number(row.duration_s - duration)} s"
        for row in comparison.rows
        if duration is not None and row.duration_s > duration + TINY_S
    ]
    return f" Longer than goal.duration: {', '.join(longer)}." if longer else ""
