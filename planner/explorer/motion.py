"""The controls of the motion itself: method, travel, duration, constraint points."""

from __future__ import annotations

import numpy as np

from planner.explorer.control import Control, rounded
from planner.explorer.ranges import travel_range, z2_reach
from planner.explorer.state import State
from planner.methods import METHODS
from planner.plan import Plan
from planner.problem import Problem

GROUP = "Motion"
POINTS = "method.polynomial.points"


def motion_controls(state: State, problem: Problem, plan: Plan | None) -> list[Control]:
    """Method, travel and duration, and for the polynomial its constraint points."""
    found = [_method(state), _travel(state, problem, plan), _duration(state, plan)]
    return found + (_points(state, problem, plan) if state.method == "polynomial" else [])


def _method(state: State) -> Control:
    return Control(
        GROUP,
        "method",
        "choice",
        "method",
        state.method,
        shown=state.method,
        choices=list(METHODS),
        help=METHODS[state.method].summary,
    )


def _travel(state: State, problem: Problem, plan: Plan | None) -> Control:
    key = problem.travel_key
    whole = state.value(key, "free")
    low, high, middle = travel_range(state.base)
    travel = middle if plan is None else plan.travel
    shown = float(problem.travel_change(travel)[key]) if whole == "free" else whole
    ends = [float(problem.travel_change(end)[key]) for end in (low, high)]
    coordinate = problem.system.coordinates[0]
    label = "travel" if key.endswith("travel") else key.rsplit(".", 1)[-1].replace("_m", "")
    return Control(
        GROUP,
        label,
        "slider",
        key,
        whole,
        shown=shown,
        low=ends[0],
        high=ends[1],
        unit=coordinate.unit,
        on=whole != "free",
        off="free",
        off_word="free",
        help=f"change of {coordinate.name} from start to end",
    )


def _duration(state: State, plan: Plan | None) -> Control:
    whole = state.value("goal.duration", 10.0)
    usual = 10.0 if state.base.duration is None else state.base.duration
    shown = whole if whole != "free" else usual if plan is None else plan.duration
    low, high = usual / 10, usual * 4
    return Control(
        GROUP,
        "duration",
        "slider",
        "goal.duration",
        whole,
        shown=shown,
        low=low,
        high=high,
        log=True,
        unit="s",
        on=whole != "free",
        off="free",
        off_word="free",
        help="seconds from start to end",
    )


def _points(state: State, problem: Problem, plan: Plan | None) -> list[Control]:
    whole = state.value(POINTS, [])
    words = ["none", "one", "two", "auto"]
    duration = problem.duration or (10.0 if plan is None else plan.duration)
    count = 3 if whole == "auto" else min(len(whole), 2)
    found = [
        Control(
            GROUP,
            "constraint points",
            "choice",
            POINTS,
            whole,
            shown=words[count],
            choices=words,
            writes=[[], _new_points(1, duration, plan), _new_points(2, duration, plan), "auto"],
            help="times at which z2 must have a given value, eq. (28); drag them in the picture",
        )
    ]
    if whole == "auto":
        return found
    reach = z2_reach(state.base)
    for k, point in enumerate(whole):
        name = f"point {k + 1}" if len(whole) > 1 else "point"
        ends = ("time", 0.01 * duration, 0.99 * duration, "s"), ("z2", -reach, reach, "")
        for part, (what, low, high, unit) in enumerate(ends):
            label, ends_of = f"{name}: {what}", (point[part], rounded(low), rounded(high))
            found.append(
                Control(GROUP, label, "slider", POINTS, whole, (k, part), *ends_of, unit=unit)
            )
    return found


def _new_points(count: int, duration: float, plan: Plan | None) -> list[list[float]]:
    """Points on the present path, so that adding one does not move it."""
    times = duration * np.arange(1, count + 1) / (count + 1)
    values = np.zeros(count) if plan is None else plan.z(times)[:, 1]
    return [[rounded(float(t)), rounded(float(z))] for t, z in zip(times, values, strict=True)]
