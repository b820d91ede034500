"""The best motion that a search holds at any time, for when it must end early.

A search finds motions in many places, and in most of them it does not choose its answer. So
whatever solves a task offers what it finds, and of that only motions of the problem in question,
which is the same object, are kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from planner.methods.collocation.between_nodes import clears
from planner.methods.collocation.long_arms.bridges import Chain
from planner.methods.collocation.long_arms.held import can_hold, chain_of, held
from planner.methods.collocation.solvers.solver import Solution
from planner.methods.collocation.task import Task, told
from planner.problem.problem import Problem
from planner.support import deadline, progress


class Best:
    """What a search holds.

    Attributes:
        motion: The best solution of the problem, and its task; None while there is none.
        kept: A motion found that is one to the accuracy asked for; likewise. Only looked for where
            time is limited, since it takes about a second.
        chain: A path that was not timed yet, and what it is asked for; likewise.
        nearest: Of what failed that which came closest to a path, and its task; likewise.
        iterations: Iterations of the solvers until now.
    """

    def __init__(self, problems: Sequence[Problem], accuracy: float) -> None:
        self._problems, self._accuracy = problems, accuracy
        self.kept: tuple[Task, Solution] | None = None
        self.motion: tuple[Task, Solution] | None = None
        self.chain: tuple[Task, Chain] | None = None
        self.nearest: tuple[Task, Solution] | None = None
        self.iterations = 0

    def holds(self) -> bool:
        """Whether there is anything of which a plan may come."""
        return self.motion is not None or self.chain is not None

    def take(self, task: Task, solution: Solution) -> None:
        """Keep a solution if it is better than what there is."""
        self.iterations += solution.iterations
        if not solution.ok:
            close = self.nearest is None or solution.residual < self.nearest[1].residual
            if close and task.problem.system is self._problems[0].system:
                self.nearest = task, solution
            return
        better = self.motion is None or solution.objective < self.motion[1].objective
        if better and self._asked(task) and clears(task, solution):
            self.motion = task, solution
            kind = task.objective.name.partition(":")[0]
            progress.found(f"{solution.objective:.4g} ({kind})")
            if self.kept is None and deadline.remaining() < math.inf:
                self.keep()

    def keep(self) -> None:
        """Make what is held a motion to the accuracy asked for, where that needs no solver."""
        of = self.chain
        if self.motion is not None:
            of = self.motion[0], chain_of(*self.motion)
        found = held(*of, self._accuracy) if of is not None and can_hold(of[0]) else None
        if found and (self.kept is None or found[1].objective < self.kept[1].objective):
            self.kept = found

    def take_chain(self, task: Task, chain: Chain) -> None:
        """Keep a path."""
        if self._asked(task):
            self.chain = task, chain
            if self.kept is None and deadline.remaining() < math.inf:
                self.keep()

    def _asked(self, task: Task) -> bool:
        return any(task.problem is problem for problem in self._problems)


@contextmanager
def holding(problems: Sequence[Problem], accuracy: float) -> Iterator[Best]:
    """Keep the best motion of these problems, which differ in the order of waypoints only."""
    best = Best(problems, accuracy)
    with told(best):
        yield best
