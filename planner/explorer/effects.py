"""The controls of the emulated machine: how many, and each of its effects."""

from __future__ import annotations

from planner.explorer.control import Control, rounded
from planner.explorer.limits import UNITS
from planner.explorer.state import State
from planner.machine import Machine
from planner.problem import Problem
from planner.schema import MachineTable
from planner.schema.effect import Effect
from planner.schema.machine import EFFECTS

GROUP = "Machine"


def machine_controls(state: State, problem: Problem) -> list[Control]:
    """The number of machines, then one control for each effect that the machine started with.

    Effects that act in dynamic fidelity alone are left out in the quasi-static one.
    """
    count = Control(
        GROUP, "machines", "slider", "samples", state.samples, shown=state.samples, high=200,
        integer=True, help="samples of the machine that the plan is replayed on; 0: none",
    )  # fmt: skip
    first = Machine.from_table(state.base.machine)
    now = Machine.from_table(problem.machine)
    used = {**first.effects, **now.effects}
    static = now.fidelity == "quasi-static"
    effects = [k for k, e in EFFECTS.items() if k in used and not (static and e.dynamic)]
    return [count, *(_effect(name, first, now) for name in effects)]


def _effect(name: str, first: Machine, now: Machine) -> Control:
    usual = (first if name in first.effects else now).effects[name].to_setting()
    on = name in now.effects
    whole = now.effects[name].to_setting() if on else usual
    effect = EFFECTS[name]
    part: tuple[str, ...] = ()
    if isinstance(usual, dict):  # what has a mean of zero only varies from machine to machine
        part = ("spread",) if usual["value"] == 0 else ("value",)
    number = usual[part[0]] if part else usual
    label, help_text = _label(name, part), MachineTable.model_fields[name].description or ""
    key = f"machine.{name}"
    if isinstance(number, list):
        return Control(
            GROUP, label, "choice", key, whole, shown="on" if on else "off",
            choices=["on", "off"], writes=[usual, False], help=help_text,
        )  # fmt: skip
    shown = whole[part[0]] if part else whole
    low, high = _ends(effect, float(number), spread=part == ("spread",))
    return Control(
        GROUP,
        label,
        "slider",
        key,
        whole,
        part,
        shown,
        low,
        high,
        unit=effect.unit,
        on=on,
        off=False,
        off_word="off",
        help=help_text,
    )


def _label(name: str, part: tuple[str, ...]) -> str:
    for ending in (*UNITS, "_s", "_per_nm", "_nm_per_rad", "_nms_per_rad", "_nm"):
        if name.endswith(ending):
            name = name.removesuffix(ending)
            break
    return name.replace("_", " ") + (" (spread)" if part == ("spread",) else "")


def _ends(effect: Effect, usual: float, *, spread: bool) -> tuple[float, float]:
    """From (almost) nothing to three times the usual value."""
    low = 0.1 * usual if effect.positive and not spread else 0.0
    high = 3 * usual
    return rounded(low, 3), rounded(high if spread else min(high, effect.high), 3)
