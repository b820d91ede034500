"""Find the joint angles at a goal that leaves joints free, and how close the tip can come.

The Levenberg-Marquardt method solves the equations of the tip from many starting points at once,
with each joint inside its limits. A solution represents its branch: all solutions whose elbows bend
in the same directions. The search is not exhaustive, so a branch that is not found may exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.requirements.requirement import ROUNDING, MotionPoint
from planner.support.arrays import Array, Frozen

START_POINTS = 256
"""Number of starting points; with three joints at least twenty points lead to each branch."""

MOST_STEPS, LONGEST_STEP_RAD = 60, 0.5
"""Number of iterations, ten times what most points need; and largest step of a joint, rad."""

TIP_TOLERANCE = 1e-10
"""Error (rad, or relative to the reach) below which a goal is met; `verify` allows 2e-5."""

REFINED_POINTS = 4
"""Number of failed points from which the nearest reachable pose is searched."""

INWARD_SHARE = 0.02
"""Share by which joints at the nearest pose are moved towards the middle of their ranges. The
joints then keep off their limits, and a rounded position is still within reach."""


@dataclass(frozen=True, eq=False)
class Reach(Frozen):
    """Possible configurations at a goal that leaves joints free.

    Attributes:
        branches: Coordinates q(T) (N,) that meet the goal (NaN for the path coordinate): one
            solution for each combination of elbow directions, the nearest to the start first.
        blocked: Number of further branches, whose solutions violate a requirement.
        tip: The reachable tip pose nearest to the required one, shape (3,): x, y in metres and
            direction in radians; the required pose if there is a branch.
        missed_m: Distance of that tip from the required place, metres; None if none is required.
        missed_deg: Angle between that direction and the required one, degrees; None if none is
            required.
        reach: Sum of the links' lengths, metres.
    """

    branches: tuple[Array, ...]
    blocked: int
    tip: Array
    missed_m: float | None
    missed_deg: float | None
    reach: float

    @property
    def missed_words(self) -> str:
        """By how much the nearest pose misses the required one: "0.1 m and 3 deg"."""
        missed = {"m": self.missed_m, "deg": self.missed_deg}
        return " and ".join(f"{off:.3g} {unit}" for unit, off in missed.items() if off is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-ready data, with angles in degrees."""
        return {
            "branches_theta_deg": [np.rad2deg(q[1:]).tolist() for q in self.branches],
            "blocked_branches": self.blocked,
            "nearest_tip_m": self.tip[:2].tolist(),
            "nearest_tip_angle_deg": float(np.rad2deg(self.tip[2])),
            "missed_m": self.missed_m,
            "missed_deg": self.missed_deg,
            "reach_m": self.reach,
        }


def expected_goals(problem: Problem) -> list[Array]:
    """Return likely ends q(T) (N,) of a motion to a goal that leaves coordinates free.

    For an arm the ends are the branches of `goal_reach`, the nearest to the start first. Other
    systems have one end, at which free user coordinates keep their values at the start.
    """
    reach, system = goal_reach(problem), problem.system
    if reach is not None:
        return [*reach.branches]
    goal = problem.user_goal
    return [system.from_user(np.where(np.isnan(goal), system.user(problem.start), goal))]


def goal_reach(problem: AnyProblem) -> Reach | None:
    """Return the configurations in which a motion of an arm to the goal may end.

    Returns:
        The configurations; None if the goal gives every joint, or the system is not an arm.
    """
    problem = problem_of(problem)
    if not problem.free or problem.system.has_user_coordinates:
        return None
    theta = _goal_angles(problem)
    errors = _tip_errors(problem, theta)
    size = np.max(np.abs(errors), axis=1, initial=0.0)
    solved, arm = size < TIP_TOLERANCE, _arm(problem)
    q = np.column_stack([np.zeros(len(theta)), theta])
    allowed = solved & keeps_requirements(problem, q)
    branches = _nearest_by_branch(problem, theta[allowed])
    best = theta[solved][0] if np.any(solved) else _closest_angles(problem, theta)
    reach = float(np.sum(arm.link_lengths))
    tip = np.append(arm.arm_points(best)[-1], np.sum(best))
    off = _tip_errors(problem, best[None])[0] * (not np.any(solved))
    place, angle = (problem.tip.place, problem.tip.angle) if problem.tip else (None, None)
    return Reach(
        branches=tuple(np.append(np.nan, each) for each in branches),
        blocked=len(_nearest_by_branch(problem, theta[solved])) - len(branches),
        tip=tip,
        missed_m=None if place is None else reach * float(np.linalg.norm(off[:2])),
        missed_deg=None if angle is None else float(np.rad2deg(abs(off[-1]))),
        reach=reach,
    )


def _arm(problem: Problem) -> Any:
    return problem.system


def _goal_angles(problem: Problem) -> Array:
    """Return joint angles (S, n) within limits that meet the goal or come as close as possible."""
    free = np.array(problem.free) - 1
    most = problem.free_within
    rng = np.random.default_rng(0)
    theta = np.tile(problem.goal[1:], (START_POINTS, 1))
    theta[:, free] = rng.uniform(-most, most, (START_POINTS, len(free)))
    theta[0, free] = np.clip(problem.start[1:][free], -most, most)
    left = np.arange(START_POINTS)
    for _ in range(MOST_STEPS):
        missed = np.max(np.abs(_tip_errors(problem, theta[left])), axis=1, initial=0.0)
        left = left[missed >= TIP_TOLERANCE]
        if not len(left):
            break
        theta[np.ix_(left, free)] = _improved_angles(problem, theta[left], free, most)
    return theta


def _improved_angles(problem: Problem, theta: Array, free: Array, most: Array) -> Array:
    """Return the free joints' angles after one Levenberg-Marquardt step; joints stop at limits."""
    off, slope = _tip_errors(problem, theta), _tip_slopes(problem, theta)[:, :, free]
    now = theta[:, free]
    damping = (1e-14 + np.sum(off**2, axis=1))[:, None, None] * np.eye(off.shape[1])
    for _ in range(len(free)):
        push = np.linalg.solve(slope @ slope.transpose(0, 2, 1) + damping, off[:, :, None])
        step = -(slope.transpose(0, 2, 1) @ push)[:, :, 0]
        longest = np.max(np.abs(step), axis=1, keepdims=True)
        step *= np.minimum(1.0, LONGEST_STEP_RAD / np.maximum(longest, LONGEST_STEP_RAD))
        new = np.clip(now + step, -most, most)
        out = np.abs(now + step) > most
        if not np.any(out & np.any(slope, axis=1)):
            break
        slope = np.where(out[:, None, :], 0.0, slope)
    return new


def _tip_errors(problem: Problem, theta: Array) -> Array:
    """Return the errors of the m tip quantities at angles `theta` (S, n), shape (S, m): positions
    relative to the arm's reach, directions in rad."""
    if problem.tip is None:
        return np.zeros((len(theta), 0))
    q = np.column_stack([np.zeros(len(theta)), theta])
    tip = np.stack(problem.tip.values(MotionPoint.of(problem.system, q)), axis=1)
    low, _, scale = problem.tip.bounds
    return np.asarray((tip - low) / scale)


def _tip_slopes(problem: Problem, theta: Array) -> Array:
    """Return the derivatives of `_tip_errors` by the joint angles, shape (S, m, n).

    Joint j moves the tip at right angles to the line from the joint to the tip.
    """
    assert problem.tip is not None
    points = _arm(problem).arm_points(theta)
    arm = (points[:, -1:] - points[:, :-1]) / np.sum(_arm(problem).link_lengths)
    every = {"x": -arm[..., 1], "y": arm[..., 0], "angle": np.ones_like(theta)}
    return np.stack([every[name] for name in problem.tip.quantities], axis=1)


def keeps_requirements(problem: Problem, q: Array) -> NDArray[np.bool_]:
    """Return whether configurations (S, N) satisfy the requirements that depend on q only, shape
    (S,)."""
    points, out = MotionPoint.of(problem.system, q), np.ones(len(q), dtype=bool)
    for requirement in problem.requirements:
        if requirement.reads == {"q"}:
            low, high, scale = requirement.bounds
            values, slack = np.stack(requirement.values(points), axis=1), ROUNDING * scale
            out &= np.all((values >= low - slack) & (values <= high + slack), axis=1)
    return out


def _nearest_by_branch(problem: Problem, theta: Array) -> list[Array]:
    """Return the row of `theta` (S, n) nearest to the start in each branch, nearest first."""
    distances = np.linalg.norm(theta - problem.start[1:], axis=1)
    branches: dict[tuple[bool, ...], Array] = {}
    for k in np.argsort(distances, kind="stable"):
        branches.setdefault(tuple((theta[k, 1:] > 0).tolist()), theta[k])
    return list(branches.values())


def _closest_angles(problem: Problem, theta: Array) -> Array:
    """Return angles (n,) with the least tip error, refined from the best of `theta` (S, n)."""
    from scipy.optimize import least_squares  # slow to import, rarely needed

    free, most = np.array(problem.free) - 1, problem.free_within
    first = np.argsort(np.linalg.norm(_tip_errors(problem, theta), axis=1))[:REFINED_POINTS]

    def all_angles(angles: Array) -> Array:
        out = theta[:1].copy()
        out[0, free] = angles
        return out

    solutions = [
        least_squares(
            lambda x: _tip_errors(problem, all_angles(x))[0],
            0.999 * theta[k, free],
            lambda x: _tip_slopes(problem, all_angles(x))[0][:, free],
            (-most, most),
        )
        for k in first
    ]
    return np.asarray(all_angles((1 - INWARD_SHARE) * min(solutions, key=lambda f: f.cost).x)[0])
