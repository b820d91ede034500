"""What to change in a problem that no method solved: a few changes, each of them tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.deadline import check
from planner.errors import InputError, NoPlanError
from planner.problem import Problem
from planner.solve import solve_and_check
from planner.spec import toml
from planner.summary import plan_summary, refusal_summary

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Remedy:
    """A change that was tried and gave a verified plan.

    Attributes:
        changes: Dotted keys to values, as `Problem.changed` takes them.
        method: The method that then has a plan.
        plan: Summary of that plan, see `planner.summary.KEYS`.
    """

    changes: dict[str, Any]
    method: str
    plan: dict[str, Any]

    def __str__(self) -> str:
        freed = "goal.duration" in self.changes
        took = f", which takes {self.plan['duration_s']:.4g} s" if freed else ""
        keys = _written(self.changes)
        return f"{keys}: the method '{self.method}' then has a verified plan{took} (tried)"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form (NaN where undefined)."""
        return {"changes": self.changes, "method": self.method, "plan": self.plan}


def attempt(problem: Problem, name: str) -> dict[str, Any]:
    """Try one method; its summary either way, see `planner.summary.KEYS`."""
    try:
        return plan_summary(*solve_and_check(problem, name))
    except NoPlanError as error:
        return refusal_summary(error, name)
    except InputError as error:  # the method's own demands on the problem
        return refusal_summary(NoPlanError(str(error)), name) | {"status": "bad_input"}


def find_remedy(problem: Problem, names: Sequence[str], say: Progress) -> Remedy | None:
    """The first of a few changes that gives a verified plan.

    Raises:
        TimeUpError: If time was up before one was found.
    """
    for changes in _changes(problem):
        say(f"trying {_written(changes)}")
        for name in sorted(names, key=lambda n: n != "collocation"):  # the most able first
            check()
            outcome = attempt(problem.changed(changes), name)
            if outcome["verified"]:
                return Remedy(changes, name, outcome)
    return None


def _changes(problem: Problem) -> list[dict[str, Any]]:
    duration: dict[str, Any] = {"goal.duration": "free"}
    travel = problem.travel_change(None)
    timed = problem.duration is not None and bool(np.any(np.isfinite(problem.limits.input)))
    if any(point.time_s is not None for point in problem.waypoints):
        timed = False  # their times would lose their meaning
    out = [duration] * timed + [travel] * (problem.travel is not None)
    if len(out) == 2:
        out.append({**duration, **travel})
    if problem.limits.z2_margin:
        out.append({"limits.z2_margin": 0.0})
    for key in ("waypoints", "obstacles"):
        if getattr(problem, key):
            out.append({key: []})
    return out


def _written(changes: Mapping[str, Any]) -> str:
    return " and ".join(f"{key} = {toml(value)}" for key, value in changes.items())
