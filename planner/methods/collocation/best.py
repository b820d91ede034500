"""Candidates for a plan, a store of the best that a search has found so far, and refinement.

Refining gives a mesh that is fine enough for the true motion and for the objective, and limits kept
between the nodes (`polish`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np

from planner.methods.collocation.between_nodes import (
    INTERPOLANT,
    SAVING,
    Inspection,
    clears,
    inspect,
)
from planner.methods.collocation.long_arms.exact_motion import (
    chain_of,
    exact_motion,
    has_only_limits,
)
from planner.methods.collocation.task import Solution, Task, transfer
from planner.methods.collocation.transcription.form import Mesh
from planner.support import deadline, progress
from planner.support.deadline import TimeUpError, time_share
from planner.verification.verify import LIMIT_TOLERANCE

SHORT_OF_TIME_S = 30.0
"""Remaining time, s, below which a search makes each motion exact as soon as it is found."""


EVENNESS = 0.35
"""Least density of a refined mesh, relative to its greatest."""

LARGEST_ERROR = 1e-4
"""Largest accepted difference at the end, rad, of the true motion from the interpolant."""

LARGEST_MESH, TIGHTENING_TRIES = 2000, 6

REFINING_SHARE = 0.6
"""Share of the remaining time for refinement; then the best result so far is used."""

SIDE_SHARE = 0.01
"""Share of the greatest excess by which a limit is tightened where it holds: motions shift."""


class Exactness(IntEnum):
    """Rank of a candidate by how much of its task is known to hold."""

    FAILED = 0
    """Some rows of the programme are broken."""
    SOLVED = 1
    """All rows of the programme hold at the points of the mesh."""
    ACCEPTED = 2
    """The true motion ends near the goal and keeps limits between the nodes, as `verify` asks."""
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


class Record:
    """What a search has found so far: the best candidates, and facts for a refusal.

    Args:
        accuracy: Required accuracy of exact motions, see `exact_motion`; None if the motions are no
            answers: no candidate is then kept.

    Attributes:
        candidates: The best candidate of each exactness that has been reached.
        log: One entry per start, JSON-ready.
        fastest: The fastest motion found, refined, if all are too slow for the given duration.
        pathless: Whether no guess leads to a path that clears all discs.
        last: The last failed candidate.
    """

    def __init__(self, accuracy: float | None) -> None:
        self._accuracy = accuracy
        self.candidates: dict[Exactness, Candidate] = {}
        self.log: list[dict[str, Any]] = []
        self.fastest: Candidate | None = None
        self.pathless = True
        self.last: Candidate | None = None

    def holds(self) -> bool:
        """Return whether a plan can be made from a candidate found so far."""
        return bool(self.candidates.keys() - {Exactness.FAILED})

    def note(self, motion: Candidate) -> Candidate:
        """Return a motion after noting it in the log."""
        solution = motion.solution
        entry = {"start": motion.start, "status": solution.status}
        self.log.append({**entry, "objective": solution.objective})
        return motion

    def take(self, candidate: Candidate) -> Candidate:
        """Return a candidate; keep it, in case time is up, if it is the best of its exactness.

        A candidate that is only solved must also clear all discs between the nodes. If little time
        is left, such a candidate is made exact at once.
        """
        exactness, solved = candidate.exactness, candidate.exactness is Exactness.SOLVED
        rival = self.candidates.get(exactness)
        worse = rival is not None and not candidate.rank > rival.rank
        if self._accuracy is None or worse:
            return candidate
        if solved and not clears(candidate.task, candidate.solution):
            return candidate
        self.candidates[exactness] = candidate
        if solved:
            kind = candidate.task.objective.kind
            progress.tell(best=f"{kind} {candidate.solution.objective:.4g}")
            if Exactness.EXACT not in self.candidates and deadline.remaining() < SHORT_OF_TIME_S:
                self.make_exact()
        return candidate

    def make_exact(self) -> None:
        """Make the best solved candidate exact, in about 1 s, if its task `has_only_limits`."""
        best = self.candidates.get(Exactness.SOLVED)
        if self._accuracy is None or best is None or not has_only_limits(best.task):
            return
        chain = chain_of(best.task, best.solution)
        if motion := exact_motion(best.task, chain, self._accuracy):
            task, solution = motion
            self.take(replace(best, task=task, solution=solution, checked=Exactness.EXACT))


def polish(candidate: Candidate, accuracy: float, refinements: int) -> Candidate:
    """Refine a candidate's mesh, then tighten limits where needed.

    The mesh is fine enough when the simulated end is accurate and the objective has settled: a
    finer mesh would save at most the share `SAVING` of it, by estimate or by the last refinement.
    Tightened limits move the motion, which may then need a finer mesh; so both steps are repeated
    until neither changes anything or the refinements are used up.

    If time is up, the present result is turned into an exact motion, if that is possible, by
    `planner.methods.collocation.long_arms.exact_motion`.
    """
    now, left = inspect(candidate.task, candidate.solution), refinements
    meshes, rounds = [len(now.task.mesh.widths)], 0
    try:
        with time_share(REFINING_SHARE):
            while True:
                for finer in _finer_motions(now, accuracy, left):
                    now, left = finer, left - 1
                    meshes.append(len(now.task.mesh.widths))
                if not now.fine(accuracy):  # further rounds would not help
                    left = 0
                    if refinements > 0 and (exact := _exact_path(now, accuracy)):
                        now = exact
                        meshes.append(len(now.task.mesh.widths))
                rounds = 0
                for rounds, tighter in _tighter_motions(now):  # noqa: B007
                    now = tighter
                if left == 0 or now.fine(accuracy):
                    break
    except TimeUpError:
        with suppress(TimeUpError):
            now = _exact_path(now, accuracy) or now
        meshes.append(len(now.task.mesh.widths))
    parts = [part for requirement in now.task.requirements for part in requirement.parts]
    scales = np.array([part.scale for part in parts])
    inside = bool((now.excess <= LIMIT_TOLERANCE * scales).all())
    most = zip(parts, now.task.inset.max(axis=0).tolist(), strict=True)
    inset = {"rounds": rounds, **{part.label: amount for part, amount in most if amount}}
    inner = now.task.nlp.form.inner
    checked = Exactness.SOLVED
    if inside and now.end_error <= LARGEST_ERROR:
        whole = now.fine(accuracy) and not now.excess.any()
        checked = Exactness.EXACT if whole else Exactness.ACCEPTED
    notes = {
        "resimulated_end_error": now.end_error,
        "intervals": meshes,
        "limits_inside": inner,
        "limits_drawn_in": inset,
    }
    return replace(candidate, task=now.task, solution=now.solution, checked=checked, notes=notes)


def _finer_motions(now: Inspection, accuracy: float, most: int) -> Iterator[Inspection]:
    """Yield the motion on finer and finer meshes until one is fine enough or has no solution.

    Joints with lost motion depend on the mesh, so it is not refined for the objective alone.
    """
    settled = now.task.nlp.form.follower is not None
    for _ in range(most):
        settled = settled or bool(np.sum(now.savings) <= SAVING)
        if settled and now.fine(accuracy):
            return
        progress.tell("refining the mesh")
        finer = _add_build_time(now.task, now.task.on_mesh(_finer_mesh(now, accuracy)))
        start = transfer(now.task, now.solution.iterate, finer)
        solution = finer.solve(start, near=True)
        if not (solution.ok and clears(finer, solution)):
            return
        before, now = now.solution.objective, inspect(finer, solution)
        settled = abs(before - solution.objective) <= SAVING * abs(solution.objective)
        yield now


def _tighter_motions(now: Inspection) -> Iterator[tuple[int, Inspection]]:
    """Yield the motion with limits kept between the nodes too, and the number of tightenings.

    First the limits are kept at the collocation points. Then they are tightened by the remaining
    excess: at first only a little elsewhere, then everywhere equally. The motion may move by less
    than a limit is tightened, so the excess counts twice in the second round and three times in the
    third. If a round has no solution, or only one through a disc, the previous motion is returned
    with the task of that round.
    """
    rounds = 0
    for _ in range(TIGHTENING_TRIES):
        if not now.excess.any():
            return
        progress.tell("keeping limits between the nodes")
        if not now.task.nlp.form.inner:
            tighter = _add_build_time(now.task, now.task.with_inner_rows())
        else:
            rounds += 1
            excess, share = rounds * now.excess, SIDE_SHARE if rounds == 1 else 1.0
            more = np.maximum(excess, share * np.max(excess, axis=0))
            tighter = replace(now.task, inset=now.task.inset + more)
        start = now.solution.iterate
        solution = tighter.solve_near(start)
        good = solution.ok and clears(tighter, solution)
        now = inspect(tighter, solution) if good else replace(now, task=tighter)
        yield rounds, now
        if not good:
            return


def _exact_path(now: Inspection, accuracy: float) -> Inspection | None:
    """Turn the path into an exact motion without optimising it; None if that is not possible."""
    if not has_only_limits(now.task):
        return None
    motion = exact_motion(now.task, chain_of(now.task, now.solution), accuracy)
    return None if motion is None else inspect(_add_build_time(now.task, motion[0]), motion[1])


def _add_build_time(before: Task, task: Task) -> Task:
    """Return the task with the build time of the previous one added."""
    return replace(task, build_time_s=before.build_time_s + task.build_time_s)


def _finer_mesh(now: Inspection, accuracy: float) -> Mesh:
    """Return a mesh whose density follows the errors, with at most three times as many intervals.

    The error of an interval is the difference of the interpolant from the true motion started at
    the interval's left node. With degree d it decreases with the width to the power d + 1 inside
    the interval, and at the nodes, where the errors of all intervals add up, to the power 2d - 1.
    The errors at the nodes are weighted by their growth until the end: up to ten thousand when
    trailers are pushed, and at least the growth of a random sum. The solution on the new mesh may
    move where the present one rests, so no interval is much wider than the others.
    """
    task, d, widths = now.task, now.task.nlp.form.degree, now.task.mesh.widths
    if now.fine(accuracy):
        return _split_at_kinks(now)
    errors = np.abs(task.motion_apart(now.solution.iterate) - now.curves[0]).max(axis=2)
    nodes = errors[:, -1]
    growth = max(np.sqrt(len(widths)), now.end_error / max(np.max(nodes), 1e-16))
    at_nodes = (nodes * growth / accuracy) ** (1 / (2 * d - 1))
    inside = (errors.max(axis=1) / (INTERPOLANT * accuracy)) ** (1 / (d + 1))
    density = np.maximum(at_nodes, inside) / widths
    density = np.maximum(density, EVENNESS * np.max(density))
    wanted = int(np.ceil(1.1 * np.sum(density * widths)))
    count = min(max(wanted, len(widths) * 5 // 4), 3 * len(widths), LARGEST_MESH)
    covered = np.concatenate([[0.0], np.cumsum(density * widths)])
    edges = np.interp(np.linspace(0, covered[-1], count + 1), covered, task.mesh.edges)
    edges[0], edges[-1] = 0.0, 1.0
    return task.mesh.snap(edges)


def _split_at_kinks(now: Inspection) -> Mesh:
    """Split intervals at costly kinks of the inputs; a kink's cost falls with the width cubed."""
    edges, widths = now.task.mesh.edges, now.task.mesh.widths
    parts = np.ceil(np.maximum(1.0, (now.savings * len(widths) / SAVING) ** (1 / 3)))
    places = [
        np.linspace(a, b, int(n) + 1)[1:]
        for a, b, n in zip(edges[:-1], edges[1:], parts, strict=True)
    ]
    return now.task.mesh.snap(np.append(0.0, np.concatenate(places)))
