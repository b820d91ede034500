"""Section 3.2 of the paper for a problem: is the system controllable where the problem is?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.controllability import Controllability, controllability
from planner.errors import InputError
from planner.problem import Problem
from planner.recursion import PaperRecursion, paper_recursion
from planner.systems.base import Array, TriangularSystem
from planner.systems.manipulator import Manipulator

DEEPEST = 8
"""Greatest bracket length examined here; `planner.controllability` goes as deep as it is told."""

RECURSION_JOINTS = 6
"""Most joints for which the paper's recursion is examined: a second; with each more eight times."""


@dataclass(frozen=True)
class Place:
    """A configuration and what was found there; `finding` is None where the kinematics end."""

    name: str
    finding: Controllability | None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form."""
        found = None if self.finding is None else self.finding.to_dict()
        return {"at": self.name, "controllability": found}

    def __str__(self) -> str:
        if self.finding is None:
            return "the kinematics are infinite here"
        f = self.finding
        growth = ", ".join(str(g) for g in f.growth)
        frobenius = "involutive: holonomic" if f.involutive else "not involutive: nonholonomic"
        chow = "controllable" if f.chow else f"not shown up to bracket length {f.depth}"
        return f"growth vector ({growth}), N = {f.size}; Frobenius: {frobenius}; Chow: {chow}"


@dataclass(frozen=True)
class Nonholonomy:
    """What `nonholonomy` finds.

    Attributes:
        places: Start, goal, and for the manipulator the start with θ₁ = 0.
        recursion: The paper's recursion (12)–(15) at the start; None for other systems and arms of
            more than six joints.
    """

    places: tuple[Place, ...]
    recursion: PaperRecursion | None

    @property
    def recursion_verdict(self) -> str:
        """Where the recursion fails, in one line."""
        if self.recursion is None:
            return ""
        failing = [str(i) for i, holds in enumerate(self.recursion.printed_holds, 1) if not holds]
        zeros = [str(i) for i in self.recursion.corrected.divides_by_zero]
        text = f"as printed fails at step {', '.join(failing)}" if failing else "as printed holds"
        corrected = (
            f"divides by zero at step {', '.join(zeros)}"
            if zeros
            else "holds here, and divides by zero where a theta is 0"
        )
        return f"{text} (it belongs to a sine law); corrected for cos^3 it {corrected}"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready form."""
        verdict = self.recursion_verdict or None
        return {"places": [p.to_dict() for p in self.places], "paper_recursion": verdict}


def nonholonomy(problem: Problem) -> Nonholonomy:
    """Examine start, goal and, for the manipulator, what happens on θ₁ = 0."""
    start, goal = problem.start, np.where(np.isnan(problem.goal), problem.start, problem.goal)
    places = [_place(problem.system, "start", start), _place(problem.system, "goal", goal)]
    recursion = None
    if isinstance(problem.system, Manipulator):
        straight = start.copy()
        straight[1] = 0.0
        places.append(_place(problem.system, "start with theta1 = 0", straight))
        if problem.system.n <= RECURSION_JOINTS:
            recursion = paper_recursion(problem.system, start)
    return Nonholonomy(tuple(places), recursion)


def _place(system: TriangularSystem, name: str, q: Array) -> Place:
    try:
        return Place(name, controllability(system, q, _depth(system, q)))
    except InputError:
        return Place(name, None)


def _depth(system: TriangularSystem, q: Array) -> int | None:
    """As deep as full rank needs, unless that could be very deep."""
    angles = q[1:-1]
    flat = int(np.sum(np.abs(angles) < 1e-12))
    return DEEPEST if system.size - 1 + flat > DEEPEST else None
