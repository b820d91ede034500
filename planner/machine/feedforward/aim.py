"""The goal that a plan must be made for so that the nominal machine ends at the goal wanted.

What the nominal machine misses the goal by is a function F(x) of the shift x of the goal that is
planned for; F(x) = 0 is solved by Broyden's method (C. G. Broyden, Math. Comp. 19, 1965, 577),
which begins with F' = 1: the end moves with the goal. Taking F itself off the goal, step by step,
is the same with F' = 1 throughout, and goes astray where a shifted goal makes the drive turn back
elsewhere (problems/paper-fig4.toml). Each value of F takes one plan next to the last and one replay
of one machine.

On the nominal machine every spread is off and every systematic effect on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.errors import InputError, NoPlanError
from planner.machine.feedforward.shaping import MotorCommands, shape_commands
from planner.machine.machine import Machine
from planner.machine.replay import SETTLE_S
from planner.machine.simulate import Progress, simulate
from planner.plan.plan import Compensation, Plan, mark_cut_short
from planner.problem.problem import Problem
from planner.problem.tables.problem_file import CompensationTable
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.deadline import TimeUpError, time_limit
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

MOST_PLANS = 12
"""Plans after which the best is taken: two or three do where the drive keeps its direction, four to
ten where it turns back."""

LEAST_TIME_S, SOLVE_TIME_FACTOR = 5.0, 20.0
"""Seconds for all of them (replays do not count), at least and as a multiple of what the plan
itself took: each starts next to the last. Where one must be searched for, the goal cannot be
reached in the time."""

AIM_TOLERANCE_RAD = np.deg2rad(0.01)
"""Error on the nominal machine that is good enough: a hundredth of what spreads leave."""

CUT_SHORT_WORDS = "ended the compensation; this is the plan that ends nearest to the goal so far"
"""What a plan says for which there was too little time."""

LONGEST_STEP_FACTOR = 3.0
"""A step so many times longer than what is missed comes of derivatives across a plan of another
kind, and leads away; the search then begins anew from where it is. Of ten plans of problems/ this
changes one, which else shifts its goal by 129 degrees."""

Replan = Callable[[Problem, Plan], Plan]
"""A plan for a problem whose goal lies next to that of a plan."""


def compensable(system: TriangularSystem) -> bool:
    """Whether a machine of that kind has systematic errors that commands can allow for."""
    return isinstance(system, Manipulator)


def aim(plan: Plan, machine: Machine, options: CompensationTable, replan: Replan) -> Plan:
    """A plan whose inputs lead the nominal machine along the plan, and to its goal; not verified.

    Where time is up before it ends at the goal, it is the nearest that there was time for, and
    says so.

    Args:
        plan: An executable plan.
        machine: The machine; its spreads count for nothing.
        options: What is done.
        replan: How a plan for a shifted goal is made.

    Raises:
        InputError: If the system is no arm with friction disks.
        NoPlanError: If the shifted goal breaks a limit, or by `replan`.
        TimeUpError: If it takes too long.
    """
    problem, system = plan.problem, plan.problem.system
    if not compensable(system) or not isinstance(system, Manipulator):
        raise InputError(
            f"{problem.source}: compensation is for arms with friction disks (system.kind ="
            f" 'manipulator'); a {system.kind} has no mechanism between motors and motion to"
            " compensate"
        )
    tried: list[_Trial] = []
    with time_limit(None) as span:
        was_cut_short = False
        try:
            tried.extend(_trials(plan, system, machine, options, replan))  # keeps those till then
        except (TimeUpError, NoPlanError):
            was_cut_short = deadline.is_over()
            if not tried or not was_cut_short:
                raise
    best = min(tried, key=lambda trial: trial.worst)
    notes = {
        "plans": len(tried),
        "goal_shift": best.shift.tolist(),
        "missed_rad": best.worst,
        "path_rad": best.path_error,
        "lead_s": best.plan.lead_s,
        "tail_s": best.plan.tail_s,
    }
    compensated = replace(best.plan, notes={**plan.notes, "compensation": notes})
    return mark_cut_short(compensated, span, CUT_SHORT_WORDS) if was_cut_short else compensated


@dataclass(frozen=True, eq=False)
class _Trial:
    """What came of one shift of the goal.

    Attributes:
        plan: The compensated plan.
        shift: By how much its goal was shifted.
        miss: By how much the nominal machine misses the goal.
        path_error: How far it is at most from the path wanted, rad.
    """

    plan: Plan
    shift: Array
    miss: Array
    path_error: float

    @property
    def worst(self) -> float:
        """Largest component of the error at the goal."""
        return float(np.max(np.abs(self.miss)))


def _trials(
    plan: Plan,
    system: Manipulator,
    machine: Machine,
    options: CompensationTable,
    replan: Replan,
) -> Iterator[_Trial]:
    """Ever nearer to the goal, until that is near enough."""
    problem = plan.problem
    moved = slice(0 if problem.travel is not None else 1, None)
    wanted = _wanted_end(plan)
    target, compensation = wanted[moved], Compensation(plan, machine.to_dict(), 0.0, 0.0)
    shift, inverse = np.zeros(len(target)), np.eye(len(target))
    near, left_s = plan, max(LEAST_TIME_S, SOLVE_TIME_FACTOR * plan.solve_time_s)
    before: _Trial | None = None
    for count in range(1, MOST_PLANS + 1):
        commands = shape_commands(near, system, machine, options, plan)
        timed = replace(compensation, lead_s=commands.lead_s, tail_s=commands.tail_s)
        compensated, prediction = plan_with_commands(near, timed, commands)
        miss, path_error = prediction.end[moved] - target, float(prediction.deviation.max())
        trial = _Trial(compensated, shift, miss, path_error)
        yield trial
        if not options.aim or trial.worst < AIM_TOLERANCE_RAD or count == MOST_PLANS:
            return
        if before is not None:
            inverse = _update_inverse(inverse, before, trial)
        step = inverse @ miss
        if np.linalg.norm(step) > LONGEST_STEP_FACTOR * np.linalg.norm(miss):
            inverse, step = np.eye(len(target)), miss
        before, shift = trial, shift - step
        if deadline.is_over():
            raise deadline.time_up()
        if left_s <= 0:
            raise TimeUpError
        began = time.perf_counter()
        with time_limit(left_s, "the time for a plan next to one known"):
            near = replan(_shift_goal(problem, wanted, shift, moved), near)
        left_s -= time.perf_counter() - began
        if not near.executable:
            raise NoPlanError("that plan leaves the domain of the chained-form chart")


def _update_inverse(inverse: Array, before: _Trial, now: _Trial) -> Array:
    """Broyden's update of the inverse Jacobian, by the formula of Sherman and Morrison."""
    step, change = now.shift - before.shift, now.miss - before.miss
    along = step @ inverse
    scale = float(along @ change)
    if abs(scale) < 1e-12 * float(step @ step):
        return inverse
    return np.asarray(inverse + np.outer(step - inverse @ change, along) / scale)


def _wanted_end(plan: Plan) -> Array:
    """q(T), shape (N,): the goal, and where it leaves joints free what the plan chose."""
    goal, free = plan.problem.target, list(plan.problem.free)
    if free:
        goal[free] = plan.trajectory.q(plan.duration)[free]
    return goal


def _shift_goal(problem: Problem, goal: Array, shift: Array, moved: slice) -> Problem:
    """The problem with its goal shifted from there."""
    goal = goal.copy()
    goal[moved] += shift
    keys: dict[str, Any] = {"goal.theta_deg": np.rad2deg(goal[1:]).tolist()}
    if problem.free:
        keys |= {"goal.tip_m": None, "goal.tip_angle_deg": None}
    if problem.travel is not None:
        keys |= problem.travel_change(float(goal[0] - problem.start[0]))
    try:
        return problem.changed(keys)
    except InputError as error:
        angles = ", ".join(f"{angle:.4g}" for angle in keys["goal.theta_deg"])
        why = str(error).splitlines()[0].removeprefix(f"{problem.source}: ")
        raise NoPlanError(f"that goal would be ({angles}) deg; {why}") from None


@dataclass(frozen=True, eq=False)
class Prediction:
    """A motion of the nominal machine.

    Attributes:
        t: Times no farther apart than the longest step of a simulation, shape (R,), s.
        q: Coordinates then, shape (R, N).
        end: Coordinates once the servos have settled, shape (N,). The path coordinate counts from
            where it is when the plan starts: what the preparation turns it by is lost motion.
        deviation: Largest |q − what is wanted| over time of those after the first, (N−1,).
    """

    t: Array
    q: Array
    end: Array
    deviation: Array

    def q_at(self, times: Array) -> Array:
        """Coordinates (…, N) at times (…), straight from one step to the next."""
        return np.stack([np.interp(times, self.t, q) for q in self.q.T], axis=-1)


def predict(plan: Plan, machine: Machine, progress: Progress | None = None) -> Prediction:
    """What the nominal machine makes of a plan's inputs.

    Args:
        plan: A compensated plan; only the start of its motion and its inputs are read.
        machine: The machine; its spreads count for nothing.
        progress: As of `planner.machine.replay.replay`.
    """
    nominal, first = machine.nominal(), np.zeros(1, dtype=np.int64)
    run = simulate(
        plan,
        nominal,
        first,
        0,
        settle_s=SETTLE_S,
        record_s=machine.step_s,
        progress=progress,
    )
    prediction = Prediction(run.t, run.q[0], run.q[0, -1].copy(), run.deviation[0])
    prediction.end[0] -= prediction.q_at(np.array(plan.lead_s))[0] - prediction.q[0, 0]
    return prediction


def plan_with_commands(
    near: Plan, compensation: Compensation, commands: MotorCommands
) -> tuple[Plan, Prediction]:
    """The compensated plan with these commands, and its prediction; not verified.

    Args:
        near: The plan that the commands were shaped from.
        compensation: The plan whose motion is wanted, and the machine that is allowed for.
        commands: What the motors are told.

    Raises:
        TimeUpError: If it takes too long.
    """
    system, wanted = near.problem.system, compensation.plan
    still = np.repeat(near.q(0.0)[None], len(commands.t), axis=0)
    out = replace(
        wanted,
        trajectory=commands.trajectory(system, still),
        verified=False,
        certificate=None,
        compensation=compensation,
    )
    machine = Machine.from_table(compensation.machine)
    prediction = predict(out, machine, progress=lambda *_: deadline.check())
    return replace(
        out, trajectory=commands.trajectory(system, prediction.q_at(commands.t))
    ), prediction
