"""What a comparison holds: one row a method, and the ways to look at it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.jsonable import jsonable
from planner.lazy import handed_to
from planner.machine import Machine
from planner.plan import Plan
from planner.problem import Problem
from planner.replay import Replay
from planner.significance import Difference, differences

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

FEEDBACK = " + feedback"
"""Ends the label of a row with feedback."""

FORMAT = "planner-comparison"
VERSION = 1


@dataclass(frozen=True)
class Row:
    """What became of one method. Numbers are NaN where they are not defined.

    Attributes:
        label: The spec it came from.
        method: Name of the method.
        solved: Whether it gave a verified plan.
        why: Why not, in one line; when solved empty, or what ended the search early.
        plan: The plan; a refused one is kept when it is complete, for study; else None.
        travel_rad: q₁(T) − q₁(0), rad (metres for vehicles).
        duration_s: Duration, s.
        effort: ∫ u₁² + u₂² dt.
        peak_u: Largest |u₁| and |u₂|, shape (2,), in the inputs' units (rad/s).
        domain_margin: Least margin of the chart's domain; negative outside.
        domain_ok: Whether the path stays inside; None without a path.
        terminal_error_deg: Largest error of an angle at the goal by ideal kinematics (`verify`).
        E_median_deg: Median over machines of the paper's index of error E, eq. (29).
        E_p95_deg: Its 95th percentile.
        E_median_interval_deg: 95 % confidence interval of the median; see `significance`.
        E_p95_interval_deg: That of the 95th percentile; NaN where there are too few machines.
        solve_time_s: Seconds the method spent solving, as it reports.
        build_time_s: Seconds it spent preparing.
        replay: The runs on the machines; None for what cannot be executed.
        feedback: Whether they were run with feedback; `effort` is then the median of what was
            commanded, `peak_u` the largest speeds of the motors on any machine.
        note: Why feedback gains little, where it does; else empty.
    """

    label: str
    method: str
    solved: bool
    why: str
    plan: Plan | None = None
    travel_rad: float = np.nan
    duration_s: float = np.nan
    effort: float = np.nan
    peak_u: tuple[float, float] = (np.nan, np.nan)
    domain_margin: float = np.nan
    domain_ok: bool | None = None
    terminal_error_deg: float = np.nan
    E_median_deg: float = np.nan
    E_p95_deg: float = np.nan
    E_median_interval_deg: tuple[float, float] = (np.nan, np.nan)
    E_p95_interval_deg: tuple[float, float] = (np.nan, np.nan)
    solve_time_s: float = np.nan
    build_time_s: float = np.nan
    replay: Replay | None = None
    feedback: bool = False
    note: str = ""

    def __repr__(self) -> str:
        state = "solved" if self.solved else f"refused, {self.why}"
        error = f", E {self.E_median_deg:.3g} deg" if np.isfinite(self.E_median_deg) else ""
        return f"Row({self.label}: {state}{error})"

    @property
    def spec(self) -> str:
        """The method and its options: the label without what it says about feedback."""
        return self.label.removesuffix(FEEDBACK)

    @property
    def worst(self) -> int | None:
        """Number of the machine with the largest E."""
        return self.replay.worst if self.replay is not None and self.replay.angles else None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready facts, without the curves; None where a number is not defined."""
        skipped = {"plan", "replay"}
        data = {key: value for key, value in vars(self).items() if key not in skipped}
        data["peak_u_rad_s"] = data.pop("peak_u")
        data["status"] = None if self.plan is None else self.plan.status
        data["replay"] = None if self.replay is None else self.replay.summary()
        data["worst"] = self.worst
        return dict(jsonable(data))


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
        from planner.report.provenance import command, versions

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
        from planner.report.provenance import worst_command

        return {**row.to_dict(), "worst_command": worst_command(self, row)}

    def table(self) -> Table:
        """For a terminal, at most 100 columns wide: `rich.print(comparison.table())`."""
        from planner.report.table import rich_table

        return rich_table(self)

    def _repr_html_(self) -> str:
        """The table, as a notebook shows it."""
        from planner.report.table import html

        return html(self)

    def markdown(self) -> str:
        """The table as Markdown text."""
        from planner.report.table import markdown

        return markdown(self)

    def figures(self) -> dict[str, Figure]:
        """Figures by name: z, joints, inputs, arm, errors, effort, replay; those that apply."""
        made: dict[str, Figure] = handed_to("planner.report.figures.figures")(self)
        return made

    def save(self, folder: str | Path, *, report: bool = False) -> Path:
        """Write table, figures, plans and data to a folder, all or nothing.

        Args:
            folder: An earlier run's is replaced.
            report: Whether to add report.html, a page that opens from disk.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        saved: Path = handed_to("planner.report.folder.save")(self, folder, report=report)
        return saved
