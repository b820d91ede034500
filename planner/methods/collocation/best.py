"""Candidates for a plan, and a store of the best that a search has found so far."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    has_only_limits,
)
from planner.methods.collocation.task import Solution, Task
from planner.support import deadline, progress

SHORT_OF_TIME_S = 30.0
"""With less time left than this, s, a motion is made exact as soon as it is found."""


class Exactness(IntEnum):
    """How much of a candidate's task is known to hold; the values are ranks."""

    FAILED = 0
    """Some rows are broken."""
    SOLVED = 1
    """All rows hold at the points of the mesh."""
    ACCEPTED = 2
    """The true motion ends near the goal, and limits hold between the nodes to `verify`'s
    tolerance."""
    EXACT = 3
    """The true motion has the required accuracy, and no limit is broken between the nodes."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A solution with its task and origin.

    Attributes:
        task: The task that it solves.
        solution: The solution.
        start: Name of the first guess.
        stage: Name of the stage that found it.
        route: Index of the variant of the problem (order of waypoints, branch of the goal).
        final: Whether it is an answer of its stage, not an intermediate result.
        checked: Its exactness if the solution is ok.
        notes: Facts of its refinement, JSON-ready.
    """

    task: Task
    solution: Solution
    start: str = ""
    stage: str = ""
    route: int = 0
    final: bool = True
    checked: Exactness = Exactness.SOLVED
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def exactness(self) -> Exactness:
        """How much of the task holds."""
        return self.checked if self.solution.ok else Exactness.FAILED

    @property
    def rank(self) -> tuple[int, float]:
        """Order among candidates, the best last: by exactness, then objective (or residual)."""
        solution = self.solution
        return self.exactness, -(solution.objective if solution.ok else solution.residual)


class Best:
    """The best candidates that a search holds at any time.

    Args:
        accuracy: Required accuracy of exact motions, see `exact_motion`.

    Attributes:
        candidates: The best candidate of each exactness, if there is one.
    """

    def __init__(self, accuracy: float) -> None:
        self._accuracy = accuracy
        self.candidates: dict[Exactness, Candidate] = {}

    @property
    def motions(self) -> list[Candidate]:
        """The candidates from which a plan may be made."""
        return [each for each in self.candidates.values() if each.solution.ok]

    def holds(self) -> bool:
        """Return whether any candidate can become a plan."""
        return bool(self.motions)

    def take(self, candidate: Candidate) -> None:
        """Keep a candidate if it is the best of its exactness.

        A candidate that is only solved must also clear all discs between the nodes. It is made
        exact at once if little time is left.
        """
        exactness, solved = candidate.exactness, candidate.exactness is Exactness.SOLVED
        rival = self.candidates.get(exactness)
        worse = rival is not None and not candidate.rank > rival.rank
        if worse or (solved and not clears(candidate.task, candidate.solution)):
            return
        self.candidates[exactness] = candidate
        if solved:
            kind = candidate.task.objective.name.partition(":")[0]
            progress.report_motion(f"{kind} {candidate.solution.objective:.4g}")
            if Exactness.EXACT not in self.candidates and deadline.remaining() < SHORT_OF_TIME_S:
                self.make_exact()

    def make_exact(self) -> None:
        """Make the best solution exact, in about 1 s, if its task limits only joints and inputs."""
        best = self.candidates.get(Exactness.SOLVED)
        if best is None or not has_only_limits(best.task):
            return
        chain = chain_of(best.task, best.solution)
        if motion := exact_motion(best.task, chain, self._accuracy):
            task, solution = motion
            self.take(replace(best, task=task, solution=solution, checked=Exactness.EXACT))
