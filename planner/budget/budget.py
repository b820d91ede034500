"""The error budget of a plan: effects one at a time, all but one, and by their Sobol indices.

*Alone*: E with this effect and no other. *Saves*: by how much E falls when this effect alone is
switched off. They differ where effects need or hide each other: friction winds up a soft shaft, and
alone does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.budget.sobol import Index, between_machines, check, on_or_off
from planner.errors import InputError
from planner.jsonable import jsonable
from planner.machine import Draws, Machine
from planner.machine.draw import draw
from planner.machine.simulate import simulate_draws
from planner.plan import Plan
from planner.replay import SETTLE_S, refuse_inexecutable, sample_numbers
from planner.significance import percentile_interval
from planner.systems.base import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of all work that is done, 0 … 1."""

Interval = tuple[float, float]

SCREENED = 16
"""Machines on which an effect must change something to be looked at further."""


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
        idle: Effects that are on and changed nothing on the first machines.
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
        from planner.report.budget import rich_table

        return rich_table(self)

    def figure(self) -> Figure:
        """Costs and indices as bars."""
        from planner.report.budget import plot_budget

        return plot_budget(self)[0]


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
        whole = self._errors(self._machine)
        none = self._errors(self._machine.only())
        active, idle = self._screened(whole, none)
        alone, without = {}, {}
        for k, name in enumerate(active):
            self._tell(f"{name} alone and off", 0.1 + 0.3 * k / len(active))
            alone[name] = self._errors(self._machine.only(name))
            without[name] = self._errors(self._machine.without(name))
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

    def _screened(self, whole: Array, none: Array) -> tuple[list[str], list[str]]:
        """Effects that change something on the first few machines, and those that do not."""
        self._tell("looking for effects without influence", 0.0)
        few, names = min(self._samples, SCREENED), list(self._machine.effects)
        idle = [
            name
            for name in names
            if np.array_equal(self._errors(self._machine.without(name), few), whole[:few])
            and np.array_equal(self._errors(self._machine.only(name), few), none[:few])
        ]
        return [name for name in names if name not in idle], idle

    def _indices(self, active: Sequence[str]) -> tuple[dict[str, Index], dict[str, Index]]:
        rest = (self._joints, self._given, self._base, self._seed)
        self._tell("Sobol indices between machines", 0.4)
        between = between_machines(self._machine, active, *rest)
        self._tell("Sobol indices of effects on or off", 0.6)
        switch = on_or_off(self._machine, active, *rest)
        self._tell("done", 1.0)
        return between, switch

    def _errors(self, machine: Machine, count: int | None = None) -> Array:
        """E of the first samples, (S,); machines that are all alike are simulated once."""
        count = self._samples if count is None else count
        vary = any(quantity.varies for quantity in machine.effects.values())
        numbers = np.arange(count if vary else 1)
        E = self._given(machine, draw(machine, self._joints, numbers, self._seed))
        return np.asarray(np.broadcast_to(E, count))

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
