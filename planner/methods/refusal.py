"""What a method says where it has no plan: changes of what was asked, as data.

A method that refuses names them; it tries none. `planner.methods.advice` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.problem.problem import Problem
from planner.problem.reach import Reach
from planner.support.files import toml


@dataclass(frozen=True)
class Change:
    """Something else to ask for where a method has no plan.

    Attributes:
        keys: Dotted keys of the problem file to values, as `Problem.changed` takes them.
        words: What to say instead of the keys; after a method, what follows its name.
        without: The requirement left out, in words; it is blamed where the change leads to a plan.
        method: Another method to use, or "" for the same.
        defaults: Whether options given to the method are left out.
    """

    keys: Mapping[str, Any] = field(default_factory=dict)
    words: str = ""
    without: str = ""
    method: str = ""
    defaults: bool = False

    def __str__(self) -> str:
        if self.method and not self.keys:
            return f"use the method '{self.method}'{self.words}"
        return self.words or " and ".join(f"{key} = {toml(v)}" for key, v in self.keys.items())


BY_COLLOCATION = Change(method="collocation", words=", which plans in joint coordinates")


def lasting(seconds: float) -> Change:
    """The change to another duration, rounded up."""
    return Change({"goal.duration": float(least(seconds))}, f"goal.duration = {least(seconds)}")


def free_travel(problem: Problem, without: str = "") -> list[Change]:
    """The travel left free, where it is given."""
    return [Change(problem.travel_change(None), without=without)][: problem.travel is not None]


def within_reach(problem: Problem, reach: Reach) -> list[Change]:
    """The tip at the nearest place within reach, where no joints' angles meet the goal."""
    tip, keys = problem.tip, dict[str, Any]()
    if tip is None or reach.branches or reach.blocked:
        return []
    if tip.place is not None:
        keys["goal.tip_m"] = [float(f"{x:.4g}") for x in reach.tip[:2]]
    if tip.angle is not None:
        keys["goal.tip_angle_deg"] = float(f"{np.rad2deg(reach.tip[2]):.4g}")
    return [Change(keys)]


def in_other_time(problem: Problem) -> list[Change]:
    """A free duration, a free travel, and both; of those that are given."""
    free = free_travel(problem)
    timed = any(point.time_s is not None for point in problem.waypoints)
    if (
        problem.duration is None
        or timed
        or not any(required.speed for required in problem.requirements)
    ):
        return free
    duration = Change({"goal.duration": "free"})
    return [duration, *free, *(Change({**duration.keys, **each.keys}) for each in free)]


def on_other_paths(problem: Problem) -> list[Change]:
    """One requirement on the path left out after the other, but for the travel."""
    limits, out = problem.to_dict().get("limits", {}), dict[str, Change]()
    for demand in reversed(problem.demands):
        if found := demand.without(limits):
            keys, words, what = found
            out[what] = Change(keys, words, what)
    return list(out.values())


def least(value: float) -> str:
    """A number rounded up to four digits or so."""
    scale = 10.0 ** (3 - int(np.floor(np.log10(value))))
    return f"{np.ceil(value * scale) / scale:.10g}"
