"""The plans of the paper's section 4.3, and valid plans that replace the plans that fail."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from planner.machine.machine import Machine
from planner.machine.replay import Replay, replay
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.solve import solve

TRAVEL = float(np.pi / 4)
"""Travel of the disk, rad, at which the paper's Figs 4 and 5 are reproduced; inferred from both."""

POINT = [5.0, -0.2]
"""The paper's constraint point (time in s, z₂)."""

Z2_MARGIN = 0.01
"""Least distance from z₂ = 0 in problems/paper.toml and problems/z2-limit.toml."""

DATA: dict[str, Any] = {
    "title": "the paper's example",
    "system": {"kind": "manipulator", "joints": 3, "K": [0.870125, 0.711625], "k_g": 0.668811},
    "start": {"theta_deg": [1.0, 1.0, 1.0]},
    "goal": {"theta_deg": [30.0, 30.0, 30.0], "travel": "free", "duration": 10.0},
}


@dataclass(frozen=True)
class Cases:
    """The plans of the paper's example.

    Attributes:
        free: Polynomial plan without a constraint point (the paper's Fig. 4).
        point: Polynomial plan with the constraint point (the paper's Fig. 5); not executable.
        valid: Polynomial plan inside the domain, at the travel with the least peak input.
        best: Plan of least effort with free travel.
        crossing: Plan of least effort at the travel of Figs. 4 and 5, on which z₂ changes sign.
        kept: Plan of least effort at the travel of Figs. 4 and 5 with z₂ ≤ −`Z2_MARGIN`.
        replay: Replay of `valid` on random machines like the emulated prototype.
    """

    free: Plan
    point: Plan
    valid: Plan
    best: Plan
    crossing: Plan
    kept: Plan
    replay: Replay


@cache
def paper_problem(**goal: Any) -> Problem:
    """Return the paper's example without limits; keywords change the `[goal]` table."""
    return Problem.from_dict({**DATA, "goal": {**DATA["goal"], **goal}}, "the paper's example")


def cases(samples: int, seed: int) -> Cases:
    """Make all plans and the replay that the paper's figures show."""
    printed = paper_problem(travel=TRAVEL)
    valid = solve(paper_problem(), "polynomial")
    return Cases(
        free=solve(printed, "polynomial", allow_singular=True),
        point=solve(printed, "polynomial", points=[POINT], allow_singular=True),
        valid=valid,
        best=solve(paper_problem(), "collocation"),
        crossing=solve(printed, "collocation"),
        kept=solve(printed.changed({"limits": {"z2_margin": Z2_MARGIN}}), "collocation"),
        replay=replay(valid, Machine.prototype(), samples=samples, seed=seed),
    )
