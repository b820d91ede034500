"""A control on the screen: a slider, a choice, or a switch.

The ends of sliders depend on the problem. The controls of the system's constants, start and goal
are made from the tables of the problem file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from planner.explorer.state import JOINTS_KEY, State
from planner.problem.feasibility import travel_window
from planner.problem.problem import Problem
from planner.problem.tables.kinds import parse_file
from planner.report.figures.style import readable_name
from planner.support.arrays import plain
from planner.systems.chained_form import chained_form

Kind = Literal["slider", "choice", "switch"]


@dataclass(frozen=True)
class Control:
    """A slider, choice or switch, and the key of the problem file that it sets.

    Attributes:
        group: Heading of the control's group.
        label: Name on the screen.
        kind: "slider", "choice" or "switch".
        key: Dotted key of the problem file ("limits.joint_deg"), or "method", "samples" or
            "feedback".
        whole: Current value of the key; for a machine effect that is off, the value that the effect
            gets when switched on.
        part: Indices or keys that lead to this control's number in `whole`, if that is a list or
            table.
        shown: Number or word shown; for a slider that is off, its value once switched on.
        low: Smallest number of a slider.
        high: Largest number of a slider.
        log: Whether a slider is logarithmic.
        integer: Whether a slider has whole numbers only.
        unit: Unit of the number.
        on: Whether the control is switched on.
        off: The key's value when the slider is switched off ("free", None, False).
        off_word: The word shown for `off`; empty if the slider cannot be switched off.
        choices: The words of a choice.
        writes: The key's value for each of `choices`; by default the word itself.
        help: One line of explanation.
    """

    group: str
    label: str
    kind: Kind
    key: str
    whole: Any
    part: tuple[int | str, ...] = ()
    shown: Any = None
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    integer: bool = False
    unit: str = ""
    on: bool = True
    off: Any = None
    off_word: str = ""
    choices: Sequence[str] = ()
    writes: Sequence[Any] = ()
    help: str = ""

    @property
    def name(self) -> str:
        """Unique name of the control, which does not depend on its value."""
        return ":".join([self.key, *map(str, self.part)])

    def new_value(self, value: Any) -> Any:
        """Return the key's value after this control is set to `value` (None: switched off)."""
        if self.kind == "switch":
            return bool(value)
        if self.kind == "choice":
            return self.writes[self.choices.index(value)] if self.writes else value
        if value is None:
            return self.off
        number = round(float(value)) if self.integer else float(value)
        if not self.part:
            return number
        whole = plain(self.whole)
        inner = whole
        for step in self.part[:-1]:
            inner = inner[step]
        inner[self.part[-1]] = number
        return whole

    def to_dict(self) -> dict[str, Any]:
        """Return what the browser needs to draw the control."""
        skipped = {"key", "whole", "part", "off", "writes"}
        plain = {key: value for key, value in vars(self).items() if key not in skipped}
        return {**plain, "name": self.name, "choices": list(self.choices)}


def round_digits(value: float, digits: int = 6) -> float:
    """Round a number to `digits` significant digits."""
    return float(f"{value:.{digits}g}")


def log_range(value: float, factor: float = 10.0) -> tuple[float, float]:
    """Return the ends of a logarithmic slider around a value, rounded outwards to one digit."""
    low, high = (10.0 ** np.floor(np.log10(v)) for v in (value / factor, value * factor))
    return float(low), float(np.ceil(value * factor / high) * high)


def travel_range(problem: Problem) -> tuple[float, float, float]:
    """Return the smallest and the largest travel of the travel slider, and one in the middle."""
    window = travel_window(problem)
    travel = problem.travel
    if window is not None and not window.empty and np.isfinite(window.high):
        margin = 0.3 * (window.high - window.low)
        low, high = window.low - margin, window.high + margin
        middle = (window.low + window.high) / 2
    else:
        middle = 0.0 if travel is None else travel
        reach = max(1.0, abs(middle))
        low, high = middle - reach, middle + reach
    if travel is not None:
        low, high = min(low, travel), max(high, travel)
    return round_digits(low, 4), round_digits(high, 4), middle


def z2_reach(problem: Problem) -> float:
    """Return the largest z₂ of a slider: twice the larger |z₂| of start and goal, or 0.001."""
    form = chained_form(problem.system)
    ends = [form.z(np.nan_to_num(q))[1] for q in (problem.start, problem.goal)]
    return round_digits(max(1e-3, 2 * float(np.max(np.abs(ends)))), 2)


GROUPS = {"system": "System", "start": "Start", "goal": "Goal"}

MAX_JOINTS = 6
"""Most joints on the slider: planning with more joints is too slow for an interactive screen."""

ANGLE_ENDS: Mapping[str, float] = {
    "theta": 89.0,
    "steering": 80.0,
    "hitch": 120.0,
    "heading": 180.0,
}
"""Largest magnitude of angles on sliders, in degrees."""

UNITS = {
    "_nms_per_rad": "N m s/rad",
    "_nm_per_rad": "N m/rad",
    "_per_nm": "1/(N m)",
    "_kgm2": "kg m²",
    "_kgm": "kg m",
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_deg": "deg",
    "_rad": "rad",
    "_nm": "N m",
    "_m": "m",
    "_s": "s",
}
"""Units by the ending of a key; longer endings come first ("_rad_s" before "_s")."""


def key_words(key: str) -> tuple[str, str]:
    """Split a key into words and unit: "input_rate_rad_s2" gives ("input rate", "rad/s²")."""
    for ending, unit in UNITS.items():
        if key.endswith(ending):
            return key.removesuffix(ending).replace("_", " "), unit
    return key.replace("_", " "), ""


EXCLUDED_KEYS = frozenset({"phi_rad", "travel", "duration"})
"""Keys without a slider from `task_controls`: travel and duration have other controls, and phi_rad,
the first disk's initial angle, does not change the motion."""


OBSTACLES_KEY = "obstacles"

WHOLE_KEYS = (JOINTS_KEY, "goal.turns")
"""Keys whose values are whole numbers."""


def task_controls(state: State, travel_key: str) -> list[Control]:
    """Return a slider for each number in the problem's tables `system`, `start` and `goal`."""
    file, first = parse_file(state.base.to_dict(), state.base.source), State(state.base)
    controls: list[Control] = []
    for table, group in GROUPS.items():
        fields = getattr(file, table)
        about = {(f.alias or n): f.description or "" for n, f in type(fields).model_fields.items()}
        for name, base in fields.model_dump(by_alias=True).items():
            key = f"{table}.{name}"
            if name in EXCLUDED_KEYS or key == travel_key:
                continue
            if key == "system.link_lengths" and base is None:
                base = [1.0] * state.value(JOINTS_KEY)
            inner = base if isinstance(base, Mapping) else {"": base}
            for ending, usual in inner.items():
                if ending and isinstance(usual, list):
                    continue
                whole_key = f"{key}.{ending}".rstrip(".")
                now, usual = state.value(whole_key, usual), first.value(whole_key, usual)
                controls += _sliders(group, whole_key, now, usual, about[name])
    return controls + list(_obstacle_sliders(state))


def _obstacle_sliders(state: State) -> Iterator[Control]:
    """Yield sliders for the centre and radius of each obstacle, up to the arm's reach."""
    whole, reach = (
        state.value(OBSTACLES_KEY, []),
        sum(getattr(state.base.system, "link_lengths", ())),
    )
    for k, disc in enumerate(whole):
        places: list[tuple[str, tuple[int | str, ...], float, float]] = [
            ("x", (k, "centre_m", 0), disc["centre_m"][0], -reach),
            ("y", (k, "centre_m", 1), disc["centre_m"][1], -reach),
            ("radius", (k, "radius_m"), disc["radius_m"], reach / 100),
        ]
        for name, part, value, low in places:
            place = (OBSTACLES_KEY, whole, part, value, low, max(reach, value))
            yield Control("Obstacles", f"{name} {k + 1}", "slider", *place, unit="m")


def _sliders(group: str, key: str, now: Any, usual: Any, help_text: str) -> Iterator[Control]:
    """Yield a slider for a number, or for each number of a list; no slider for other values."""
    name, unit = key_words(key.rsplit(".", 1)[-1])
    listed = isinstance(now, list)
    for k, value in enumerate(now if listed else [now]):
        if isinstance(value, bool) or not isinstance(value, int | float):
            if listed and value == "free":
                continue
            return
        size = usual[min(k, len(usual) - 1)] if listed else usual
        size = abs(value if isinstance(size, str) else size)
        label = name if len(name) > 3 else name.replace(" ", "_")  # k_g, as in formulas
        if listed:  # a motor drives the first joint directly, so gears begin with K2
            number = k + (2 if name == "K" else 1)
            counted = f"{label.removesuffix('s')} {number}"
            names = {"theta": readable_name(f"theta{number}"), "K": readable_name(f"K{number}")}
            label = f"tip {'xy'[k]}" if name == "tip" else names.get(name, counted)
        if key == JOINTS_KEY:
            ends: tuple[float, float] = (2, max(MAX_JOINTS, value))
        elif group == GROUPS["system"]:
            ends = log_range(size, 3.0)
        else:
            reach = max(size, ANGLE_ENDS.get(name, 89.0) if unit == "deg" else max(1.0, 2 * size))
            ends = (-reach, reach)
        constant = group == GROUPS["system"] and key != JOINTS_KEY
        yield Control(
            group, label, "slider", key, now, (k,) if listed else (), value, *ends,
            log=constant, integer=key in WHOLE_KEYS, unit=unit, help=help_text,
        )  # fmt: skip
