"""The figures that compare designs: their table, their values over tasks, and the recommendation.

Typical figures are medians over the tasks, in which an unsolved task counts as the worst. Loads on
the hardware are maxima over the tasks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from planner.errors import InputError
from planner.problem.feasibility import TravelWindow
from planner.support.arrays import Frozen
from planner.support.tables import number
from planner.support.user_tables import allowed_hint
from planner.sweep.case import CONTACT_PERCENTILE
from planner.sweep.design.geometry import Design

Outcome = Mapping[str, Any]
"""The results of one task on one design, by name; see `outcome`."""


@dataclass(frozen=True)
class DesignFigure:
    """A criterion that compares designs, with one number for each design.

    Attributes:
        key: Name in files and in `front`.
        title: Name in tables.
        unit: Unit of the number, or "".
        sign: −1 if smaller is better, 1 if larger is better.
        share: Whether designs are compared by differences (shares, margins) instead of ratios.
        column: Name in an `Outcome`; empty if this name equals the key.
        reduction: How values of tasks are combined; "part" is the share of tasks that are true.
    """

    key: str
    title: str
    unit: str = ""
    sign: int = -1
    share: bool = False
    column: str = ""
    reduction: Literal["median", "largest", "part"] = "median"

    def value(self, outcomes: Sequence[Outcome]) -> float:
        """Return the figure of one design from its outcomes on all tasks; NaN if undefined."""
        values = np.array([outcome.get(self.column or self.key) for outcome in outcomes], float)
        if self.reduction == "part":
            return float(np.mean(values))
        if self.reduction == "largest":
            return float(np.fmax.reduce(values))
        middle = float(np.median(np.where(np.isnan(values), -self.sign * np.inf, values)))
        return middle if np.isfinite(middle) else np.nan

    def merit(self, row: DesignRow) -> float:
        """Return the figure of one design, with the sign changed if smaller is better."""
        return row[self.key] * self.sign


CONTACT_LOAD = "contact_load"

DESIGN_FIGURES = (
    DesignFigure("effort", "effort", "rad^2/s"),
    DesignFigure("duration_s", "duration", "s"),
    DesignFigure("one_way", "one-way", "", 1, share=True, reduction="part"),
    DesignFigure("window", "window", "", 1, share=True),
    DesignFigure("margin", "chart margin", "", 1, share=True, column="domain_margin"),
    DesignFigure("peak_u1_rad_s", "peak |u1|", "rad/s", reduction="largest"),
    DesignFigure("peak_u2_rad_s", "peak |u2|", "rad/s", reduction="largest"),
    DesignFigure("contact_torque_nm", "torque", "N m", reduction="largest"),
    DesignFigure(CONTACT_LOAD, "contacts", reduction="largest"),
    DesignFigure("motor_torque_nm", "motor torque", "N m", reduction="largest"),
    DesignFigure("motor_power_w", "motor power", "W", reduction="largest"),
    DesignFigure("E_deg", "E", "deg", column="E_median_deg"),
    DesignFigure("end_deg", "error at the end", "deg", column="end_p95_deg"),
    DesignFigure("spread_deg", "spread", "deg", column="end_spread_deg"),
    DesignFigure(
        "compensated_end_deg",
        "error at the end, compensated",
        "deg",
        column="compensated_end_p95_deg",
    ),
    DesignFigure(
        "compensated_spread_deg", "spread, compensated", "deg", column="compensated_end_spread_deg"
    ),
)
"""Figures of a design study; `figures_of` adds the solved tasks and the least link."""


def figures_of(methods: Sequence[str], compensated: bool) -> tuple[DesignFigure, ...]:
    """Return the figures of a study; `methods` are the methods' names as written in its file."""
    figures = [f for f in DESIGN_FIGURES if compensated or not f.key.startswith("compensated_")]
    solved = [
        DesignFigure(f"solved {method}", f"solved, {method}", "", 1, share=True, reduction="part")
        for method in methods
    ]
    return (*figures, *solved, DesignFigure("least_link", "least link"))


def outcome(
    design: Design, window: TravelWindow | None, cases: Mapping[str, Mapping[str, Any]]
) -> Outcome:
    """Return the results of one task on one design.

    Args:
        design: The design.
        window: Travels of the task's one-way motions; None if unknown.
        cases: The results of each method (`planner.sweep.case.RESULTS`). The first method gives
            the figures, the last method the figures that begin with "compensated_".

    Returns:
        Results of the solved cases, and `one_way`, `window`, `least_link`, "solved METHOD".
    """
    out: dict[str, Any] = {f"solved {method}": case["solved"] for method, case in cases.items()}
    results = [*cases.values()]
    for before, case in (("", results[0]), ("compensated_", results[-1])):
        if case["solved"]:
            out |= {f"{before}{name}": value for name, value in case.items()}
    if window is not None:
        out |= {"one_way": not window.empty, "window": _width(window)}
    return out | {"least_link": design.least_link}


def _width(window: TravelWindow) -> float:
    """Return the width of a travel window divided by the travel at its middle.

    The quotient is 0 for an empty window, and 2 for one without an upper end (two joints).
    """
    if window.empty:
        return 0.0
    if not np.isfinite(window.high - window.low):
        return 2.0
    return (window.high - window.low) / abs(window.high + window.low) * 2


@dataclass(frozen=True, eq=False)
class DesignRow(Frozen):
    """One design and its figures.

    Attributes:
        design: The mechanism.
        figures: Values of the figures by key; empty if the design cannot be built, NaN if a figure
            is undefined.
        on_front: Whether the design is on the Pareto front of the figures to trade off.
        why: The most frequent reason for a refusal; or "".
    """

    design: Design
    figures: Mapping[str, float]
    on_front: bool = False
    why: str = ""

    def __repr__(self) -> str:
        if self.design.refused:
            return f"DesignRow({self.design.name}: {self.design.refused})"
        values = ", ".join(f"{key} {number(v)}" for key, v in list(self.figures.items())[:3])
        return f"DesignRow({self.design.name}: {values}{', on the front' * self.on_front})"

    def __getitem__(self, key: str) -> float:
        if key not in self.figures:
            raise InputError(f"no figure '{key}'; {allowed_hint(key, [*self.figures])}")
        return self.figures[key]

    @property
    def holds(self) -> bool:
        """Whether no contact slips, on `CONTACT_PERCENTILE` % of the machines."""
        return not self.figures[CONTACT_LOAD] > 1


def recommend(
    rows: Sequence[DesignRow], front_by: Sequence[DesignFigure], method: str, tasks: int
) -> tuple[tuple[DesignRow, ...], DesignRow | None, str]:
    """Mark the Pareto front, choose a design, and give the reason in sentences.

    Candidates can be built, solve as many tasks as any design, and have a value of every figure to
    trade off. If some of them have contacts that do not slip, only those remain candidates. A
    candidate is on the front if no other is as good in every figure and better in one.

    The chosen design is on the front, and has the smallest sum of relative losses, each against the
    best value of a figure. One percent of one figure counts as much as one percent of another, so
    the worst designs have no influence, and figures that hardly differ count little.

    Args:
        rows: The designs.
        front_by: The figures to trade off.
        method: The method, as written, whose plans count as solving the tasks.
        tasks: Number of tasks.

    Returns:
        The rows with `on_front` set, the chosen row or None, and the reason.
    """
    solved = np.array([row.figures.get(f"solved {method}", 0.0) for row in rows])
    values = [[row.figures.get(figure.key, np.nan) for figure in front_by] for row in rows]
    cost = np.array(values) * [-figure.sign for figure in front_by]
    able = (solved > 0) & ~np.isnan(cost).any(axis=1)
    able &= solved == np.max(solved, where=able, initial=0.0)
    holding = able & [bool(row.figures) and row.holds for row in rows]
    able = holding if holding.any() else able
    if not able.any():
        return tuple(rows), None, _refusal(rows, front_by, method)
    best = cost[able].min(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(cost == best, 0.0, np.abs(np.log(cost / best)))
    losses = np.where([figure.share for figure in front_by], cost - best, ratio).sum(axis=1)
    beaten = [((cost[able] <= c).all(axis=1) & (cost[able] < c).any(axis=1)).any() for c in cost]
    front = able & ~np.array(beaten)
    marked = tuple(replace(row, on_front=bool(k)) for row, k in zip(rows, front, strict=True))
    choice = marked[int(np.argmin(np.where(able, losses, np.inf)))]
    candidates = [row for row, possible in zip(marked, able, strict=True) if possible]
    return marked, choice, _reason(marked, candidates, choice, front_by, method, tasks)


def _refusal(rows: Sequence[DesignRow], front_by: Sequence[DesignFigure], method: str) -> str:
    whys = Counter(row.why for row in rows if row.why).most_common(1)
    most = f": {whys[0][0]}" if whys else ""
    if not any(row.figures.get(f"solved {method}", 0.0) > 0 for row in rows):
        return f"No design solves a task by {method}{most}."
    half = f"which need half of the tasks solved by {method}"
    return f"No design has values of {_join_titles(front_by)}, {half}{most}."


def _reason(
    rows: Sequence[DesignRow],
    candidates: Sequence[DesignRow],
    choice: DesignRow,
    front_by: Sequence[DesignFigure],
    method: str,
    tasks: int,
) -> str:
    built = [row for row in rows if row.figures]
    solved = f"{choice[f'solved {method}'] * tasks:.0f} of {tasks} tasks by {method}"
    count = f"as {len(candidates)} of {len(built)} designs do"
    sentences = [
        f"Take {choice.design.name}. It solves {solved}, {count} whose contacts do not slip."
        if choice.holds
        else f"Take {choice.design.name}, with larger contact forces. It solves {solved}, {count};"
        " all load their contacts beyond capacity.",
        f"Of these, {_why(front_by)}: {_values(choice, front_by)}.",
        f"Its contacts are loaded to {number(choice[CONTACT_LOAD])} of their capacity on"
        f" {CONTACT_PERCENTILE} % of the machines.",
    ]
    present = next((row for row in built if not row.design.values), choice)
    if present is not choice:
        sentences.append(f"The mechanism as it is: {_values(present, front_by)}.")
    for figure in front_by:
        others = [r for r in built if r not in candidates and not np.isnan(r[figure.key])]
        better = max(others, key=figure.merit, default=choice)
        if figure.merit(better) > figure.merit(choice):
            slips = f"its contacts would slip (loaded to {number(better[CONTACT_LOAD])})"
            why = "it solves fewer tasks" if better.holds else slips
            sentences.append(f"{better.design.name} has {_values(better, [figure])}, but {why}.")
    if choice["one_way"] < 1:
        sentences.append(
            f"For {tasks - choice['one_way'] * tasks:.0f} of the {tasks} tasks no one-way motion"
            " exists with this design, so methods whose disk never reverses cannot solve them."
        )
    return " ".join(sentences)


def _values(row: DesignRow, figures: Sequence[DesignFigure]) -> str:
    return ", ".join(f"{f.title} {number(row[f.key])} {f.unit}".rstrip() for f in figures)


def _why(figures: Sequence[DesignFigure]) -> str:
    """Return the reason for the recommendation, as the end of a sentence about a design."""
    titles = _join_titles(figures)
    if len(figures) > 1:
        return f"this design is nearest to the best {titles} (fewest percent worse, added up)"
    return f"this design has the best {titles}"


def _join_titles(figures: Sequence[DesignFigure]) -> str:
    *others, last = (figure.title for figure in figures)
    return f"{', '.join(others)} and {last}" if others else last
