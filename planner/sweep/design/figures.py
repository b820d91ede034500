"""The figures that compare designs, the Pareto front, and the recommendation.

Typical figures are medians over the tasks, where an unsolved task counts as worse than any; what
the hardware must stand is the largest over the tasks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.problem.feasibility import TravelWindow
from planner.support.arrays import Array
from planner.support.tables import number
from planner.support.user_tables import nearest
from planner.sweep.case import CARRIED
from planner.sweep.design.geometry import Design

Record = Mapping[str, Any]
"""A case of the sweep: see `planner.sweep.case.RESULTS`."""


@dataclass(frozen=True, eq=False)
class TaskOutcome:
    """The outcome of one task on one design.

    Attributes:
        window: Travels of one-way motions.
        records: By method as written.
    """

    window: TravelWindow
    records: Mapping[str, Record]

    def of(self, method: str, column: str) -> float | None:
        """A figure of its plan; None where it is not solved, or has no such figure."""
        record = self.records[method]
        value = record[column] if record["solved"] else None
        return None if value is None else float(value)


@dataclass(frozen=True)
class Figure:
    """One figure of a design.

    Attributes:
        key: Its name in files and in `front`.
        title: What it is, in few words.
        unit: Its unit, or "".
        better: −1 where less is better, 1 where more is.
        share: Whether differences of it are compared (parts of a whole, margins), and not ratios.
    """

    key: str
    title: str
    unit: str = ""
    better: int = -1
    share: bool = False

    def lost(self, values: Array, best: float) -> Array:
        """How much worse than the best, ≥ 0: 0.01 is one percent."""
        if self.share:
            return np.asarray((best - values) * self.better)
        with np.errstate(divide="ignore"):
            return np.asarray(np.abs(np.log(values / best)))


def _median(worst: float, method: str, column: str) -> Callable[[Sequence[TaskOutcome]], float]:
    def value(outcomes: Sequence[TaskOutcome]) -> float:
        found = [outcome.of(method, column) for outcome in outcomes]
        middle = float(np.median([worst if v is None else v for v in found]))
        return middle if np.isfinite(middle) else np.nan

    return value


def _largest(method: str, column: str) -> Callable[[Sequence[TaskOutcome]], float]:
    def value(outcomes: Sequence[TaskOutcome]) -> float:
        found = [outcome.of(method, column) for outcome in outcomes]
        return max((v for v in found if v is not None), default=np.nan)

    return value


def _width(window: TravelWindow) -> float:
    """Of a travel window over its middle: the scale of φ does not matter; 0 if empty.

    One without an upper end (two joints) has 2, to which the ratio tends.
    """
    if window.empty:
        return 0.0
    if not np.isfinite(window.high - window.low):
        return 2.0
    return (window.high - window.low) / abs(window.high + window.low) * 2


Judged = tuple[Figure, Callable[[Sequence[TaskOutcome]], float]]


def judged_by(methods: Sequence[str], compensated: str | None) -> list[Judged]:
    """Every figure and how it is taken from the outcomes of a design's tasks.

    Args:
        methods: As written; the first one's plans give the figures.
        compensated: The name of its compensated plans, or None.
    """
    first, worst = methods[0], np.inf
    out: list[Judged] = [
        (Figure("effort", "effort", "rad^2/s"), _median(worst, first, "effort")),
        (Figure("duration_s", "duration", "s"), _median(worst, first, "duration_s")),
        (
            Figure("one_way", "one-way", "", 1, share=True),
            lambda outcomes: float(np.mean([not o.window.empty for o in outcomes])),
        ),
        (
            Figure("window", "window", "", 1, share=True),
            lambda outcomes: float(np.median([_width(o.window) for o in outcomes])),
        ),
        (
            Figure("margin", "chart margin", "", 1, share=True),
            _median(-worst, first, "domain_margin"),
        ),
        (Figure("peak_u1_rad_s", "peak |u1|", "rad/s"), _largest(first, "peak_u1_rad_s")),
        (Figure("peak_u2_rad_s", "peak |u2|", "rad/s"), _largest(first, "peak_u2_rad_s")),
        (
            Figure("contact_torque_nm", "torque", "N m"),
            _largest(first, "contact_torque_nm"),
        ),
        (Figure(LOAD, "contacts"), _largest(first, LOAD)),
        (Figure("E_deg", "E", "deg"), _median(worst, first, "E_median_deg")),
        (Figure("end_deg", "error at the end", "deg"), _median(worst, first, "end_p95_deg")),
        (Figure("spread_deg", "spread", "deg"), _median(worst, first, "end_spread_deg")),
    ]
    if compensated is not None:
        out += [
            (
                Figure("compensated_end_deg", "error at the end, compensated", "deg"),
                _median(worst, compensated, "end_p95_deg"),
            ),
            (
                Figure("compensated_spread_deg", "spread, compensated", "deg"),
                _median(worst, compensated, "end_spread_deg"),
            ),
        ]
    named = [*methods, *([compensated] if compensated else [])]
    return out + [
        (Figure(f"solved {m}", f"solved, {m}", "", 1, share=True), _solved(m)) for m in named
    ]


LOAD = "contact_load"


def _solved(method: str) -> Callable[[Sequence[TaskOutcome]], float]:
    return lambda outcomes: float(np.mean([bool(o.records[method]["solved"]) for o in outcomes]))


def chosen(front: Sequence[str], figures: Sequence[Figure], source: str) -> list[Figure]:
    """The figures to trade off.

    Raises:
        InputError: If one is unknown or named twice.
    """
    known = {figure.key: figure for figure in figures}
    for key in front:
        if key not in known:
            raise InputError(f"{source}: front: unknown figure '{key}'; {nearest(key, [*known])}")
        if front.count(key) > 1:
            raise InputError(f"{source}: front names '{key}' twice")
    return [known[key] for key in front]


@dataclass(frozen=True, eq=False)
class DesignRow:
    """One design and its figures.

    Attributes:
        design: The mechanism.
        figures: Each figure's value by its key; none where it cannot be built, NaN where a figure
            is not defined.
        on_front: Whether no other design that can be recommended beats it in the figures traded.
        why: Why most of the tasks are refused that the first method does not solve; or "".
    """

    design: Design
    figures: Mapping[str, float]
    on_front: bool = False
    why: str = ""

    def __repr__(self) -> str:
        if self.design.refused:
            return f"DesignRow({self.design.name}: {self.design.refused})"
        shown = ", ".join(f"{key} {number(v)}" for key, v in list(self.figures.items())[:3])
        return f"DesignRow({self.design.name}: {shown}{', on the front' * self.on_front})"

    def __getitem__(self, key: str) -> float:
        if key not in self.figures:
            raise InputError(f"no figure '{key}'; {nearest(key, [*self.figures])}")
        return self.figures[key]

    @property
    def holds(self) -> bool:
        """Whether its contacts transmit the torque of its plans, on `CARRIED` % of the machines."""
        return not self.figures[LOAD] > 1


def commonest(outcomes: Sequence[TaskOutcome], method: str) -> str:
    """The reason that most tasks share for not being solved by a method; "" where all are."""
    whys = [o.records[method]["why"] for o in outcomes if not o.records[method]["solved"]]
    return Counter(whys).most_common(1)[0][0] if whys else ""


def pareto(values: Array, better: Sequence[int]) -> NDArray[np.bool_]:
    """Which rows no other row beats: none is as good in every column and better in one.

    Args:
        values: Figures, (rows, columns).
        better: −1 for columns where less is better, 1 where more is, (columns,).

    Returns:
        Shape (rows,); False for rows with a figure that is not defined. Equal rows are both kept.
    """
    cost = -values * np.asarray(better)
    defined = ~np.isnan(cost).any(axis=1)
    out = defined.copy()
    for k in np.flatnonzero(defined):
        others = cost[defined]
        out[k] = not np.any(np.all(others <= cost[k], axis=1) & np.any(others < cost[k], axis=1))
    return np.asarray(out)


def able(rows: Sequence[DesignRow], traded: Sequence[Figure], solved: str) -> list[int]:
    """Rows that may be recommended.

    They can be built, solve as many tasks as any, have contacts that hold, where one has, and a
    value of every figure traded.
    """
    keys = [solved, *(figure.key for figure in traded)]
    kept = [k for k, r in enumerate(rows) if r.figures and r.figures[solved] > 0]
    kept = [k for k in kept if not np.isnan([rows[k].figures[key] for key in keys]).any()]
    most = max((rows[k].figures[solved] for k in kept), default=0.0)
    kept = [k for k in kept if rows[k].figures[solved] == most]
    return [k for k in kept if rows[k].holds] or kept


def best(rows: Sequence[DesignRow], kept: Sequence[int], traded: Sequence[Figure]) -> int:
    """The row with the least sum of relative losses against the best value of each figure.

    One percent of one figure counts as one percent of another, so that nothing depends on how far
    the worst designs lie, and what hardly differs hardly counts. It lies on the front.
    """
    total = np.zeros(len(kept))
    for figure in traded:
        values = np.array([rows[k].figures[figure.key] for k in kept])
        total += figure.lost(values, float(np.max(values * figure.better) * figure.better))
    return kept[int(np.argmin(total))]


def reason(
    rows: Sequence[DesignRow],
    taken: int | None,
    kept: Sequence[int],
    traded: Sequence[Figure],
    methods: Sequence[str],
    tasks: int,
) -> str:
    """Why that design, in sentences."""
    solved = f"solved {methods[0]}"
    if taken is None:
        whys = [row.why for row in rows if row.why]
        most = f": {Counter(whys).most_common(1)[0][0]}" if whys else ""
        if not any(row.figures and row[solved] > 0 for row in rows):
            return f"No design solves a task by {methods[0]}{most}."
        names = _listed([figure.title for figure in traded])
        half = f"No design solves half of the tasks by {methods[0]} or has {names} otherwise"
        return f"{half}{most}."
    row, count = rows[taken], len(kept)
    built = sum(bool(r.figures) for r in rows)
    done = f"solves {row[solved] * tasks:.0f} of {tasks} tasks by {methods[0]}"
    if row.holds:
        said = [f"Take {row.design.name}. It {done}, as {count} of {built} designs do"]
        said.append(" whose contacts do not slip.")
    else:
        said = [f"Take {row.design.name}, with larger contact forces. It {done}, as {count}"]
        said.append(f" of {built} designs do; all load their contacts beyond capacity.")
    names = _listed([figure.title for figure in traded])
    if len(traded) == 1:
        said.append(f" Of these it has the best {names}")
    else:
        said.append(
            f" Of these it has the least total loss, with equal weight for a percent of {names}"
        )
    said.append(f": {_figures(row, traded)}. Its contacts are loaded to {number(row[LOAD])} of")
    said.append(f" their capacity on {CARRIED} % of the machines.")
    present = next((r for r in rows if not r.design.values and r.figures), None)
    if present is not None and present is not row:
        said.append(f" The mechanism as it is: {_figures(present, traded)}.")
    return "".join([*said, _dearer(rows, taken, kept, traded), _chart(row, tasks)])


def _dearer(
    rows: Sequence[DesignRow], taken: int, kept: Sequence[int], traded: Sequence[Figure]
) -> str:
    """Why not those that are better in a figure and are no candidates."""
    out = []
    for figure in traded:
        others = [k for k, r in enumerate(rows) if k not in kept and r.figures]
        others = [k for k in others if not np.isnan(rows[k].figures[figure.key])]
        if not others:
            continue
        k = max(others, key=lambda k: rows[k].figures[figure.key] * figure.better)
        row = rows[k]
        if (row[figure.key] - rows[taken][figure.key]) * figure.better <= 0:
            continue
        why = (
            f"its contacts would slip (loaded to {number(row[LOAD])})"
            if not row.holds
            else "it solves fewer tasks"
        )
        out.append(f" {row.design.name} has {_figures(row, [figure])}, but {why}.")
    return "".join(dict.fromkeys(out))


def _chart(row: DesignRow, tasks: int) -> str:
    """What it means for methods of the chart."""
    if row["one_way"] == 1:
        return ""
    lost = tasks - row["one_way"] * tasks
    return (
        f" For {lost:.0f} of the {tasks} tasks no one-way motion exists with it, so methods"
        " whose disk never reverses cannot solve them."
    )


def _figures(row: DesignRow, traded: Sequence[Figure]) -> str:
    return ", ".join(
        f"{figure.title} {number(row[figure.key])}{f' {figure.unit}' if figure.unit else ''}"
        for figure in traded
    )


def _listed(words: Sequence[str]) -> str:
    return ", ".join(words[:-1]) + (" and " if len(words) > 1 else "") + words[-1]
