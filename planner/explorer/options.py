"""The controls of the method's options (objective, weights, mesh), from its option table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args, get_origin

from planner.explorer.control import Control, span
from planner.explorer.state import State
from planner.methods import METHODS
from planner.plan import Plan

GROUP = "Method"

RANGES: Mapping[str, tuple[float, float]] = {
    "intervals": (5, 120),
    "degree": (1, 5),
    "starts": (1, 6),
    "attempts": (1, 24),
    "pieces": (10, 200),
    "slots": (1, 20),
    "amplitude": (-1.5, 1.5),
    "passive": (0.0, 10.0),
    "terminal": (0.0, 10.0),
    "path": (0.0, 10.0),
    "backoff": (0.0, 4.0),
}
"""Ends of sliders; other positive numbers get a logarithmic slider about their default."""

HIDDEN = frozenset(
    [
        *("points", "travel", "offset", "shares"),
        *("allow_singular", "scan", "edge", "solver", "tolerance", "accuracy", "refinements"),
        *("max_iterations", "variations", "max_cuts", "max_steps"),
        *("gain", "bias", "delay_s", "stretch", "start_deg", "start_m", "gear"),
    ]
)
"""No slider is for these: they are set elsewhere on the screen, or say how hard a solver tries."""


def option_controls(state: State, plan: Plan | None) -> list[Control]:
    """One control an option of the present method."""
    table = METHODS[state.method].options
    found = []
    for name, field in table.model_fields.items():
        if name in HIDDEN:
            continue
        key = f"method.{state.method}.{name}"
        default = field.get_default(call_default_factory=True)
        whole = state.value(key, default)
        control = _control(name, key, whole, default, field.annotation, plan)
        if control is not None:
            found.append(_explained(control, field.description or ""))
    return found


def _control(
    name: str, key: str, whole: Any, default: Any, annotation: Any, plan: Plan | None
) -> Control | None:
    label = name.replace("_", " ")
    if annotation is bool:
        return Control(GROUP, label, "switch", key, whole, shown=bool(whole))
    if get_origin(annotation) is Literal:
        words = list(get_args(annotation))
        return Control(GROUP, label, "choice", key, whole, shown=whole, choices=words)
    number = whole if isinstance(whole, int | float) else _noted(plan, name)
    plain = isinstance(default, int | float)
    if isinstance(whole, list) or not (plain or name in RANGES):
        return None
    off = {} if plain else {"on": whole != default, "off": default, "off_word": default or "auto"}
    log = name not in RANGES and default > 0
    low, high = RANGES.get(name) or (span(float(default)) if log else (0.0, 1.0))
    integer = isinstance(low, int)
    shown = low if number is None else number
    return Control(
        GROUP, label, "slider", key, whole, (), shown, low, high, log=log, integer=integer, **off
    )


def _noted(plan: Plan | None, name: str) -> float | None:
    """The value that the method chose by itself, from the notes of its plan."""
    noted = None if plan is None else plan.notes.get(name)
    return float(noted) if isinstance(noted, int | float) else None


def _explained(control: Control, text: str) -> Control:
    return replace(control, help=text)
