"""The trade-off curve and its knee.

Each point is a verified plan, started from the plan of its neighbour and replayed on machines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import InputError, NoPlanError, expect_number
from planner.machine.machine import Machine, machine_for
from planner.machine.replay import STATISTICS
from planner.methods.registry import find_method, merged_options
from planner.plan.plan import Plan
from planner.plan.samples import import_library
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.tables.method_options import DesensitisedOptions
from planner.robustness.trade_off_points import (
    KINDS,
    Axis,
    Kind,
    PointStore,
    TradeOffPoint,
    axis,
    compensated_errors,
    errors_machine,
    replay_errors,
    solved_point,
)
from planner.support.arrays import Array, jsonable
from planner.support.package import DataFrame, Figure, Table, draw_figure
from planner.support.progress import Tell, expect_listener
from planner.support.tables import Column, four_digits, terminal_table

NO_GAIN = 1e-4
"""Relative decrease of the response below which a point counts as no better than another."""


@dataclass(frozen=True, eq=False)
class TradeOff:
    """A curve of the least response against effort, duration or peak input.

    Attributes:
        problem: The problem of the plans.
        kind: "effort", "duration" or "peak".
        points: Points in the order of their limits, with decreasing response.
        options: Weights and spreads.
        machine: The machine on which the plans were replayed.
        folder: Folder of the plans, or None.
    """

    problem: Problem
    kind: Kind
    points: tuple[TradeOffPoint, ...]
    options: DesensitisedOptions
    machine: Machine
    folder: Path | None

    def __repr__(self) -> str:
        knee = f", knee at {self.cost[self.knee_index]:.3g}" if self.points else ""
        return (
            f"TradeOff({self.problem.name!r} against {self.kind}, {len(self.points)} points{knee})"
        )

    @property
    def cost(self) -> Array:
        """Cost of each point, shape (m,): effort, seconds, or share of the input limits."""
        return np.array([p.effort if self.kind == "effort" else p.limit for p in self.points])

    @property
    def response_deg(self) -> Array:
        """Response of each point, which the cost reduces, shape (m,), degrees."""
        return np.array([p.response_deg for p in self.points])

    @property
    def knee(self) -> TradeOffPoint:
        """The point of the curve farthest below the chord between the curve's ends."""
        return self.points[self.knee_index]

    @property
    def knee_index(self) -> int:
        """Index of the knee among `points`."""
        return knee(self.cost, self.response_deg) if len(self.points) > 1 else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the curve as JSON-ready data, without the plans."""
        data = {
            "problem": self.problem.name,
            "source": self.problem.source,
            "kind": self.kind,
            "knee": self.knee_index,
            "knee_rule": "farthest below the chord between the ends, both axes scaled to the curve",
            "options": self.options.model_dump(),
            "machine": self.machine.to_dict(),
            "points": [p.to_dict() for p in self.points],
            "folder": None if self.folder is None else str(self.folder),
        }
        return dict(jsonable(data))

    @property
    def columns(self) -> list[Column[TradeOffPoint]]:
        """The columns of the curve's tables."""
        inputs = enumerate(self.problem.system.inputs)
        heads = {"errors_alone": "errors", "machine": "machine", "compensated": "compensated"}
        return [
            Column("", "", lambda p: "knee" if p is self.knee else "", key="knee", left=True),
            Column("effort", "", lambda p: p.effort, four_digits),
            Column("time", "s", lambda p: p.duration_s, four_digits, key="duration"),
            *(Column(f"|{u.name}|", "", partial(_peak, i), four_digits) for i, u in inputs),
            Column("total", "deg", lambda p: p.total_deg, four_digits),
            Column("passive", "deg", lambda p: p.passive_deg, four_digits),
            Column("floor", "deg", lambda p: p.floor_deg, None),
            Column("turns", "", lambda p: p.reversals, key="reversals"),
            *(
                Column(f"{head} 95 %", "deg", partial(end_error, k), four_digits, f"{k}_95_deg")
                for k, head in heads.items()
            ),
            *(
                Column(f"{k} {STATISTICS[key].title}", "deg", partial(end_error, k, key=key), None)
                for k in ("machine", "compensated")
                for key in ("E_p95_deg", "end_median_deg")
            ),
        ]

    def table(self) -> Table:
        """Return the points as a table for a terminal: `rich.print(curve.table())`."""
        return terminal_table(self.columns, self.points, ruled=True)

    def to_frame(self) -> DataFrame:
        """Return one row per point; index `limit`, columns with units in their names.

        Figures of replays have a prefix: `machine_` on the problem's machine, `compensated_` with
        the plan compensated for that machine, `errors_alone_` on a machine with the design errors
        only. `knee` is True in one row.

        Raises:
            InputError: If pandas is not installed.
        """
        rows = []
        for k, point in enumerate(self.points):
            row = point.to_dict()
            row["peak_u1"], row["peak_u2"] = row.pop("peak_u")
            for name in ("machine", "compensated", "errors_alone"):
                replays = row.pop(name) or {}
                row |= {f"{name}_{key}": v for key, v in replays.items() if key != "refused"}
            rows.append({**row, "knee": k == self.knee_index})
        frame = import_library("pandas").DataFrame(rows)
        frame.attrs = {"problem": self.problem.name, "kind": self.kind}
        return frame.set_index("limit") if rows else frame

    def plot(self) -> Figure:
        """Draw the response of each point against its cost."""
        return draw_figure("robustness.plot_trade_off", self)


def _peak(which: int, point: TradeOffPoint) -> float:
    return point.peak_u[which]


def end_error(which: str, point: TradeOffPoint, key: str = "end_p95_deg") -> float | None:
    """Return a statistic of the error of a point's replays, degrees; None without them.

    Args:
        which: "machine" or "compensated".
        point: The point.
        key: One of `STATISTICS`.
    """
    errors: Mapping[str, Any] = getattr(point, which) or {}
    return errors.get(key)


def trade_off(
    problem: AnyProblem,
    kind: Kind = "effort",
    points: int = 10,
    folder: str | Path | None = None,
    *,
    machine: Machine | str | None = None,
    samples: int = 200,
    seed: int = 0,
    progress: Tell | None = None,
    **options: Any,
) -> TradeOff:
    """Trace the least response to design errors against effort, duration or peak input.

    The limit is raised from point to point, and each plan starts from its neighbour's. Optima are
    local, so a sweep back starts each plan from its other neighbour. With a folder, each finished
    point is saved at once, and the same call continues after an interruption.

    Args:
        problem: The problem.
        kind: The limited quantity: "effort", "duration" or "peak".
        points: Number of points, at least 3.
        folder: Folder in which the plans of the points are saved.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Number of machines on which to replay each plan, with and without compensation. 200
            give a 95th percentile of 2.5 degrees to about 0.15, which is the difference between
            neighbours on the curve, in one second per point; a thousand give it to 0.06.
        seed: Seed of the machines.
        progress: Called with the progress of the run.
        **options: Override the problem's `[method.desensitised]` table.

    Raises:
        InputError: If an argument is wrong or the folder holds other files.
        NoPlanError: If the problem has no plan.
        KeyboardInterrupt: If interrupted; finished points are saved in the folder.
    """
    problem = problem_of(problem)
    if kind not in KINDS:
        raise InputError(f"trade-off against {kind!r}: must be one of {', '.join(KINDS)}")
    expect_number("points", points, "a whole number, 3 to 200", 3, 200, whole=True)
    design = merged_options(problem, find_method("desensitised"), options)
    distribution = machine_for(problem.machine, machine)
    request = {
        "problem": problem.to_dict(),
        "kind": kind,
        "count": points,
        "options": design.model_dump(),
        "machine": distribution.to_dict(),
        "samples": samples,
        "seed": seed,
    }
    tell = expect_listener(progress)
    store = PointStore(folder, request)
    if len(store.points) < points or any(p.swept < 2 for p in store.points.values()):
        tell("finding the ends of the curve", 0.0)
        _sweep(problem, design, axis(problem, design, kind, points), store, tell)
    _replay(store, distribution, errors_machine(problem, design), (samples, seed), tell)
    descending = list[TradeOffPoint]()
    for _, point in sorted(store.points.items()):
        if not descending or point.response_deg < descending[-1].response_deg * (1 - NO_GAIN):
            descending.append(point)
    return TradeOff(problem, kind, tuple(descending), design, distribution, store.path)


def _sweep(
    problem: Problem, options: DesensitisedOptions, along: Axis, store: PointStore, tell: Tell
) -> None:
    """Find the points of the curve, from the smallest limit to the largest and back; store them."""
    attempt = partial(_attempt, problem, options, along)
    near, count = along.least, len(along.limits)
    for k, limit in enumerate(along.limits):
        tell(f"point {k + 1} of {count}", 0.1 + 0.5 * k / count)
        if k not in store.points:
            best = _best_point([attempt(limit, near), attempt(limit, None)])
            if best is None:
                continue
            store.put(k, best)
        near = store.points[k].plan
    if not store.points:  # raises the reason, since there are no points
        solved_point(*along.task_at(problem, options, along.limits[-1]), along.limits[-1], None)
    after: Plan | None = None
    for j, k in enumerate(sorted(store.points, reverse=True)):
        point = store.points[k]
        tell(f"point {k + 1} from the other side", 0.6 + 0.2 * j / len(store.points))
        if point.swept < 2:
            best = _best_point([point, None if after is None else attempt(point.limit, after)])
            assert best is not None
            store.put(k, replace(best, swept=2))
        after = store.points[k].plan


def _attempt(
    problem: Problem, options: DesensitisedOptions, along: Axis, limit: float, near: Plan | None
) -> TradeOffPoint | None:
    """Return the point at a limit, planned from the plan `near` if given; None without a plan."""
    problem, options = along.task_at(problem, options, float(limit))
    if near is None:
        options = options.model_copy(update={"starts": min(options.starts, 2)})
    try:
        return solved_point(problem, options, float(limit), near)
    except NoPlanError:
        return None


def _best_point(points: list[TradeOffPoint | None]) -> TradeOffPoint | None:
    """Return the point with the smallest response; of points that hardly differ, the first."""
    best: TradeOffPoint | None = None
    for point in filter(None, points):
        if best is None or point.response_deg < best.response_deg * (1 - NO_GAIN):
            best = point
    return best


def _replay(
    store: PointStore, machine: Machine, alone: Machine, machines: tuple[int, int], tell: Tell
) -> None:
    """Replay each stored plan that lacks replays, plain and compensated, and store the errors.

    Args:
        store: The points of the curve.
        machine: The problem's machine.
        alone: A machine that has only the design errors.
        machines: Number of random machines, and their seed.
        tell: Called with the current step and the finished share.
    """
    for j, k in enumerate(sorted(store.points)):
        point = store.points[k]
        share = 0.8 + 0.2 * j / len(store.points)
        tell(f"replaying point {k + 1}, with and without compensation", share)
        if point.machine is None or point.compensated is None:
            runs = [replay_errors(point.plan, each, *machines) for each in (machine, alone)]
            allowed = compensated_errors(point.plan, machine, *machines)
            store.put(k, replace(point, machine=runs[0], errors_alone=runs[1], compensated=allowed))


def knee(cost: Array, response: Array) -> int:
    """Return the index of the point farthest below the chord between the curve's ends.

    Both axes are scaled to the curve's range first (V. Satopaa et al., "Finding a 'Kneedle' in a
    Haystack", ICDCS Workshops 2011): beyond the knee an increase of the cost reduces the response
    by a smaller share of its range.

    Args:
        cost: Increasing, shape (m,), m ≥ 2.
        response: The response, which the cost reduces, shape (m,).
    """
    x = (cost - cost[0]) / max(float(cost[-1] - cost[0]), 1e-300)
    span = float(np.max(response) - np.min(response))
    if span <= 0:
        return 0
    y = (response - np.min(response)) / span
    chord = y[0] + (y[-1] - y[0]) * x
    return int(np.argmax(chord - y))
