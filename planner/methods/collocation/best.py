"""The best results of a search so far, for the case that it must end early."""

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
"""With less time left than this, s, a motion is made exact as soon as it is found."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A solution with its task and origin. If `solution.ok` is false, it is not a motion.

    Attributes:
        start: Name of the first guess.
        stage: Name of the stage that found it.
        task: The task that it solves.
        solution: The solution.
        route: Number of its order of waypoints or branch of the goal.
        final: Whether it is an answer of its stage, not an intermediate result.
    """

    start: str
    stage: str
    task: Task
    solution: Solution
    route: int = 0
    final: bool = True


class Best:
    """The best results of a search at any time, each with its task; None if there is none.

    Attributes:
        motion: The best solution.
        exact: A motion of the required accuracy. It is computed only if little time is left, since
            it takes about a second.
        chain: A path that was not timed yet.
        nearest: The failed solution with the least residual.
    """

    def __init__(self, accuracy: float) -> None:
        self._accuracy = accuracy
        self.exact: tuple[Task, Solution] | None = None
        self.motion: tuple[Task, Solution] | None = None
        self.chain: tuple[Task, PieceChain] | None = None
        self.nearest: tuple[Task, Solution] | None = None

    def holds(self) -> bool:
        """Whether there is a result from which a plan may be made."""
        return self.motion is not None or self.chain is not None

    def keeps(self, solution: Solution) -> bool:
        """Whether this is the best solution so far."""
        return self.motion is not None and self.motion[1] is solution

    def take(self, task: Task, solution: Solution) -> None:
        """Keep a solution, which may have failed, if it is the best so far."""
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
        """Make the best result a motion of the required accuracy, if that needs no solver."""
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
