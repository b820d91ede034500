"""The error budget of a plan: each effect alone, each effect switched off, and Sobol indices.

*Alone*: E with this effect and no other. *Saves*: how much E falls if only this effect is switched
off. Both differ if effects interact: friction winds up a soft shaft, but causes no error alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.machine.closed_loop import Controller, Feedback
from planner.machine.machine import Draws, Machine, machine_for, sample_numbers
from planner.machine.replay import SETTLE_S, feedback_of
from planner.machine.simulate import simulate
from planner.plan.plan import Plan, refuse_inexecutable
from planner.problem.tables.machine_effects import EFFECTS, effect_words
from planner.robustness.sobol import Index, check, machine_indices, switch_indices, switched_errors
from planner.support.arrays import Array, jsonable
from planner.support.package import Figure, Table, draw_figure, import_function, provenance
from planner.support.progress import Tell, expect_listener
from planner.support.statistics import percentile_interval
from planner.support.tables import (
    Column,
    clean_text,
    csv_table,
    markdown_code,
    markdown_table,
    number,
    terminal_table,
)

Interval = tuple[float, float]

SCREENING_MACHINES = 16
"""Number of machines for the first test; an effect that changes E on no such machine is idle."""

BLOCK_MACHINES = 1000
"""Number of machines simulated at once, which limits the memory."""

IDLE_DEG = 1e-6
"""Change of E below which an effect counts as idle, in degrees."""


@dataclass(frozen=True)
class Cost:
    """Contribution of one effect of the machine to a plan's error E, with 95 % intervals.

    Attributes:
        name: The effect.
        alone_deg: Median of E with this effect alone, degrees.
        alone_interval_deg: Interval of `alone_deg`.
        saves_deg: Median over machines of E with all effects minus E without this one, degrees.
        saves_interval_deg: Interval of `saves_deg`.
        between: Sobol indices between machines; None if the effect has no spread.
        switch: Sobol indices of switching the effect on or off.
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
    """The error budget of one plan: how much error each effect of the machine causes.

    Attributes:
        plan: The plan.
        machine: The distribution of machines.
        samples: Number of random machines for each median.
        base: Base samples of the Sobol indices.
        seed: Seed of all draws.
        E_deg: Median of E with all effects, degrees.
        E_interval_deg: 95 % interval of `E_deg`.
        none_deg: E without any effect, degrees.
        feedback: Whether the machines were driven with feedback.
        costs: The effects that change E, sorted by decreasing |`saves_deg`|.
        idle: Effects that are on and can act in the machine's fidelity, but do not change E on the
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
    feedback: bool
    costs: tuple[Cost, ...]
    idle: tuple[str, ...]

    def __repr__(self) -> str:
        first = ", ".join(f"{cost.name} {cost.saves_deg:.3g}" for cost in self.costs[:3])
        saved = f"; switched off saves: {first} deg" if first else ""
        return f"Budget({self.plan.method} plan, E {self.E_deg:.3g} deg in the median{saved})"

    def __getitem__(self, name: str) -> Cost:
        by_name = {cost.name: cost for cost in self.costs}
        if name not in by_name:
            raise InputError(f"no effect '{name}' in this budget; there are: {', '.join(by_name)}")
        return by_name[name]

    def to_dict(self) -> dict[str, Any]:
        """Return the budget as JSON-ready data; undefined numbers are None."""
        data = {k: v for k, v in vars(self).items() if k not in ("plan", "machine", "costs")}
        data |= {"method": self.plan.method, "machine": self.machine.to_dict()}
        data["costs"] = [asdict(cost) for cost in self.costs]
        return dict(jsonable(data))

    def table(self) -> Table:
        """Return the budget's table, without first-order indices, for `rich.print`."""
        shown = [column for column in COLUMNS if column.name not in FIRST_ORDER]
        return terminal_table(
            [replace(c, value=_words) if c.name == "effect" else c for c in shown],
            [("", cost) for cost in self.costs],
            title=f"Error budget of {self.plan.method}: {total(self)}",
            caption=f"{CAPTION} {_idle_text(self)}",
            ruled=True,
            gap=1,
        )

    def plot(self) -> Figure:
        """Draw the costs and Sobol indices of all effects as bars."""
        return draw_figure("robustness.plot_budget", self)

    def save(self, folder: str | Path) -> Path:
        """Write tables, data and figure to a folder, all or nothing.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        save = import_function("planner.report.folders.save_budget")
        return Path(save({self.plan.label: self}, folder))


def error_budget(
    plan: Plan,
    machine: Machine | str | None = None,
    *,
    samples: int = 200,
    base: int = 256,
    seed: int = 0,
    feedback: bool | Feedback = False,
    progress: Tell | None = None,
) -> Budget:
    """Find how much each effect of a machine contributes to a plan's error E (eq. 29).

    Args:
        plan: An executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        samples: Number of machines for each median, at least 1; all medians use the same machines.
        base: Base samples of the Sobol indices, a power of 2. The indices take (effects + 2) · base
            runs for effects as switches, and (effects with a spread + 2) · base between machines.
        seed: Seed of all draws.
        feedback: As in `planner.replay`. The tracker knows the machine with all its effects, also
            where the budget switches some of them off.
        progress: Called with the current step and the finished share, 0 … 1.

    Raises:
        InputError: If the plan cannot be executed or has no angles, the machine has no effects or
            does not match the system, a number is out of range, or SALib is missing.
    """
    refuse_inexecutable(plan)
    distribution = machine_for(plan.problem.machine, machine)
    count = len(sample_numbers(samples))
    check(base)
    tell = expect_listener(progress)
    if all(c.unit != "rad" for c in plan.problem.system.coordinates[1:]):
        raise InputError("the error index E is defined for angles, and this system has none")
    if not distribution.effects:
        raise InputError("this machine has no effects, so there is no error to attribute")
    closing = feedback_of(plan, feedback)
    known = None if closing is None else _InformedFeedback(closing, distribution)
    return _BudgetRun(plan, distribution, count, seed, base, known, tell).budget()


def error_budgets(
    plans: Mapping[str, Plan | None], machine: Machine, progress: Tell, **options: Any
) -> Iterator[tuple[str, Budget]]:
    """Yield the label and error budget of each plan that can be executed.

    Args:
        plans: Plans by label, for example `comparison.plans`.
        machine: The machine.
        progress: Called with the current step and the finished share of the whole, 0 … 1.
        **options: Those of `error_budget`.
    """
    executable = {k: plan for k, plan in plans.items() if plan is not None and plan.executable}
    for k, (label, plan) in enumerate(executable.items()):

        def tell(doing: str, share: float, k: int = k, label: str = label) -> None:
            progress(f"{label}: {doing}", (k + share) / len(executable))

        yield label, error_budget(plan, machine, **options, progress=tell)


@dataclass(frozen=True)
class _InformedFeedback:
    """Feedback that knows the whole machine, whichever effects are switched off."""

    feedback: Feedback
    machine: Machine

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Controller:
        """Start the feedback with the whole machine in place of the argument `machine`."""
        return self.feedback.start(plan, self.machine, numbers)


@dataclass(frozen=True)
class _BudgetRun:
    """The computation of one plan's error budget."""

    plan: Plan
    machine: Machine
    samples: int
    seed: int
    base: int
    feedback: Feedback | None
    tell: Tell

    def budget(self) -> Budget:
        """Return the plan's error budget."""
        self.tell("finding effects without influence", 0.0)
        effects, static = self.machine.effects, self.machine.fidelity == "quasi-static"
        every = [k for k, e in EFFECTS.items() if k in effects and not (static and e.dynamic_only)]
        none, whole, alone, off = self._one_by_one(every, min(self.samples, SCREENING_MACHINES))
        active = [k for k in every if np.max(np.abs([alone[k] - none, off[k] - whole])) >= IDLE_DEG]
        self.tell("effects alone and off", 0.1)
        none, whole, alone, off = self._one_by_one(active, self.samples)
        rest = (active, self.plan.problem.system.size - 1, self._given, self.base, self.seed)
        self.tell("Sobol indices between machines", 0.4)
        between = machine_indices(self.machine, *rest)
        self.tell("Sobol indices of effects on or off", 0.6)
        switch = switch_indices(self.machine, *rest)
        self.tell("done", 1.0)
        costs = [
            Cost(
                name=k,
                alone_deg=float(np.median(alone[k])),
                alone_interval_deg=_interval(alone[k]),
                saves_deg=float(np.median(whole - off[k])),
                saves_interval_deg=_interval(whole - off[k]),
                between=between.get(k),
                switch=switch[k],
            )
            for k in active
        ]
        costs.sort(key=lambda cost: -abs(cost.saves_deg))
        return Budget(
            plan=self.plan,
            machine=self.machine,
            samples=self.samples,
            base=self.base,
            seed=self.seed,
            E_deg=float(np.median(whole)),
            E_interval_deg=_interval(whole),
            none_deg=float(np.median(none)),
            feedback=self.feedback is not None,
            costs=tuple(costs),
            idle=tuple(k for k in every if k not in active),
        )

    def _one_by_one(
        self, effects: Sequence[str], count: int
    ) -> tuple[Array, Array, dict[str, Array], dict[str, Array]]:
        """Return four errors E of the first `count` machines, each (S,), degrees.

        They are E without effects, with all effects, with each effect alone, and with all effects
        but one; the last two by effect.
        """
        names = frozenset(self.machine.effects)
        changes = [names, frozenset[str](), *(names - {k} for k in effects)]
        changes += [frozenset({k}) for k in effects]
        none, whole, *rest = self._variants(changes, count)
        alone = dict(zip(effects, rest[: len(effects)], strict=True))
        return none, whole, alone, dict(zip(effects, rest[len(effects) :], strict=True))

    def _variants(self, changes: Sequence[frozenset[str]], count: int) -> list[Array]:
        """Return the error E of the first `count` machines, (S,), degrees, for each of `changes`.

        A change is the set of effects to switch off.
        """
        blocks = [
            self._block(changes, np.arange(k, min(k + BLOCK_MACHINES, count)))
            for k in range(0, count, BLOCK_MACHINES)
        ]
        return [np.concatenate(each) for each in zip(*blocks, strict=True)]

    def _block(self, changes: Sequence[frozenset[str]], samples: NDArray[np.int64]) -> list[Array]:
        """Return the error E of the machines `samples`, (S,), degrees, for each of `changes`.

        A change is the set of effects to switch off. Changes share a simulation if possible; one
        that leaves all machines equal is simulated on one machine only.
        """
        effects, count = self.machine.effects, len(samples)
        sizes = [
            count if any(q.varies for name, q in effects.items() if name not in off) else 1
            for off in changes
        ]
        where = np.repeat(range(len(changes)), sizes)
        numbers = np.concatenate([samples[:size] for size in sizes])
        off = {name: np.array([name in changes[k] for k in where.tolist()]) for name in effects}
        joints = self.plan.problem.system.size - 1
        errors = switched_errors(self.machine, off, numbers, joints, self._given, self.seed)
        return [np.broadcast_to(errors[where == k], count) for k in range(len(changes))]

    def _given(self, machine: Machine, draws: Draws) -> Array:
        run = simulate(
            self.plan, machine, draws, settle_s=SETTLE_S, record_s=None, feedback=self.feedback
        )
        coordinates = self.plan.problem.system.coordinates[1:]
        angles = [i for i, c in enumerate(coordinates) if c.unit == "rad"]
        return np.asarray(np.rad2deg(run.deviation[:, angles].max(axis=1)))


def _interval(values: Array) -> Interval:
    """Return the 95 % interval of the median of values; both ends are equal if all values are."""
    if np.ptp(values) == 0:
        return (float(values[0]), float(values[0]))
    return percentile_interval(values, 50)


TINY_DEG = 1e-4
"""Value in degrees below which a number in the table is an integration error and shown as 0."""

CAPTION = (
    "alone: median error index E (eq. 29) with this effect and no other; saves: median over the"
    " machines of the decrease of E when only this effect is switched off, with its 95 % interval;"
    " between: Sobol indices of E between machines (an effect without spread has none); switch:"
    " Sobol indices of switching the effect on or off, all others on or off at random; both with"
    " half of their 95 % interval."
)


Labelled = tuple[str, Cost]
"""A row: the label of a plan and the cost of one effect."""


def _degrees(value: float, style: str) -> str:
    if abs(value) < TINY_DEG:
        return "0"
    return format(value, style) if np.isfinite(value) else "-"


def _cost(
    title: str, key: str, value: Callable[[Cost], float], style: str | None = None
) -> Column[Labelled]:
    """Return a table column of costs in degrees; a column without a style is for CSV only."""
    format = None if style is None else lambda x: _degrees(x, style)
    return Column(title, "", lambda row: value(row[1]), format, key)


def _sobol(kind: str, part: str) -> Iterator[Column[Labelled]]:
    """Yield the columns of a Sobol index and half its interval: one in tables, two in CSV."""

    def pair(row: Labelled) -> tuple[float, float]:
        index: Index | None = getattr(row[1], kind)
        return (getattr(index, part, np.nan), getattr(index, f"{part}_half", np.nan))

    def read(pair: tuple[float, float]) -> str:
        return "{:.2f} +- {:.2f}".format(*pair) if np.isfinite(pair[0]) else "-"

    yield Column(f"{kind}, {part}", "", pair, read, key="")
    yield Column(f"{kind}_{part}", "", lambda row: pair(row)[0], shown=None)
    yield Column(f"{kind}_{part}_half", "", lambda row: pair(row)[1], shown=None)


def _words(row: Labelled) -> str:
    return effect_words(row[1].name)


COLUMNS: list[Column[Labelled]] = [
    Column("plan", "", lambda row: row[0], shown=None),
    Column("effect", "", lambda row: row[1].name, left=True),
    _cost("alone (deg)", "alone_deg", lambda c: c.alone_deg, ".3g"),
    _cost("", "alone_low_deg", lambda c: c.alone_interval_deg[0]),
    _cost("", "alone_high_deg", lambda c: c.alone_interval_deg[1]),
    _cost("saves (deg)", "saves_deg", lambda c: c.saves_deg, "+.3g"),
    _cost("from", "saves_low_deg", lambda c: c.saves_interval_deg[0], "+.2g"),
    _cost("to", "saves_high_deg", lambda c: c.saves_interval_deg[1], "+.2g"),
    *(
        column
        for kind in ("between", "switch")
        for part in ("first", "total")
        for column in _sobol(kind, part)
    ),
]


FIRST_ORDER = ("between_first", "switch_first")
"""Names of columns that a terminal has no room for."""


def budget_markdown(budgets: Mapping[str, Budget], command: str | None = None) -> str:
    """Return error budgets as Markdown, with one table per plan."""
    lines = ["# Error budget", ""]
    for label, budget in budgets.items():
        rows = [(label, cost) for cost in budget.costs]
        lines += [f"## {markdown_code(label)}", "", total(budget) + ".", ""]
        lines += [markdown_table(COLUMNS, rows), "", _idle_text(budget), ""]
    first = next(iter(budgets.values()))
    lines += [
        f"{first.samples} machines ({first.machine.preset}) per median; Sobol indices by Saltelli's"
        f" scheme from {first.base} base samples; seed {first.seed}.",
        "",
        CAPTION[0].upper() + CAPTION[1:],
    ]
    if command:
        lines += ["", provenance(clean_text(command))]
    return "\n".join(lines) + "\n"


def budget_csv(budgets: Mapping[str, Budget]) -> str:
    """Return error budgets as CSV, one line per plan and effect; undefined cells are empty."""
    rows = [(label, cost) for label, budget in budgets.items() for cost in budget.costs]
    return csv_table(COLUMNS, rows)


def total(budget: Budget) -> str:
    """Return in words a budget's median error E with its interval, and E without any effect."""
    low, high = (number(x) for x in budget.E_interval_deg)
    none = _degrees(budget.none_deg, ".3g")
    way = " with feedback" if budget.feedback else ""
    return f"median E{way} {number(budget.E_deg)} deg ({low} to {high}), {none} without any effect"


def _idle_text(budget: Budget) -> str:
    names = ", ".join(budget.idle)
    return f"Switched on, but without influence here: {names}." if names else ""
