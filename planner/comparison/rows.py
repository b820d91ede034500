"""The rows and columns of a comparison."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np

from planner.machine.replay import Replay
from planner.plan.measures import effort, peak_inputs
from planner.plan.plan import Plan
from planner.support.arrays import jsonable
from planner.support.tables import Column, digits
from planner.systems.triangular_system import TriangularSystem
from planner.verification.verify import Check

FEEDBACK = " + feedback"
"""Ends the label of a row with feedback."""

OTHER_WAY_DEG = 2.0
"""A nominal machine that is further from its plan than machines differ has taken another way."""


@dataclass(frozen=True)
class Row:
    """Result of one method. Undefined numbers are NaN.

    Attributes:
        label: The method with its options, as given.
        method: Name of the method.
        solved: Whether the method gave a verified plan.
        why: Reason of the refusal, in one line; if solved, empty or what ended the search early.
        plan: The plan; a refused plan is kept for study if it is complete; else None.
        travel_rad: q₁(T) − q₁(0), rad (metres for vehicles).
        duration_s: Duration, s.
        effort: ∫ u₁² + u₂² dt.
        peak_u: Largest |u₁| and |u₂|, shape (2,), in the inputs' units (rad/s).
        domain_margin: Least margin of the chart's domain; negative outside.
        domain_ok: Whether the path stays inside; None without a path.
        terminal_error_deg: Largest error of an angle at the goal by ideal kinematics (`verify`).
        E_median_deg: Median over machines of the paper's index of error E, eq. (29).
        E_p95_deg: Its 95th percentile.
        end_median_deg: Median over machines of the largest error of an angle at the end.
        end_p95_deg: Its 95th percentile.
        E_median_interval_deg: 95 % confidence interval of the median; see `significance`.
        E_p95_interval_deg: That of the 95th percentile; NaN where there are too few machines.
        took_s: Seconds for planning, verification and proofs; for a refusal including the changes
            that were tried.
        solve_time_s: Seconds of these that the method spent solving, as it reports.
        build_time_s: Seconds spent on building the optimisation problem.
        replay: The replays on the machines; None for a plan that cannot be executed.
        feedback: Whether they were run with feedback; `effort` is then the median of what was
            commanded, `peak_u` the largest speeds of the motors on any machine.
        note: Why feedback gains little, or how far a compensated plan leaves the original path;
            else empty.
        advice: For a refused plan, changes that would help, in words; those that were tried are
            marked.
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
    end_median_deg: float = np.nan
    end_p95_deg: float = np.nan
    E_median_interval_deg: tuple[float, float] = (np.nan, np.nan)
    E_p95_interval_deg: tuple[float, float] = (np.nan, np.nan)
    took_s: float = np.nan
    solve_time_s: float = np.nan
    build_time_s: float = np.nan
    replay: Replay | None = None
    feedback: bool = False
    note: str = ""
    advice: str = ""

    @classmethod
    def of(cls, label: str, method: str, plan: Plan, check: Check, why: str = "") -> Row:
        """What is known of a plan before it is replayed.

        Args:
            label: The method with its options.
            method: Name of the method.
            plan: The plan.
            check: Its verification.
            why: Reason of the refusal, or what ended the search early.
        """
        errors = np.abs(check.terminal_error_deg)
        row = cls(
            label,
            method,
            plan.verified,
            why,
            plan,
            travel_rad=plan.travel,
            duration_s=plan.duration,
            domain_margin=plan.domain.margin,
            domain_ok=plan.domain.ok,
            terminal_error_deg=float(np.max(errors)) if errors.size else np.nan,
            solve_time_s=plan.solve_time_s,
            build_time_s=plan.build_time_s,
        )
        if not plan.executable:
            return row
        first, second = peak_inputs(plan.trajectory).tolist()
        away = np.rad2deg(plan.notes["compensation"]["path_rad"]) if plan.compensates else 0.0
        other = f"takes another path, up to {away:.3g} deg from the original plan"
        return replace(
            row,
            effort=effort(plan.trajectory),
            peak_u=(first, second),
            note=other if away > OTHER_WAY_DEG else "",
        )

    def __repr__(self) -> str:
        state = "solved" if self.solved else f"refused, {self.why}"
        error = f", E {self.E_median_deg:.3g} deg" if np.isfinite(self.E_median_deg) else ""
        return f"Row({self.label}: {state}{error})"

    @property
    def spec(self) -> str:
        """The method and its options: the label without what it says about feedback."""
        return self.label.removesuffix(FEEDBACK)

    @property
    def remark(self) -> str:
        """Why the plan is refused; for a verified plan a remark, if there is one."""
        leaves = "leaves the chart (allowed)" if self.solved and self.domain_ok is False else ""
        return "; ".join(filter(None, [self.why, leaves]))

    @property
    def status(self) -> str | None:
        """Status of the plan."""
        return None if self.plan is None else self.plan.status

    @property
    def worst(self) -> int | None:
        """Number of the machine with the largest E."""
        return self.replay.worst if self.replay is not None and self.replay.angles else None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready facts, without the curves; None where a number is not defined."""
        skipped = {"plan", "replay"}
        data = {key: value for key, value in vars(self).items() if key not in skipped}
        data["peak_u_rad_s"] = data.pop("peak_u")
        data["status"] = self.status
        data["replay"] = None if self.replay is None else self.replay.summary()
        data["worst"] = self.worst
        return dict(jsonable(data))


CLOSED = (
    " Rows with feedback: the same plan with feedback by the tracker; effort is the median"
    " effort of its commands, |u1| and |u2| are the largest motor speeds on any machine."
)


def verdict(row: Row) -> str:
    """The verdict in words: solved, or why not."""
    word = "yes" if row.solved else "no"
    return f"{word}: {row.remark}" if row.remark or not row.solved else word


def effort_unit(system: TriangularSystem) -> str:
    """Unit of ∫ u₁² + u₂² dt: that of an input's square times seconds, or both where they differ.

    >>> from planner.systems.manipulator import Manipulator
    >>> effort_unit(Manipulator([1.0]))
    'rad²/s'
    """
    rates = [c.unit for c in system.inputs]
    squares = [f"{r[:-2]}²/s" if r.endswith("/s") else f"{r}² s" if r else "s" for r in rates]
    return " + ".join(dict.fromkeys(squares))


def columns(system: TriangularSystem) -> list[Column[Row]]:
    """A row's label and verdict, and its numbers in the order in which they are read."""
    length, (first, second) = system.coordinates[0].unit, system.inputs
    return [
        Column("method", "", lambda r: r.label, key="label", left=True, width=20, code=True),
        Column("solved", "", verdict, key="", left=True),
        *map(_fact, ("method", "solved", "why")),
        Column("travel", length, lambda r: r.travel_rad, digits(4), key="travel_rad"),
        _fact("duration_s"),
        Column("effort", effort_unit(system), lambda r: r.effort, digits(4), key="effort"),
        Column("|u1|", first.unit, lambda r: r.peak_u[0], key="peak_u1_rad_s"),
        Column("|u2|", second.unit, lambda r: r.peak_u[1], key="peak_u2_rad_s"),
        *map(_fact, ("domain_margin", "domain_ok")),
        _fact("terminal_error_deg"),
        Column("E 50 %", "deg", lambda r: r.E_median_deg, key="E_median_deg"),
        Column("E 95 %", "deg", lambda r: r.E_p95_deg, key="E_p95_deg"),
        Column("end 50 %", "deg", lambda r: r.end_median_deg, key="end_median_deg"),
        Column("end 95 %", "deg", lambda r: r.end_p95_deg, key="end_p95_deg"),
        Column("took", "s", lambda r: r.took_s, digits(2), key="took_s"),
        *map(
            _fact, ("solve_time_s", "build_time_s", "feedback", "note", "advice", "status", "worst")
        ),
    ]


def _fact(name: str) -> Column[Row]:
    """An attribute that CSV has alone."""
    return Column(name, "", attrgetter(name), shown=None)


INTERVALS: list[Column[Row]] = [
    Column("E 50 % from", "deg", lambda r: r.E_median_interval_deg[0], key="E_median_low_deg"),
    Column("E 50 % to", "deg", lambda r: r.E_median_interval_deg[1], key="E_median_high_deg"),
    Column("E 95 % from", "deg", lambda r: r.E_p95_interval_deg[0], key="E_p95_low_deg"),
    Column("E 95 % to", "deg", lambda r: r.E_p95_interval_deg[1], key="E_p95_high_deg"),
]
"""More columns, for which only Markdown and CSV have room: 95 % confidence intervals."""
