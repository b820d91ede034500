"""The rows and columns of a comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from planner.machine.replay import STATISTICS, Replay
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.support.arrays import Array, jsonable
from planner.support.statistics import percentile_interval
from planner.support.tables import Column, digits, number
from planner.systems.triangular_system import TriangularSystem
from planner.verification.summary import (
    FigureField,
    Heading,
    PlanFigures,
    figure,
    figures,
    with_unit_keys,
)
from planner.verification.verify import Check

OTHER_WAY_DEG = 2.0
"""Distance from the original path, in degrees, above which a compensated plan gets a remark."""


def _statistic(name: str) -> Any:
    one = STATISTICS[name]
    return figure(Heading(one.title, "deg"), replay=one.of)


def _interval(name: str) -> Any:
    one = STATISTICS[f"E_{name}_deg"]
    return figure(
        Heading(f"{one.title} from", "deg", key=f"E_{name}_low_deg"),
        Heading(f"{one.title} to", "deg", key=f"E_{name}_high_deg"),
        replay=lambda run: percentile_interval(run.index_E_deg, one.percent),
        files=True,
        sweep=False,
        default=(np.nan, np.nan),
    )


KEPT_IN_FILES = {"spec", "plan", "replay", "machine_errors_deg"}
"""Fields that `Row.to_dict` leaves out; a saved folder has plans and errors in other files."""

EARLIER_NAMES = {
    "travel": "travel_rad",
    **{name: f"{name}_rad_s" for name in ("peak_u", "peak_u1", "peak_u2")},
    "terminal_error_max_deg": "terminal_error_deg",
}
"""Names of figures in files before version 1.0.0, whatever their units."""


@dataclass(frozen=True)
class Row(PlanFigures):
    """Result of one method in a comparison; undefined numbers are NaN.

    Attributes:
        spec: The method with its options, as requested.
        solved: Whether the method gave a verified plan.
        why: Reason of the refusal, in one line; for a solved row, what ended the search early, or
            empty.
        plan: The plan; a refused plan is kept for study if it is a complete motion; else None.
        E_median_deg: Median over machines of the paper's index of error E, eq. (29).
        E_p95_deg: 95th percentile of E over machines.
        end_median_deg: Median over machines of the largest error of an angle at the end.
        end_p95_deg: 95th percentile over machines of the largest error of an angle at the end.
        beyond_limits: Percent of the machines that break a limit of joints, obstacles, links or
            chained coordinates.
        beyond_physical: Percent of the machines that break one that is not of chained coordinates.
        joint_1_range_deg: Least and greatest angle of joint 1 on the machines in the whole motion,
            with the preparation of a compensated plan and of feedback, degrees.
        E_median_interval_deg: 95 % confidence interval of `E_median_deg`.
        E_p95_interval_deg: 95 % confidence interval of `E_p95_deg`; NaN if there are too few
            machines.
        took_s: Seconds for planning, verification and proofs; for a refusal including the changes
            that were tried.
        solve_time_s: Part of `took_s` spent on solving, as the method reports.
        build_time_s: Part of `took_s` spent on building the optimisation problem.
        replay: The replays on the machines; None for a plan that cannot be executed.
        machine_errors_deg: E and the largest error at the end on each machine, shape (2, S); None
            without angles. A saved folder restores these errors, but not `replay`.
        note: Why feedback gains little, or how far a compensated plan leaves the original path;
            else empty.
        ways: For a refused plan, changes that may help, in words; tried changes are marked.
        has_remedy: Whether one of the changes was tried and works.
    """

    spec: Spec
    solved: bool
    why: str
    plan: Plan | None = None
    E_median_deg: float = _statistic("E_median_deg")
    E_p95_deg: float = _statistic("E_p95_deg")
    end_median_deg: float = _statistic("end_median_deg")
    end_p95_deg: float = _statistic("end_p95_deg")
    beyond_limits: float = figure(
        Heading("beyond limits", "%"),
        replay=lambda run: 100 * run.limit_share,
        files=True,
        sweep=False,
    )
    beyond_physical: float = figure(
        Heading("beyond physical limits", "%"),
        replay=lambda run: 100 * run.physical_share,
        files=True,
        sweep=False,
    )
    joint_1_range_deg: tuple[float, float] = figure(
        Heading("joint 1 from", "deg", key="joint_1_from_deg"),
        Heading("joint 1 to", "deg", key="joint_1_to_deg"),
        replay=lambda run: run.joint_1_range_deg,
        files=True,
        sweep=False,
        default=(np.nan, np.nan),
    )
    E_median_interval_deg: tuple[float, float] = _interval("median")
    E_p95_interval_deg: tuple[float, float] = _interval("p95")
    took_s: float = figure(Heading("took", "s", 2))
    solve_time_s: float = figure(plan=lambda plan, _: plan.solve_time_s, sweep=False)
    build_time_s: float = figure(plan=lambda plan, _: plan.build_time_s, sweep=False)
    replay: Replay | None = None
    machine_errors_deg: Array | None = field(default=None, compare=False)
    note: str = ""
    ways: tuple[str, ...] = ()
    has_remedy: bool = False

    @classmethod
    def from_plan(cls, spec: Spec, plan: Plan, check: Check, why: str = "") -> Row:
        """Return the row of a plan before its replay.

        Args:
            spec: The method with its options.
            plan: The plan.
            check: Result of the plan's verification.
            why: Reason of the refusal, or what ended the search early.
        """
        values = cls.measure(plan, check)
        compensation = plan.notes.get("compensation", {}) if plan.compensates else {}
        away, plain = compensation.get("E_deg", 0.0), compensation.get("plain_E_deg", np.inf)
        if plan.executable and away > OTHER_WAY_DEG:
            more = "" if away < plain else f", no better than {plain:.3g} deg uncompensated"
            values["note"] = f"leaves the original path by up to {away:.3g} deg{more}"
        if plan.ends_on_machine:
            away = f"up to {plan.notes['from_ideal_deg']:.3g} deg off the ideal one"
            values["note"] = f"errors from the motion predicted on the machine, {away}"
        return cls(spec, plan.verified, why, plan, **values)

    def __repr__(self) -> str:
        state = "solved" if self.solved else f"refused, {self.why}"
        error = f", E {self.E_median_deg:.3g} deg" if np.isfinite(self.E_median_deg) else ""
        return f"Row({self.label}: {state}{error})"

    @property
    def advice(self) -> str:
        """The changes that may help a refused plan, in one text."""
        return "; or ".join(self.ways)

    @property
    def label(self) -> str:
        """The method with its options, and whether its plan is compensated or has feedback."""
        return self.spec.label

    @property
    def method(self) -> str:
        """Name of the method."""
        return self.spec.method

    @property
    def feedback(self) -> bool:
        """Whether the replays used feedback. If so, `effort` is the median over machines of the
        commands' effort, `peak_u` the largest motor speeds on any machine, and `path_length` the
        median length of the machines' paths."""
        return self.spec.feedback

    @property
    def remark(self) -> str:
        """Why the plan is refused; for a verified plan what the user should know, or empty."""
        words = [self.why] if self.why else []
        if self.solved and self.domain_ok is False:
            words.append("leaves the chart, as this method may")
        if self.solved and self.plan is not None and self.plan.jump_words:
            words.append(self.plan.jump_words)
        if self.solved and self.beyond_limits > 0:
            alike = self.beyond_physical == self.beyond_limits
            few = "" if alike else f", {number(self.beyond_physical)} % a physical one"
            words.append(f"{number(self.beyond_limits)} % of machines break a limit{few}")
        return "; ".join(words)

    @property
    def status(self) -> str | None:
        """Status of the row's plan; None without a plan."""
        return None if self.plan is None else self.plan.status

    @property
    def worst(self) -> int | None:
        """Number of the machine with the largest E; None without a replay or without angles."""
        return self.replay.worst if self.replay is not None and self.replay.angles else None

    def to_dict(self, system: TriangularSystem) -> dict[str, Any]:
        """Return the row as JSON-ready data without curves; undefined numbers are None.

        The system gives the units in the names.
        """
        data = {key: getattr(self, key) for key in ("label", "method", "solved", "why")}
        data["feedback"] = self.feedback
        data |= {key: value for key, value in vars(self).items() if key not in KEPT_IN_FILES}
        data = with_unit_keys(data, system)
        data |= {"status": self.status, "advice": self.advice}
        data["replay"] = None if self.replay is None else self.replay.to_dict()
        data["worst"] = self.worst
        return dict(jsonable(data))


def machine_figures(run: Replay, *, sweep: bool = False) -> dict[str, Any]:
    """Return a row's numbers from replays, by name; if `sweep`, only numbers that sweeps store."""
    known = figures(Row).items()
    return {n: f.replay(run) for n, f in known if f.replay and (f.swept or not sweep)}


FEEDBACK_NOTE = (
    " Rows with feedback: the same plan with feedback by the tracker; effort is the median"
    " effort of its commands, path that of the machines' paths, |u1| and |u2| are the largest"
    " motor speeds on any machine."
)


def verdict(row: Row) -> str:
    """Return "yes" or "no" for whether the row is solved, followed by its remark."""
    word = "yes" if row.solved else "no"
    return f"{word}: {row.remark}" if row.remark or not row.solved else word


def columns(system: TriangularSystem, solved: Callable[[Row], str] = verdict) -> list[Column[Row]]:
    """Return the columns of a comparison: label, `solved` in words, then the numbers in reading
    order."""
    return [
        Column("method", "", lambda r: r.label, key="label", left=True, width=20, code=True),
        Column("solved", "", solved, key="", left=True),
        *map(_fact, ("method", "solved", "why")),
        *_columns(system, files=False),
        *map(_fact, ("feedback", "note", "advice", "status", "worst")),
    ]


def intervals(system: TriangularSystem) -> list[Column[Row]]:
    """Return a comparison's columns that only Markdown and CSV have, 95 % intervals among them."""
    return list(_columns(system, files=True))


def _columns(system: TriangularSystem, files: bool) -> Iterator[Column[Row]]:
    """Yield the columns of the figures that only files show (`files`), or of all other figures.

    A figure without a heading has a column in CSV only.
    """
    for name, one in figures(Row).items():
        if one.files != files:
            continue
        if not one.headings:
            yield _fact(name)
        for head, value in zip(one.headings, _numbers(name, one).values(), strict=False):
            unit, key = head.unit_of(system), head.key_of(name, system)
            yield Column(head.title, unit, value, digits(head.digits), key=key)


def _numbers(name: str, one: FigureField) -> dict[str, Callable[[Row], Any]]:
    """Return how to read each number of a figure from a row, by its key without the system's
    unit."""
    keys = [head.key or name for head in one.headings] or [name]
    if len(keys) == 1:
        return {keys[0]: attrgetter(name)}
    return {key: _component(name, k) for k, key in enumerate(keys)}


def _component(name: str, k: int) -> Callable[[Row], float]:
    return lambda row: float(getattr(row, name)[k])


def _fact(name: str) -> Column[Row]:
    """Return a column, for CSV only, of an attribute of `Row`."""
    return Column(name, "", attrgetter(name), shown=None)


def column_names(system: TriangularSystem) -> dict[str, str]:
    """Return the name in CSV of every number of a figure, by its name without the system's unit."""
    known = figures(Row).items()
    return {head.key or name: head.key_of(name, system) for name, f in known for head in f.headings}


def sweep_columns() -> dict[str, Callable[[Row], Any]]:
    """Return how to read each number that sweeps save from a row, by its column's name, which lacks
    the system's unit."""
    swept = (_numbers(name, one) for name, one in figures(Row).items() if one.swept)
    return {key: value for numbers in swept for key, value in numbers.items()}
