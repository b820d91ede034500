"""First guesses for collocation that are other methods' plans: the polynomial law and the convex
planner, where a one-way motion exists. Neither has to keep the problem's limits: a path is enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.errors import InputError, NoPlanError
from planner.methods import METHODS
from planner.ocp.guess import Seed
from planner.plan import Plan
from planner.problem import Problem
from planner.reachability import travel_window
from planner.schema.methods import ConvexOptions, PolynomialOptions
from planner.systems.base import Array

PIECES, SCAN = 20, 5
"""Pieces of the convex plan and travels tried: a guess need not be optimal."""

NAMES = ("polynomial", "convex")


def planned_seeds(problem: Problem, kind: str) -> list[Seed]:
    """Seeds along the plans of other methods: of one kind, or both for "auto"; none where there is
    no one-way motion, since both laws live in one branch of the chart.
    """
    window = travel_window(problem)
    if window is None or window.empty:
        return []
    if problem.travel is not None and problem.travel not in window:
        return []
    wanted = NAMES if kind == "auto" else (kind,)
    return [_seed(name, problem) for name in NAMES if name in wanted]


def _seed(name: str, problem: Problem) -> Seed:
    """A seed that is planned when its guess is asked for, and not before."""
    kept: list[Plan | None] = []

    def states(s: Array) -> Array | None:
        if not kept:
            kept.append(_path(name, problem))
        plan = kept[0]
        return None if plan is None else plan.q(s * plan.duration)

    return Seed(name, np.zeros_like, np.zeros_like, states)


def _path(name: str, problem: Problem) -> Plan | None:
    """The other method's path from start to goal, or its last iterate; None if it has neither."""
    free = np.full(2, np.inf)
    limits = replace(problem.limits, input=free, input_rate=free)
    easy = replace(problem, limits=limits, duration=problem.duration or 10.0)
    try:
        if name == "polynomial":
            return METHODS["polynomial"].plan(easy, PolynomialOptions())
        from planner.methods.convex import planned_convex  # slow to import, and seldom needed

        return planned_convex(easy, ConvexOptions(pieces=PIECES, scan=SCAN))
    except NoPlanError as error:
        usable = error.plan is not None and error.plan.executable
        return error.plan if usable else None
    except InputError:
        return None
