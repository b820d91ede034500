"""The error budget of a plan: effects one at a time, all but one, and by their Sobol indices.

*Alone*: E with this effect and no other. *Saves*: by how much E falls when this effect alone is
switched off. They differ where effects need or hide each other: friction winds up a soft shaft, and
alone does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.machine.machine import Draws, Machine, draw
from planner.machine.replay import SETTLE_S, refuse_inexecutable, sample_numbers
from planner.machine.simulate import simulate_draws
from planner.plan.plan import Plan
from planner.problem.tables.machine_effects import EFFECTS
from planner.robustness.sobol import Index, between_machines, check, on_or_off, per_sample, switched
from planner.support import tables
from planner.support.arrays import Array, jsonable
from planner.support.package import handed_to
from planner.support.statistics import percentile_interval
from planner.support.tables import clean, markdown_code, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of all work that is done, 0 … 1."""

Interval = tuple[float, float]

SCREENED = 16
"""Machines on which an effect must change something to be looked at further."""

IDLE_DEG = 1e-6
"""What counts as something, degrees."""


@dataclass(frozen=True)
class Cost:
    """What one effect costs; intervals are of 95 %.

    Attributes:
        name: The effect.
        alone_deg: Median of E with this effect alone, degrees.
        alone_interval_deg: Its interval; NaN where nothing varies.
        saves_deg: Median over machines of E with all effects minus E without this one, degrees.
        saves_interval_deg: Its interval.
        between: Sobol indices among what differs from machine to machine; None without a spread.
        switch: Sobol indices as a switch.
    """

    name: str
    alone_deg: float
    alone_interval_deg: Interval
    saves_deg: float
    saves_interval_deg: Interval
    between: Index | None
    switch: Index


@dataclass(frozen=True, eq=False)
class Budget:
    """The error budget of one plan.

    Attributes:
        plan: The plan.
        machine: The distribution of machines.
        samples: Machines for each median.
        base: Base samples of the Sobol indices.
        seed: Of all draws.
        E_deg: Median of E with all effects, degrees.
        E_interval_deg: Its 95 % interval.
        none_deg: E with no effect at all, degrees.
        costs: Of the effects that matter, those that save most first.
        idle: Effects that are on, can act in the machine's fidelity, and changed nothing on the
            first machines.
    """

    plan: Plan
    machine: Machine
    samples: int
    base: int
    seed: int
    E_deg: float
    E_interval_deg: Interval
    none_deg: float
    costs: tuple[Cost, ...]
    idle: tuple[str, ...]

    def __repr__(self) -> str:
        first = ", ".join(f"{cost.name} {cost.saves_deg:.3g}" for cost in self.costs[:3])
        saved = f"; switched off saves: {first} deg" if first else ""
        return f"Budget({self.plan.method} plan, E {self.E_deg:.3g} deg in the median{saved})"

    def __getitem__(self, name: str) -> Cost:
        for cost in self.costs:
            if cost.name == name:
                return cost
        names = ", ".join(cost.name for cost in self.costs)
        raise InputError(f"no effect '{name}' in this budget; there are: {names}")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready; None where a number is not defined."""
        data = {k: v for k, v in vars(self).items() if k not in ("plan", "machine", "costs")}
        data["method"] = self.plan.method
        data["machine"] = self.machine.to_dict()
        data["costs"] = [_plain(cost) for cost in self.costs]
        return dict(jsonable(data))

    def table(self) -> Table:
        """For a terminal: `rich.print(budget.table())`."""

        return budget_table(self)

    def figure(self) -> Figure:
        """Costs and indices as bars."""
        drawn: tuple[Figure, Any] = handed_to("planner.report.figures.robustness.plot_budget")(self)
        return drawn[0]


def error_budget(
    plan: Plan,
    machine: Machine | None = None,
    *,
    samples: int = 200,
    base: int = 256,
    seed: int = 0,
    progress: Progress | None = None,
) -> Budget:
    """Find which effect of a machine costs a plan how much of its error E (eq. 29), open loop.

    Args:
        plan: An executable plan.
        machine: The machine; the problem's `[machine]` table when left out.
        samples: Machines for each median, at least 1; the same for every median.
        base: Base samples of the Sobol indices, a power of 2. They take (effects + 2) · base runs
            for effects as switches, and as many again for what differs between machines.
        seed: Seed of all draws.
        progress: Told what is being done.

    Raises:
        InputError: If the plan cannot be executed or has no angles, the machine has no effects or
            does not match the system, a number is out of range, or SALib is missing.
    """
    used = Machine.from_table(plan.problem.machine) if machine is None else machine
    run = _Run(plan, used, len(sample_numbers(samples)), seed, base, progress)
    return run.budget()


class _Run:
    """One budget in the making."""

    def __init__(
        self,
        plan: Plan,
        machine: Machine,
        samples: int,
        seed: int,
        base: int,
        progress: Progress | None,
    ) -> None:
        check(base)
        refuse_inexecutable(plan)
        if all(c.unit != "rad" for c in plan.problem.system.coordinates[1:]):
            raise InputError("the error index E is of angles, and this system has none")
        if not machine.effects:
            raise InputError("this machine has no effects, so there is nothing to share out")
        self._plan, self._machine, self._samples = plan, machine, samples
        self._seed, self._base, self._progress = seed, base, progress
        self._joints = plan.problem.system.size - 1

    def budget(self) -> Budget:
        """All of it."""
        names = frozenset(self._machine.effects)
        active, idle = self._screened(names)
        self._tell("effects alone and off", 0.1)
        changes = [names, frozenset[str](), *(names - {k} for k in active)]
        changes += [frozenset({k}) for k in active]
        none, whole, *rest = self._variants(changes, self._samples)
        alone = dict(zip(active, rest[: len(active)], strict=True))
        without = dict(zip(active, rest[len(active) :], strict=True))
        between, switch = self._indices(active)
        costs = [
            _cost(name, alone[name], whole - without[name], between.get(name), switch[name])
            for name in active
        ]
        costs.sort(key=lambda cost: -abs(cost.saves_deg))
        return Budget(
            plan=self._plan,
            machine=self._machine,
            samples=self._samples,
            base=self._base,
            seed=self._seed,
            E_deg=float(np.median(whole)),
            E_interval_deg=_interval(whole),
            none_deg=float(np.median(none)),
            costs=tuple(costs),
            idle=tuple(idle),
        )

    def _screened(self, names: frozenset[str]) -> tuple[list[str], list[str]]:
        """Effects that change something on the first few machines, and those that do not."""
        self._tell("looking for effects without influence", 0.0)
        static = self._machine.fidelity == "quasi-static"
        every = [k for k, e in EFFECTS.items() if k in names and not (static and e.dynamic)]
        changes = [names, frozenset[str](), *(names - {k} for k in every)]
        changes += [frozenset({k}) for k in every]
        none, whole, *rest = self._variants(changes, min(self._samples, SCREENED))
        alone, without = rest[: len(every)], rest[len(every) :]
        idle = [
            name
            for name, a, w in zip(every, alone, without, strict=True)
            if max(np.max(np.abs(a - none)), np.max(np.abs(w - whole))) < IDLE_DEG
        ]
        return [name for name in every if name not in idle], idle

    def _variants(self, changes: Sequence[frozenset[str]], count: int) -> list[Array]:
        """E of the first samples, (S,), with each of these sets of effects off.

        Those that may share a simulation do; machines that are all alike are simulated once.
        """
        effects = self._machine.effects
        sizes = [
            count if any(q.varies for name, q in effects.items() if name not in off) else 1
            for off in changes
        ]
        groups: dict[frozenset[str], list[int]] = {}
        for k, off in enumerate(changes):
            shared = frozenset(name for name in off if not per_sample(name))
            groups.setdefault(shared, []).append(k)
        out: list[Array] = [np.empty(0)] * len(changes)
        for shared, members in groups.items():
            there = self._machine.without(*sorted(shared))
            numbers = np.concatenate([np.arange(sizes[k]) for k in members])
            draws = draw(there, self._joints, numbers, self._seed)
            where = np.repeat(members, [sizes[k] for k in members])
            flags = {name: np.array([name in changes[k] for k in where]) for name in effects}
            errors = self._given(there, switched(draws, flags))
            for k in members:
                out[k] = np.broadcast_to(errors[where == k], count)
        return out

    def _indices(self, active: Sequence[str]) -> tuple[dict[str, Index], dict[str, Index]]:
        rest = (self._joints, self._given, self._base, self._seed)
        self._tell("Sobol indices between machines", 0.4)
        between = between_machines(self._machine, active, *rest)
        self._tell("Sobol indices of effects on or off", 0.6)
        switch = on_or_off(self._machine, active, *rest)
        self._tell("done", 1.0)
        return between, switch

    def _given(self, machine: Machine, draws: Draws) -> Array:
        run = simulate_draws(self._plan, machine, draws, settle_s=SETTLE_S, record_s=None)
        coordinates = self._plan.problem.system.coordinates[1:]
        angles = [i for i, c in enumerate(coordinates) if c.unit == "rad"]
        return np.asarray(np.rad2deg(run.deviation[:, angles].max(axis=1)))

    def _tell(self, doing: str, share: float) -> None:
        if self._progress is not None:
            self._progress(doing, share)


def _cost(name: str, alone: Array, saved: Array, between: Index | None, switch: Index) -> Cost:
    return Cost(
        name=name,
        alone_deg=float(np.median(alone)),
        alone_interval_deg=_interval(alone),
        saves_deg=float(np.median(saved)),
        saves_interval_deg=_interval(saved),
        between=between,
        switch=switch,
    )


def _interval(values: Array) -> Interval:
    """Of the median; nothing where all are alike."""
    if np.ptp(values) == 0:
        return (float(values[0]), float(values[0]))
    return percentile_interval(values, 50)


def _plain(cost: Cost) -> dict[str, Any]:
    data = dict(vars(cost))
    data["between"] = None if cost.between is None else vars(cost.between)
    data["switch"] = vars(cost.switch)
    return data


HEAD = (
    "effect",
    "alone (deg)",
    "saves (deg)",
    "from",
    "to",
    "between, first",
    "between, total",
    "switch, first",
    "switch, total",
)
TERMINAL = (0, 1, 2, 3, 4, 6, 8)
"""Columns for which a terminal has room."""

TINY_DEG = 1e-4
"""What is smaller is shown as 0: it is that of the integration."""

EXPLAINED = (
    "alone: median error index E (eq. 29) with this effect and no other; saves: median over the"
    " machines of what E falls by when this effect alone is switched off, with its 95 % interval;"
    " between: Sobol indices of E between machines (what has no spread has none); switch: Sobol"
    " index of the effect being on or off, all others on or off at random; both with half of their"
    " 95 % interval."
)


def budget_table(budget: Budget) -> Table:
    """For a terminal, at most 100 columns wide."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=f"Error budget of {budget.plan.method}: {total(budget)}",
        title_justify="left",
        title_style="",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        pad_edge=False,
        caption=f"{EXPLAINED} {_idle(budget)}",
        caption_justify="left",
    )
    for k in TERMINAL:
        head = HEAD[k].replace(" (", "\n(").replace(", ", ",\n")
        table.add_column(head, justify="right" if k else "left", no_wrap=k > 0, overflow="fold")
    for cost in budget.costs:
        cells = _cells(cost)
        table.add_row(*(cells[k] for k in TERMINAL))
    return table


def budget_markdown(budgets: Mapping[str, Budget], command: str | None = None) -> str:
    """Markdown text, one table a plan."""
    lines = ["# Error budget", ""]
    for label, budget in budgets.items():
        lines += [f"## {markdown_code(label)}", "", total(budget) + ".", "", _line(HEAD)]
        lines += [_line(["---", *["---:"] * (len(HEAD) - 1)])]
        lines += [_line(_cells(cost)) for cost in budget.costs]
        lines += ["", _idle(budget), ""]
    first = next(iter(budgets.values()))
    lines += [
        f"{first.samples} machines ({first.machine.preset}) a median; Sobol indices by Saltelli's"
        f" scheme from {first.base} base samples; seed {first.seed}.",
        "",
        EXPLAINED[0].upper() + EXPLAINED[1:],
    ]
    if command:
        lines += ["", f"Made by:\n\n    {clean(command)}"]
    return "\n".join(lines) + "\n"


def budget_csv(budgets: Mapping[str, Budget]) -> str:
    """One line an effect of a plan, full precision, empty where a number is not defined."""
    ends = [
        f"{key}{end}" for key in ("alone", "saves") for end in ("_deg", "_low_deg", "_high_deg")
    ]
    parts = ("first", "first_half", "total", "total_half")
    shares = [f"{kind}_{part}" for kind in ("between", "switch") for part in parts]
    rows: list[list[Any]] = [["plan", "effect", *ends, *shares]]
    for label, budget in budgets.items():
        for cost in budget.costs:
            kinds = (cost.between, cost.switch)
            numbers = [cost.alone_deg, *cost.alone_interval_deg]
            numbers += [cost.saves_deg, *cost.saves_interval_deg]
            numbers += [getattr(i, p) if i else np.nan for i in kinds for p in parts]
            rows.append([label, cost.name, *("" if x != x else x for x in numbers)])
    return tables.csv_text(rows)


def _cells(cost: Cost) -> list[str]:
    low, high = (_degrees(x, "+.2g") for x in cost.saves_interval_deg)
    between = cost.between
    return [
        cost.name,
        _degrees(cost.alone_deg, ".3g"),
        _degrees(cost.saves_deg, "+.3g"),
        low,
        high,
        _share(between.first, between.first_half) if between else "-",
        _share(between.total, between.total_half) if between else "-",
        _share(cost.switch.first, cost.switch.first_half),
        _share(cost.switch.total, cost.switch.total_half),
    ]


def _degrees(value: float, style: str) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return format(value, style) if np.isfinite(value) else "-"


def _share(value: float, half: float) -> str:
    return f"{value:.2f} +- {half:.2f}"


def total(budget: Budget) -> str:
    """The median error with its interval, and what is left without any effect."""
    low, high = (number(x) for x in budget.E_interval_deg)
    none = _degrees(budget.none_deg, ".3g")
    return f"median E {number(budget.E_deg)} deg ({low} to {high}), {none} without any effect"


def _idle(budget: Budget) -> str:
    if not budget.idle:
        return ""
    return f"On, and without influence here: {', '.join(budget.idle)}."


def _line(cells: Any) -> str:
    return "| " + " | ".join(cells) + " |"
