"""Common parts of the laws, which are rules that steer the chained form by inputs in closed form.

The file has start and goal in chained coordinates, the motion that a law returns, and the steps
from a motion to a plan: timing and refusal. Every method that plans in the chart, that is in
chained coordinates z with inputs v, starts with the checks in `chart_ends`.

A law can make many motions at once, for C candidates that differ in a few numbers. Arrays then have
an axis for the candidates before the axis of the coordinates.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from planner.errors import InputError, SingularError
from planner.methods.refusal import BY_COLLOCATION
from planner.plan.measures import Objective, effort, slowing_factor
from planner.plan.plan import Plan
from planner.plan.trajectory import ChainedTrajectory, Trajectory
from planner.problem.feasibility import format_value
from planner.problem.problem import Problem
from planner.problem.tables.method_options import LawOptions
from planner.support.arrays import Array
from planner.support.calculus.bernstein import Bernstein
from planner.support.calculus.extremes import sample_times
from planner.systems.chained_form import chained_form


@dataclass(frozen=True)
class Ends:
    """Start and goal in chained coordinates, for any travel (change of q₁), checked once.

    Attributes:
        problem: The problem.
        start: z(0), shape (N,).
    """

    problem: Problem
    start: Array
    _goal: Array

    @classmethod
    def of(cls, problem: Problem) -> Ends:
        """Convert a problem's start and goal to chained coordinates after checking both.

        Raises:
            SingularError: If the two do not lie in one branch of the chart, see `chart_ends`.
        """
        return cls(problem, *chart_ends(problem, 0.0))

    def goal(self, travel: float | Array) -> Array:
        """Return z(T), shape (…, N), for travels (…), on which only z₁(T) depends."""
        goal = np.tile(self._goal, (*np.shape(travel), 1))
        goal[..., 0] = self.start[0] + travel
        return goal

    def goal_of(self, reach: float | Array) -> Array:
        """Return z(T), shape (…, N), of a law of legs whose reach is given.

        The reach is the travel or, if the problem's travel is zero, the travel of the leg out.
        """
        return self.goal(0.0 * reach if self.problem.travel == 0 else reach)

    def trajectory(self, motion: Motion) -> ChainedTrajectory:
        """Return the trajectory of a single motion between start and goal."""
        return ChainedTrajectory(self.problem.system, motion.z, motion.v, self.problem.branch)

    @property
    def duration(self) -> float:
        """Duration of the motion, s; 1 s if free, since the path is the same for every duration."""
        return self.problem.duration or 1.0


@dataclass(frozen=True)
class Motion:
    """One or C motions of a law: z and v as piecewise polynomials, and how well they were solved.

    Attributes:
        z: Bernstein with values (N,) or (C, N).
        v: Bernstein with values (2,) or (C, 2).
        coefficients: Coefficients of v₂ in the law's own basis, shape (k,) or (C, k).
        condition: Condition number of the scaled linear system, shape () or (C,). All values of a
            candidate whose conditions are nearly dependent are NaN.
        residual: Largest |zᵢ(T) − goalᵢ|, each divided by the greater of 1 and the largest |zᵢ| on
            the way, shape () or (C,).
    """

    z: Bernstein
    v: Bernstein
    coefficients: Array
    condition: Array
    residual: Array

    @classmethod
    def of(
        cls, z: Bernstein, v: Bernstein, coefficients: Array, condition: Array, goal: Array
    ) -> Motion:
        """Build C candidates for a goal (C, N), or a single motion for a goal (N,).

        Raises:
            numpy.linalg.LinAlgError: If the conditions of a single motion are nearly dependent.
        """
        size = np.maximum(np.max(np.abs(z.c), axis=(0, 1)), 1.0)
        residual = np.max(np.abs(z.c[-1, -1] - goal) / size, axis=-1)
        if np.ndim(goal) > 1:
            return cls(z, v, coefficients, condition, residual)
        if np.isnan(condition[0]):
            raise np.linalg.LinAlgError("conditions are dependent")
        z, v = Bernstein(z.c[:, :, 0], z.x), Bernstein(v.c[:, :, 0], v.x)
        return cls(z, v, coefficients[0], condition[0], residual[0])

    @property
    def curves(self) -> tuple[Bernstein, Bernstein]:
        """The curves of z and v over time."""
        return self.z, self.v

    @property
    def summary(self) -> dict[str, float]:
        """Residual and condition number of the linear system, for the notes of a plan."""
        numbers = self.residual, self.condition
        return dict(
            zip(("endpoint_residual", "condition_number"), map(float, numbers), strict=True)
        )


_CONDITION = 1e10
"""Largest condition number accepted, at which coefficients keep six of sixteen digits. At a larger
number rounding chooses the motion, differently on another processor."""


def solve_conditions(rows: Array, values: Array) -> tuple[Array, Array]:
    """Solve rows · coefficients = values by coefficients of least norm, for each of C candidates.

    Args:
        rows: Matrices, shape (C, m, k), m ≤ k.
        values: Right-hand sides, shape (C, m).

    Returns:
        The coefficients (C, k), and the condition numbers (C,) of the matrices with rows scaled to
        unit length; both are NaN for rows that are dependent or nearly so.
    """
    with np.errstate(all="ignore"):
        scale = 1 / np.linalg.norm(rows, axis=-1, keepdims=True)
        matrix = rows * scale
        good = np.isfinite(matrix).all(axis=(1, 2))
        matrix[~good] = 0.0
        condition = np.linalg.cond(matrix)
        good &= condition < _CONDITION
        matrix[~good] = np.eye(*matrix.shape[1:])
        orthogonal, triangular = np.linalg.qr(np.swapaxes(matrix, 1, 2))
        lower, out = np.swapaxes(triangular, 1, 2), np.zeros((*matrix.shape[::2], 1))
        for _ in range(2):  # the second time for what rounding left
            rest = (values[..., None] - rows @ out) * scale
            out = out + orthogonal @ np.linalg.solve(lower, rest)
    out[~good], condition[~good] = np.nan, np.nan
    return out[..., 0], np.broadcast_to(condition, len(out))


def finish(
    problem: Problem,
    name: str,
    options: LawOptions,
    trajectory: ChainedTrajectory,
    notes: Mapping[str, Any],
    began: float,
) -> Plan:
    """Make a plan from a law's motion: fit a free duration, or refuse a motion outside the chart.

    Args:
        problem: The problem; a free duration is fitted to the input limits.
        name: The method's name.
        options: The options used.
        trajectory: The motion, over the problem's duration (one second if it is free).
        notes: Notes of the method.
        began: Time at which the method began, by `time.perf_counter`.

    Raises:
        SingularError: If the motion leaves the chart's domain, unless `options.allow_singular`, or
            passes a place where the drive is zero.
    """
    plan = Plan(
        problem=problem,
        method=name,
        options=options.model_dump(),
        trajectory=trajectory,
        aim=Objective("effort", {"effort, not minimised": 1.0}),
        solve_time_s=time.perf_counter() - began,
        notes=notes,
    )
    if not plan.domain.ok:
        if options.allow_singular:
            return replace(plan, status="singular")
        _refuse_outside(plan)
    refuse_zero_drive(problem, name, trajectory)
    fitted = fit_duration(problem, trajectory)
    return replace(plan, trajectory=fitted, objective=effort(fitted))


def chart_ends(problem: Problem, travel: float) -> tuple[Array, Array]:
    """Return z(0) and z(T), each (N,), for a travel, after checking that the chart covers both.

    Raises:
        SingularError: If the start or goal lies on a singularity of the chart, or the goal lies on
            another branch than the start.
    """
    goal = problem.goal.copy()
    goal[0] = problem.start[0] + travel
    for name, q in (("start", problem.start), ("goal", goal)):
        if why := problem.chart.contradiction(name, q, problem.system):
            raise SingularError(why, source=problem.source, changes=[BY_COLLOCATION])
    form = chained_form(problem.system)
    return form.z(problem.start), form.z(goal)


def refuse_zero_drive(problem: Problem, name: str, trajectory: ChainedTrajectory) -> None:
    """Refuse a path with a place where the drive q̇₁/u₁ is zero, since u₁ = v₁/drive is infinite.

    Raises:
        SingularError: If there is such a place; the message gives the first one found.
    """
    system, q = problem.system, trajectory.q(sample_times(trajectory.breaks))
    drive = system.drive(q)
    zero = drive * np.sign(drive[0]) <= 1e-12 * np.max(np.abs(drive))
    if np.any(zero):  # false for NaN
        pairs = zip(system.coordinates, q[np.argmax(zero)], strict=True)
        place = ", ".join(f"{c.name} = {format_value(x, c.unit)}" for c, x in pairs)
        raise SingularError(
            f"the {name} plan passes a place where the system's drive is zero"
            f" ({place}), so that {system.inputs[0].name} would have to be infinite",
            source=problem.source,
            changes=[BY_COLLOCATION],
        )


def fit_duration(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Return the trajectory over the given duration, or as fast as the limits allow if it is free.

    Raises:
        InputError: If the duration is free and no limit depends on the speed.
    """
    if problem.duration is not None:
        return trajectory
    if not any(requirement.speed_power for requirement in problem.requirements):
        raise InputError(
            "goal.duration is free but [limits] holds no limit of an input;"
            " set goal.duration or a limit",
            source=problem.source,
        )
    factor = slowing_factor(problem.requirements, trajectory)
    if not np.isfinite(factor):  # outside the domain; the caller refuses it
        return trajectory
    return trajectory.slowed(factor * (1 + 1e-9))


def _refuse_outside(plan: Plan) -> NoReturn:
    """Raise the error for a plan that leaves the chart's domain.

    Raises:
        SingularError: Always, with the times at which the plan leaves and re-enters the domain.
    """
    report = plan.domain
    exits = ", ".join(f"{t:.4f}" for t in report.exits_s) or f"{report.time_s:.4f}"
    crossings = ", ".join(f"{t:.4f}" for t in report.z2_crossings_s)
    zero = (
        f"; z2 = 0 at t = {crossings} s"
        if crossings
        else "; z2 keeps its sign, yet outside the domain no real angles exist"
    )
    count = plan.notes.get("auto_motions_tried")
    which = (
        f"the {plan.method} plan" if count is None else f"the best {plan.method} plan of {count}"
    )
    key = plan.problem.travel_key
    travel = f"{key} (or 'free')" if key else "goal"
    point = " or constraint point" if "points" in plan.options else ""
    free = plan.problem.travel is None
    error = SingularError(
        f"{which} leaves the domain of the chained-form chart"
        f" at t = {exits} s (worst margin {report.margin:.4g} at t = {report.time_s:.4f} s:"
        f" {report.label}){zero}",
        source=plan.problem.source,
        plan=plan,
        advice=None if free else f"another {travel}{point}",
        changes=[BY_COLLOCATION],
    )
    error.times_s = report.singular_times_s
    raise error
