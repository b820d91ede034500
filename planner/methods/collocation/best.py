"""What a search has found so far, and the best of it, for when the search must end early."""

from __future__ import annotations

from dataclasses import dataclass

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.long_arms.bridges import PieceChain
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    has_only_limits,
)
from planner.methods.collocation.task import Solution, Task
from planner.support import deadline, progress

SHORT_OF_TIME_S = 30.0
"""Seconds left below which a motion found is made exact at once, and not at the end."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A solution, the task it solves, and where it comes from; one that failed is no motion.

    Attributes:
        start: Name of the start it grew from.
        stage: Name of the stage that found it.
        task: What it solves.
        solution: The solution.
        route: Number of the order of waypoints, or branch of the goal, that it takes.
        final: Whether it is an answer of its stage, not only what the stage had on the way.
    """

    start: str
    stage: str
    task: Task
    solution: Solution
    route: int = 0
    final: bool = True


class Best:
    """What a search holds at any time.

    Attributes:
        motion: The best solution, and its task; None while there is none.
        exact: A motion found that is one to the accuracy asked for; likewise. Only looked for where
            little time is left, since it takes about a second.
        chain: A path that was not timed yet, and what it is asked for; likewise.
        nearest: Of what failed that which came closest to a path, and its task; likewise.
    """

    def __init__(self, accuracy: float) -> None:
        self._accuracy = accuracy
        self.exact: tuple[Task, Solution] | None = None
        self.motion: tuple[Task, Solution] | None = None
        self.chain: tuple[Task, PieceChain] | None = None
        self.nearest: tuple[Task, Solution] | None = None

    def holds(self) -> bool:
        """Whether there is anything of which a plan may come."""
        return self.motion is not None or self.chain is not None

    def keeps(self, solution: Solution) -> bool:
        """Whether this is the best solution held."""
        return self.motion is not None and self.motion[1] is solution

    def take(self, task: Task, solution: Solution) -> None:
        """Keep a solution, which may have failed, if it is better than what there is."""
        if not solution.ok:
            if self.nearest is None or solution.residual < self.nearest[1].residual:
                self.nearest = task, solution
            return
        better = self.motion is None or solution.objective < self.motion[1].objective
        if better and clears(task, solution):
            self.motion = task, solution
            kind = task.objective.name.partition(":")[0]
            progress.report_motion(f"{kind} {solution.objective:.4g}")
            self._make_exact_if_limited()

    def take_chain(self, task: Task, chain: PieceChain) -> None:
        """Keep a path within the joint limits that is not timed yet."""
        self.chain = task, chain
        self._make_exact_if_limited()

    def make_exact(self) -> None:
        """Make what is held a motion to the accuracy asked for, where that needs no solver."""
        path = self.chain
        if self.motion is not None:
            path = self.motion[0], chain_of(*self.motion)
        if path is None or not has_only_limits(path[0]):
            return
        found = exact_motion(*path, self._accuracy)
        if found and (self.exact is None or found[1].objective < self.exact[1].objective):
            self.exact = found

    def _make_exact_if_limited(self) -> None:
        if self.exact is None and deadline.remaining() < SHORT_OF_TIME_S:
            self.make_exact()
