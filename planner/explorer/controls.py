"""The controls of the explorer: motion, machine, limits, and options of the method.

Controls of the motion set method, travel, duration and constraint points; those of the machine set
the number of random machines and each effect. There is a control for each limit of this kind of
problem and for each option of the current method (objective, weights, mesh).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from planner.explorer.control import (
    Control,
    key_words,
    log_range,
    round_digits,
    travel_range,
    z2_reach,
)
from planner.explorer.state import State
from planner.machine.feedforward.legs import compensable
from planner.machine.machine import Machine
from planner.methods.registry import METHODS
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.kinds import parse_file
from planner.problem.tables.machine_effects import EFFECTS, MachineTable, StartState
from planner.problem.tables.method_options import NO_SLIDER, Slider

GOAL_TITLE = "Goal"
METHOD_TITLE = "Method"
TASK_KEYS = ("system.", "start.", "goal.theta", "goal.heading", "goal.q")
"""Beginnings of keys that determine which travels are possible."""

POINTS_KEY = "method.polynomial.points"


def motion_controls(state: State, problem: Problem, plan: Plan | None) -> list[Control]:
    """Return the controls of travel, duration, method and the polynomial's constraint points."""
    method = Control(
        METHOD_TITLE, "method", "choice", "method", state.method, shown=state.method,
        choices=list(METHODS), help=METHODS[state.method].summary,
    )  # fmt: skip
    controls = [_duration(state, plan), method]
    if problem.travel_key:
        controls.insert(0, _travel(state, problem, plan))
    return controls + (_points(state, problem, plan) if state.method == "polynomial" else [])


def _travel(state: State, problem: Problem, plan: Plan | None) -> Control:
    key = problem.travel_key
    whole = state.value(key, "free")
    is_fixed = any(key.startswith(TASK_KEYS) and key != problem.travel_key for key in state.changes)
    low, high, middle = travel_range(problem if is_fixed else state.base)
    travel = middle if plan is None else plan.travel
    position = float(problem.travel_change(travel)[key]) if whole == "free" else whole
    low, high = (float(problem.travel_change(end)[key]) for end in (low, high))
    coordinate = problem.system.coordinates[0]
    label = "travel" if key.endswith("travel") else key_words(key.rsplit(".", 1)[-1])[0]
    words = f"change of {coordinate.name} from start to end"
    return _free_slider(label, key, whole, position, low, high, unit=coordinate.unit, help=words)


def _duration(state: State, plan: Plan | None) -> Control:
    whole = state.value("goal.duration", 10.0)
    usual = 10.0 if state.base.duration is None else state.base.duration
    position = whole if whole != "free" else usual if plan is None else plan.duration
    low, high = usual / 10, usual * 4
    return _free_slider(
        "duration", "goal.duration", whole, position, low, high,
        log=True, unit="s", help="seconds from start to end",
    )  # fmt: skip


def _free_slider(
    label: str, key: str, whole: Any, shown: float, low: float, high: float, **about: Any
) -> Control:
    """Return a slider that can be switched off, which sets its key to "free"."""
    free: dict[str, Any] = {"on": whole != "free", "off": "free", "off_word": "free"}
    return Control(GOAL_TITLE, label, "slider", key, whole, (), shown, low, high, **free, **about)


def _points(state: State, problem: Problem, plan: Plan | None) -> list[Control]:
    whole = state.value(POINTS_KEY, [])
    words = ["none", "one", "two", "auto"]
    duration = problem.duration or (10.0 if plan is None else plan.duration)
    count = 3 if whole == "auto" else min(len(whole), 2)
    controls = [Control(
        METHOD_TITLE, "constraint points", "choice", POINTS_KEY, whole,
        shown=words[count], choices=words,
        writes=[[], _new_points(1, duration, plan), _new_points(2, duration, plan), "auto"],
        help="times at which z2 must have a given value, eq. (28); drag them in the picture",
    )]  # fmt: skip
    if whole == "auto":
        return controls
    reach = z2_reach(state.base)
    for k, point in enumerate(whole):
        name = f"point {k + 1}" if len(whole) > 1 else "point"
        ends = ("time", 0.01 * duration, 0.99 * duration, "s"), ("z2", -reach, reach, "")
        for part, (what, low, high, unit) in enumerate(ends):
            label, ends_of = f"{name}: {what}", (point[part], round_digits(low), round_digits(high))
            place = (POINTS_KEY, whole, (k, part), *ends_of)
            controls.append(Control(METHOD_TITLE, label, "slider", *place, unit=unit))
    return controls


def _new_points(count: int, duration: float, plan: Plan | None) -> list[list[float]]:
    """Return constraint points [t, z₂] on the current path, which therefore stays the same."""
    times = duration * np.arange(1, count + 1) / (count + 1)
    values = np.zeros(count) if plan is None else plan.z(times)[:, 1]
    return [
        [round_digits(float(t)), round_digits(float(z))] for t, z in zip(times, values, strict=True)
    ]


MACHINE_TITLE = "Machine"


def machine_controls(state: State, problem: Problem) -> list[Control]:
    """Return the controls of the number of machines and of each effect of the machine.

    Effects that act only with dynamic fidelity are left out if the machine is quasi-static.
    """
    count = Control(
        MACHINE_TITLE, "machines", "slider", "samples", state.samples, shown=state.samples,
        high=200, integer=True,
        help="number of random machines on which to replay the plan; 0: none",
    )  # fmt: skip
    first = Machine.from_table(state.base.machine)
    now = Machine.from_table(problem.machine)
    active = {**first.effects, **now.effects}
    static = now.fidelity == "quasi-static"
    names = [k for k, e in EFFECTS.items() if k in active and not (static and e.dynamic_only)]
    settings = {name: State(state.base).value(f"machine.{name}") for name in names}
    of_mechanism = [_compensation(state), _start_state(now)] if compensable(problem.system) else []
    feedback = Control(
        MACHINE_TITLE, "with feedback", "switch", "feedback", state.feedback, shown=state.feedback,
        help="follow the plan with feedback by the tracker, on every machine",
    )  # fmt: skip
    effects = (_effect(name, first, now, settings[name]) for name in names)
    return [count, feedback, *of_mechanism, *effects]


def _start_state(machine: Machine) -> Control:
    """Return the choice of `start_state`, the state of backlash and shafts before the start."""
    words, help_text = get_args(StartState), MachineTable.model_fields["start_state"].description
    states = list(machine.start_state)
    own = [] if len(set(states)) == 1 and states[0] in words else ["joint by joint"]
    now = own[0] if own else states[0]
    return Control(
        MACHINE_TITLE, "before the start", "choice", "machine.start_state", now, shown=now,
        choices=[*words, *own], writes=[*words, states], help=help_text or "",
    )  # fmt: skip


def _compensation(state: State) -> Control:
    """Return the switch that compensates plans for the machine."""
    key = "compensation.on"
    is_on = bool(state.value(key, False))
    help_text = (
        "compensate the plan's commands for the mean machine's backlash, torsion, creep and lag"
    )
    label = "compensate for the machine"
    return Control(MACHINE_TITLE, label, "switch", key, is_on, shown=is_on, help=help_text)


def _effect(name: str, first: Machine, now: Machine, setting: Any) -> Control:
    """Return the control of a machine effect.

    Args:
        name: The effect.
        first: The machine of the initial problem.
        now: The machine on the screen.
        setting: The effect's value in the file of the initial problem.
    """
    usual = (first if name in first.effects else now).effects[name].to_setting()
    is_on = name in now.effects
    whole = now.effects[name].to_setting() if is_on else usual
    effect = EFFECTS[name]
    part: tuple[str, ...] = ()
    if isinstance(usual, dict):  # with a mean of zero only the spread matters
        part = ("spread",) if usual["value"] == 0 else ("value",)
    number, is_spread = usual[part[0]] if part else usual, part == ("spread",)
    words, unit = key_words(name)
    per = " under load" if unit == "1/(N m)" else ""  # the same word exists without load
    label = f"{words}{per}{' (spread)' if is_spread else ''}"
    key, help_text = f"machine.{name}", MachineTable.model_fields[name].description or ""
    if isinstance(number, list):
        return Control(
            MACHINE_TITLE, label, "choice", key, whole, shown="on" if is_on else "off",
            choices=["on", "off"], writes=[setting, False], help=help_text,
        )  # fmt: skip
    position = whole[part[0]] if part else whole
    low = 0.1 * number if effect.positive and not is_spread else 0.0
    high = 3 * number if is_spread else min(3 * number, effect.high)
    return Control(
        MACHINE_TITLE, label, "slider", key, whole, part, position,
        round_digits(low, 3), round_digits(high, 3),
        unit=effect.unit, on=is_on, off=False, off_word="off", help=help_text,
    )  # fmt: skip


LIMITS_TITLE = "Limits"

USUAL_LIMITS: Mapping[str, float] = {"deg": 80.0, "": 0.01, "m": 0.02}
"""First value, by unit, of a limit that the user switches on and the problem lacks; else 1."""


def limit_controls(state: State, problem: Problem) -> list[Control]:
    """Return a slider per limit, or per coordinate or input where the limit is a list."""
    table = parse_file(state.base.to_dict(), state.base.source).limits
    controls = []
    for name, field in type(table).model_fields.items():
        key = f"limits.{name}"
        whole = state.value(key)
        if isinstance(whole, Mapping):
            continue
        label, unit = key_words(name)
        about = {"help": field.description or "", "unit": unit}
        start = State(state.base).value(key, USUAL_LIMITS.get(unit, 1.0))
        if not isinstance(whole, list):
            position = _first(start) if whole is None else whole
            off = {"on": whole is not None, "off": None, "off_word": "none"}
            controls.append(_slider(label, key, whole, (), position, _first(start), **about, **off))
            continue
        limited = problem.system.coordinates[1:]
        if key in (*problem.limits.input_keys, *problem.limits.rate_keys):
            limited = problem.system.inputs
        for k, value in enumerate(whole):
            usual = start[k] if isinstance(start, list) and len(start) == len(whole) else value
            words = f"{label} {limited[k].name}"
            controls.append(_slider(words, key, whole, (k,), value, usual, **about))
    return controls


def _slider(
    label: str, key: str, whole: Any, part: tuple[int, ...], shown: float, usual: float, **rest: Any
) -> Control:
    if rest["unit"] == "deg":
        ends, log = (1.0, max(89.0, usual)), False
    else:
        ends, log = log_range(usual), True
    return Control(LIMITS_TITLE, label, "slider", key, whole, part, shown, *ends, log=log, **rest)


def _first(value: Any) -> float:
    return float(value[0] if isinstance(value, list) else value)


SOLVER_TITLE = "Solver"


def option_controls(state: State, plan: Plan | None) -> list[Control]:
    """Return one control per option of the current method."""
    table = METHODS[state.method].options
    controls = []
    for name, field in table.model_fields.items():
        key = f"method.{state.method}.{name}"
        default = field.get_default(call_default_factory=True)
        control = _control(name, key, state.value(key, default), default, field, plan)
        if control is not None:
            controls.append(replace(control, help=field.description or ""))
    return controls


def _control(
    name: str, key: str, whole: Any, default: Any, field: FieldInfo, plan: Plan | None
) -> Control | None:
    label, annotation = name.replace("_", " "), field.annotation
    ends = next((each for each in field.metadata if isinstance(each, Slider)), None)
    if ends is NO_SLIDER:
        return None
    if annotation is bool or bool in get_args(annotation):  # or "auto"
        return Control(SOLVER_TITLE, label, "switch", key, whole, shown=whole is True)
    if get_origin(annotation) is Literal:
        words = list(get_args(annotation))
        return Control(SOLVER_TITLE, label, "choice", key, whole, shown=whole, choices=words)
    chosen = None if plan is None else plan.notes.get(name)  # what the method chose
    number = next((v for v in (whole, chosen) if isinstance(v, int | float)), None)
    plain = isinstance(default, int | float)
    if isinstance(whole, list) or not (plain or ends):
        return None
    off = {} if plain else {"on": whole != default, "off": default, "off_word": default or "auto"}
    log = ends is None and default > 0
    usual = log_range(float(default)) if log else (0.0, 1.0)
    low, high = usual if ends is None else (ends.low, ends.high)
    position = low if number is None else number
    return Control(
        SOLVER_TITLE, label, "slider", key, whole, (), position, low, high,
        log=log, integer=isinstance(low, int), **off,
    )  # fmt: skip
