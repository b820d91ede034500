"""Candidates for a plan, and a store of the best candidates that a search has found so far."""

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
"""Remaining time, s, below which a search makes each motion exact as soon as it is found."""


class Exactness(IntEnum):
    """Rank of a candidate by how much of its task is known to hold."""

    FAILED = 0
    """Some rows of the programme are broken."""
    SOLVED = 1
    """All rows of the programme hold at the points of the mesh."""
    ACCEPTED = 2
    """The true motion ends near the goal, and limits hold between the nodes to `verify`'s
    tolerance."""
    EXACT = 3
    """The true motion has the required accuracy, and no limit is broken between the nodes."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A solution with its task and its origin in the search.

    Attributes:
        task: The task that is solved.
        solution: The solution.
        start: Name of the first guess.
        stage: Name of the stage that found the solution.
        route: Index of the variant of the problem (order of waypoints, branch of the goal).
        checked: Exactness of the candidate if the solution is ok.
        notes: Facts of the refinement, JSON-ready.
    """

    task: Task
    solution: Solution
    start: str = ""
    stage: str = ""
    route: int = 0
    checked: Exactness = Exactness.SOLVED
    notes: dict[str, Any] = field(default_factory=dict)

    @property
    def exactness(self) -> Exactness:
        """Exactness of the candidate: how much of its task holds."""
        return self.checked if self.solution.ok else Exactness.FAILED

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key, greatest for the best candidate: exactness, then −objective (or −residual)."""
        solution = self.solution
        return self.exactness, -(solution.objective if solution.ok else solution.residual)


class Best:
    """The best candidates that a search has found so far.

    Args:
        accuracy: Required accuracy of exact motions, see `exact_motion`.

    Attributes:
        candidates: The best candidate of each exactness that has been reached.
    """

    def __init__(self, accuracy: float) -> None:
        self._accuracy = accuracy
        self.candidates: dict[Exactness, Candidate] = {}

    @property
    def motions(self) -> list[Candidate]:
        """Candidates that are motions, from which a plan may be made."""
        return [each for each in self.candidates.values() if each.solution.ok]

    def holds(self) -> bool:
        """Return whether a plan can be made from a candidate found so far."""
        return bool(self.motions)

    def take(self, candidate: Candidate) -> None:
        """Keep a candidate if it is the best of its exactness so far.

        A candidate that is only solved must also clear all discs between the nodes. If little time
        is left, such a candidate is made exact at once.
        """
        exactness, solved = candidate.exactness, candidate.exactness is Exactness.SOLVED
        rival = self.candidates.get(exactness)
        worse = rival is not None and not candidate.rank > rival.rank
        if worse or (solved and not clears(candidate.task, candidate.solution)):
            return
        self.candidates[exactness] = candidate
        if solved:
            kind = candidate.task.objective.kind
            progress.report_motion(f"{kind} {candidate.solution.objective:.4g}")
            if Exactness.EXACT not in self.candidates and deadline.remaining() < SHORT_OF_TIME_S:
                self.make_exact()

    def make_exact(self) -> None:
        """Make the best solved candidate exact, in about 1 s, if its task `has_only_limits`."""
        best = self.candidates.get(Exactness.SOLVED)
        if best is None or not has_only_limits(best.task):
            return
        chain = chain_of(best.task, best.solution)
        if motion := exact_motion(best.task, chain, self._accuracy):
            task, solution = motion
            self.take(replace(best, task=task, solution=solution, checked=Exactness.EXACT))
