"""How each parameter of the emulated machine affects the end of a plan, by paired differences.

A machine with play, stiction and limits is not smooth, so it cannot be differentiated. Instead, the
plan is replayed on pairs of machines with one parameter a step above and a step below its nominal
value; the difference of the motions is divided by that of the values. The step is the spread of the
parameter, if it has one. All machines run in one replay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from planner.machine.machine import Machine, draw, machine_for
from planner.machine.replay import SETTLE_S
from planner.machine.simulate import simulate
from planner.plan.plan import Plan, refuse_inexecutable
from planner.problem.tables.machine_effects import EFFECTS, Effect, effect_words
from planner.support.arrays import Array, Frozen
from planner.support.package import Figure, Table, draw_figure
from planner.support.tables import Column, number, terminal_table
from planner.systems.triangular_system import TriangularSystem

RELATIVE_STEP = 0.05
"""Step of a parameter without spread, relative to its value."""

STEPS: Mapping[str, float] = {
    "": 0.01,
    "s": 0.005,
    "rad/s": 0.001,
    "deg": 0.1,
    "N m": 0.02,
    "1/(N m)": 0.002,
    "N m s/rad": 0.01,
    "kg m^2": 1e-4,
}
"""Step of a parameter whose value is zero, by its unit."""

GRID_PARAMETERS = ("control_period_s", "delay_s")
"""Parameters that define the time grid, which all machines of a replay share."""

RECORDS = 200
WRITE_STRIDE = 5
"""Every fifth recorded time is written to files."""

MAX_PARAMETERS = 12
"""Most parameters in the table; those with the largest response are shown."""

NO_EFFECT_DEG = 1e-9
"""Change of the angles between two machines, in degrees, below which a parameter has no effect."""


@dataclass(frozen=True, eq=False)
class MachineEntry(Frozen):
    """Response of a plan to one parameter of the machine.

    Attributes:
        effect: Key of the `[machine]` table.
        element: Motor or joint of the parameter ("u1", "theta2"); empty for the whole machine.
        unit: Unit of the parameter; empty for fractions.
        value: Nominal value.
        spread: Standard deviation from machine to machine.
        low: Value of the machine with the lower value.
        high: Value of the machine with the higher value.
        along: Response of each angle per unit, at the recorded times, shape (R, n), degrees.
    """

    effect: str
    element: str
    unit: str
    value: float
    spread: float
    low: float
    high: float
    along: Array

    @property
    def name(self) -> str:
        """Name of the parameter: the effect and its element."""
        return f"{self.effect} {self.element}".strip()

    @property
    def terminal(self) -> Array:
        """Response of each angle at the end per unit of the parameter, shape (n,), degrees."""
        return np.asarray(self.along[-1])

    @property
    def reference(self) -> float:
        """Change of the parameter in tables: `spread`, or (`high` − `low`)/2 without a spread."""
        return self.spread or (self.high - self.low) / 2

    @property
    def contribution(self) -> Array:
        """Response of each angle at the end to a change by `reference`, shape (n,), degrees."""
        return self.terminal * self.reference

    @property
    def has_no_effect(self) -> bool:
        """Whether the response is zero at all times."""
        return bool(np.max(np.abs(self.along)) * (self.high - self.low) < NO_EFFECT_DEG)


@dataclass(frozen=True, eq=False)
class MachineSensitivity(Frozen):
    """Response of one plan to each parameter of a machine.

    Attributes:
        plan: The plan.
        machine: The machine; steps start from its nominal values.
        angles: Names of the n angles.
        t: Recorded times, shape (R,), s; at the last one the servos have settled.
        nominal_error_deg: Error of each angle at the end on the nominal machine, shape (n,).
        entries: The responses, in the order of the signal path.
        omitted: Parameters without a response, and why.
    """

    plan: Plan
    machine: Machine
    angles: tuple[str, ...]
    t: Array
    nominal_error_deg: Array
    entries: tuple[MachineEntry, ...]
    omitted: Mapping[str, str]

    def __repr__(self) -> str:
        return (
            f"MachineSensitivity({self.plan.method} plan, {len(self.entries)} parameters: one"
            f" spread of each {self.total_deg:.4g} deg at the end)"
        )

    @property
    def matrix(self) -> Array:
        """Response of each angle at the end per unit of each parameter, shape (n, P), degrees."""
        return np.stack([e.terminal for e in self.entries], axis=1)

    @property
    def total_deg(self) -> float:
        """Root sum of squares of all angles' responses to one spread of each parameter, degrees."""
        return float(np.sqrt(sum(np.sum((e.terminal * e.spread) ** 2) for e in self.entries)))

    @property
    def loudest(self) -> list[MachineEntry]:
        """Parameters that have an effect, sorted by decreasing response."""
        loud = [e for e in self.entries if not e.has_no_effect]
        return sorted(loud, key=lambda e: -float(np.max(np.abs(e.contribution))))

    def table(self) -> Table:
        """Return the largest responses as a table for a terminal, for `rich.print`."""
        columns: list[Column[MachineEntry]] = [
            Column("machine", "", entry_name, left=True),
            Column("change", "", lambda e: f"{number(e.reference, 4)} {e.unit}".rstrip()),
            *(Column(a, "deg", partial(_contribution, k)) for k, a in enumerate(self.angles)),
        ]
        rest = len(self.loudest) - MAX_PARAMETERS
        more = f"; {rest} smaller ones are in files and JSON" if rest > 0 else ""
        nominal = ", ".join(f"{error:.3g}" for error in self.nominal_error_deg)
        caption = (
            f"Nominal machine: errors {nominal} deg; one spread of each parameter: total"
            f" {number(self.total_deg, 4)} deg{more}. {len(self.entries) - len(self.loudest)}"
            " parameters have no effect on this motion. Switched off (the machine has no such"
            f" effect): {', '.join(self.omitted) or 'none'}."
        )
        loud = self.loudest[:MAX_PARAMETERS]
        return terminal_table(columns, loud, caption=caption, ruled=True, gap=1)

    def plot(self) -> Figure:
        """Draw the largest responses with `planner.report.plot_machine_sensitivity`."""
        return draw_figure("robustness.plot_machine_sensitivity", self)

    def to_dict(self) -> dict[str, Any]:
        """Return the sensitivities as JSON-ready data."""
        return {
            "angles": list(self.angles),
            "nominal_error_deg": self.nominal_error_deg.tolist(),
            "total_deg": self.total_deg,
            "t_s": self.t[::WRITE_STRIDE].tolist(),
            "parameters": [
                {
                    **{key: value for key, value in vars(e).items() if key != "along"},
                    "response_deg_per_unit": dict(zip(self.angles, e.terminal, strict=True)),
                    "reference": e.reference,
                    "response_deg": dict(zip(self.angles, e.contribution, strict=True)),
                    "without_effect": e.has_no_effect,
                    "along_deg_per_unit": e.along[::WRITE_STRIDE].tolist(),
                }
                for e in self.entries
            ],
            "omitted": dict(self.omitted),
        }


def entry_name(entry: MachineEntry) -> str:
    """Return the name of a machine's parameter in words."""
    return f"{effect_words(entry.effect)} {entry.element}".strip()


def _contribution(angle: int, entry: MachineEntry) -> str:
    value = entry.contribution[angle]
    return f"{value:.3g}" if abs(value) >= 5e-5 else ""


Step = tuple[MachineEntry, int]
"""A parameter before its response is computed, and its index among the effect's values."""


def machine_sensitivity(plan: Plan, machine: Machine | str | None = None) -> MachineSensitivity:
    """Compute paired differences of open-loop replays of a plan, one machine parameter at a time.

    Args:
        plan: Any executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.

    Raises:
        InputError: If the plan cannot be executed or the machine does not match the system.
    """
    refuse_inexecutable(plan)
    distribution = machine_for(plan.problem.machine, machine)
    system = plan.problem.system
    steps = [step for k, e in EFFECTS.items() for step in _steps(distribution, system, k, e)]
    stepped = {entry.effect for entry, _ in steps}
    omitted = {k: "off, so it has no value to vary" for k in EFFECTS if k not in stepped}
    t, nominal, pairs = _motions(plan, distribution, steps)
    angles = [i for i, c in enumerate(system.coordinates) if i and c.unit == "rad"]
    entries = [
        replace(entry, along=np.rad2deg(up - down)[:, angles] / (entry.high - entry.low))
        for (entry, _), (up, down) in zip(steps, pairs, strict=True)
    ]
    error = np.rad2deg(nominal[-1] - plan.q(plan.duration))[angles]
    names = tuple(system.coordinates[i].name for i in angles)
    return MachineSensitivity(plan, distribution, names, t, error, tuple(entries), omitted)


def _steps(machine: Machine, system: TriangularSystem, name: str, effect: Effect) -> Iterator[Step]:
    """Yield a step for each value of an effect (of a motor or joint) that can be varied."""
    on = machine.effects.get(name)
    if on is None and not (np.isfinite(effect.off_value) and not effect.positive):
        return
    joints = system.size - 1
    count = effect.count(joints)
    values = np.broadcast_to(machine.mean(name, joints), count)
    spreads = np.broadcast_to(machine.spread(name, joints), count)
    for i, (value, spread) in enumerate(zip(values, spreads, strict=True)):
        size = spread or (RELATIVE_STEP * abs(value) if value else STEPS.get(effect.unit, 0.01))
        low, high = max(value - size, effect.low), min(value + size, effect.high)
        if effect.positive:
            low = max(low, value / 2)
        element, none = _element(system, effect, i), np.empty(0)
        yield MachineEntry(name, element, effect.unit, value, float(spread), low, high, none), i


def _element(system: TriangularSystem, effect: Effect, i: int) -> str:
    if effect.owner == "machine":
        return ""
    if effect.owner == "motor":
        return system.inputs[i].name
    return system.coordinates[i + (1 if effect.owner == "joint" else 2)].name


def _motions(
    plan: Plan, machine: Machine, steps: list[Step]
) -> tuple[Array, Array, list[tuple[Array, Array]]]:
    """Return recorded times (R,), the nominal motion (R, N), and two motions for each step.

    The two motions, (R, N) each, are those with the high and with the low value.
    """
    nominal, joints = machine.nominal(), plan.problem.system.size - 1
    record = plan.duration / RECORDS
    together = [step for step in steps if step[0].effect not in GRID_PARAMETERS]
    count = 1 + 2 * len(together)
    base = draw(nominal, joints, np.arange(count), 0)
    values = {name: value.copy() for name, value in base.values.items()}
    for place, (entry, index) in enumerate(together):
        effect = EFFECTS[entry.effect]
        if entry.effect not in values:
            values[entry.effect] = np.full((effect.count(joints), count), effect.off_value)
        values[entry.effect][index, 1 + 2 * place : 3 + 2 * place] = entry.high, entry.low
    run = simulate(plan, nominal, replace(base, values=values), settle_s=SETTLE_S, record_s=record)

    def alone(entry: MachineEntry, value: float) -> Array:
        other = nominal.with_(**{entry.effect: value})
        one = draw(other, joints, np.arange(1), 0)
        return np.asarray(simulate(plan, other, one, settle_s=SETTLE_S, record_s=record).q[0])

    pairs = zip(run.q[1::2], run.q[2::2], strict=True)
    both = [
        (alone(entry, entry.high), alone(entry, entry.low))
        if entry.effect in GRID_PARAMETERS
        else next(pairs)
        for entry, _ in steps
    ]
    return run.t, run.q[0], both
