"""Plans that end at the goal on the nominal machine too, by the option `end = "machine"`.

A joint keeps the distance to its axis in which the last push left it. So a plan from an unwound arm
must push beyond the goal by the joints' lost motion, then turn back by as much, while the joints
stand. A solver finds such a turn from a plan without one if the nominal machine's joints are states
of the programme beside the ideal motion (`transcription.follower`). What that leaves out (lag, the
load of joints that stand, rounded speeds) is removed in rounds: each runs the plan on the emulated
machine and moves the programme's end by the remaining error.

With `spread_weight` the objective has a second term: the mean square distance of the ends of other
machines from the nominal machine's. Their lost motion is more or less by a standard deviation in
each passive joint, all combinations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from planner.errors import InputError, NotConvergedError
from planner.methods.collocation.best import Candidate, polish
from planner.methods.collocation.method import plan_collocation, plan_of, replan_collocation
from planner.methods.collocation.pipeline import collocation_task
from planner.methods.collocation.task import Task, iterate_of_inputs
from planner.methods.collocation.transcription.follower import Follower
from planner.methods.collocation.transcription.form import through
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.requirements.places import Waypoint
from planner.problem.tables.method_options import CollocationOptions
from planner.support import deadline, progress
from planner.support.arrays import Array

SMOOTHING_RAD = (0.02, 0.005, 0.001)
"""Angles ε of the play operator, solve by solve. With the first the turn is about 1 degree too
small; at the last the error of the operator is less than that of its model of the machine."""

INTERVALS, MORE_INTERVALS = 100, 1.5
"""Least number of intervals of the mesh, and its least ratio to the plan's without a turn. A coarse
mesh costs more: its refinement moves the joints, and each solve then begins far from its answer."""

PATH_SHARE = 0.8
"""Share of the duration for the path in the first guess; the rest is for the turn."""

END_ROOM_RAD = np.deg2rad(0.01)
"""Room for the end of the nominal machine's joints; without room a solver often finds no step."""

REACH = 0.9
"""Largest distance of the end aimed at for joint 1 from the goal, as a share of its lost motion."""

MOST_ROUNDS, GOOD_RAD = 24, np.deg2rad(0.04)
"""Most rounds on the emulated machine, and the largest error at the end that is good enough: less
than half of what the judge allows. Errors of plans of 120 s jump by 0.2 degrees (motors round)."""


MACHINES: dict[str, Callable[[Problem], tuple[Follower, Callable[[Plan], Plan]]]] = {}
"""What planning needs of a problem's nominal machine, by the value of the option `end`: its joints,
and a function that adds to a plan the motion predicted on it, whose note `end_theta_deg` is where
the joints come to rest. Methods do not know the emulated machine; `planner.compensation` registers
it here."""


def plan_to_end(problem: Problem, options: CollocationOptions, warm: Plan | None = None) -> Plan:
    """Plan by collocation, as `plan_collocation` or from the plan `warm` as `replan_collocation`.

    With `end = "machine"` the plan also ends at the goal on the nominal machine.

    Raises:
        InputError: If the option needs an arm with friction disks and the system is none, or
            `spread_weight` has no machines to weigh.
        NotConvergedError: If no plan ends at the goal on the nominal machine too.
    """
    search = plan_collocation if warm is None else partial(replan_collocation, warm=warm)
    if options.end == "plan":
        if options.spread_weight > 0:
            why = "method.collocation.spread_weight weighs the ends of machines: it needs end ="
            raise InputError(f"{why} 'machine'", source=problem.source)
        return search(problem, options)
    follower, run = MACHINES[options.end](problem)
    # The plan alone is not an answer.
    span = deadline.time_limit(options.time_limit_s, has_answer=lambda: False)
    with progress.progress_listener(None), span:
        options = options.model_copy(update={"end": "plan", "rest": True})
        near = search(problem, options)
        if not any(follower.widths[0]):
            return run(near)
        progress.tell("turning beyond the goal")
        return _turn_beyond(problem, options, near, follower, run)


def _turn_beyond(
    problem: Problem,
    options: CollocationOptions,
    near: Plan,
    follower: Follower,
    run: Callable[[Plan], Plan],
) -> Plan:
    """Return a plan near the given one whose nominal machine ends at the goal too; if several
    rounds do not suffice, the plan that ends nearest."""
    nominal = replace(follower, widths=follower.widths[:1])
    job, wanted = _task(problem, options, near, nominal)
    # The first guess is the plan in less time, and rest.
    duration, s = job.problem.duration or near.duration / PATH_SHARE, job.mesh.edges / PATH_SHARE
    u = near.trajectory.u(np.minimum(s, 1.0) * near.duration)
    iterate = iterate_of_inputs(job, duration, u * near.duration / (PATH_SHARE * duration))
    for smoothing in SMOOTHING_RAD:
        job = _towards(job, wanted, smoothing)
        solution = job.solve(iterate)
        iterate = solution.iterate
    if options.spread_weight > 0 and solution.ok:
        progress.tell("drawing the ends of machines together")
        job = _task(problem, options, near, replace(follower, weight=options.spread_weight))[0]
        job = _towards(job, wanted, smoothing)
        solution = job.solve(iterate_of_inputs(job, iterate.duration, iterate.inputs))
        iterate = solution.iterate
    plans, aims = list[tuple[float, Plan]](), list[Array]()
    while solution.ok and len(plans) < MOST_ROUNDS:
        motion = Candidate(job, solution, near.notes["start"])
        done = polish(motion, options.accuracy, options.refinements)
        job, iterate = done.task, done.solution.iterate
        notes = {"tried": near.notes["tried"], "rounds": len(plans) + 1}
        plan = run(plan_of(problem, done, notes, options))
        passed = plan.trajectory.q(job.mesh.knots[1:-1] * plan.duration)[:, 1:]
        errors = np.array([*passed, np.deg2rad(plan.notes["end_theta_deg"])]) - wanted
        plans.append((float(np.nanmax(np.abs(errors))), plan))
        if plans[-1][0] <= GOOD_RAD:
            break
        model = iterate.joints[[*job.mesh.marks, -1], : errors.shape[1]]
        aims.append(model - errors)
        # The mean of several: errors of one round do not say what the next will have.
        aim = np.mean(aims[len(aims) // 2 :], axis=0)
        # Joint 1 stays within its gearhead's play of the ideal motion.
        room = REACH * follower.widths[0][0]
        aim[:, 0] = np.clip(aim[:, 0], wanted[:, 0] - room, wanted[:, 0] + room)
        job = _towards(job, aim, SMOOTHING_RAD[-1])
        solution = job.solve_near(iterate)
    if plans:
        return min(plans, key=lambda each: each[0])[1]
    raise NotConvergedError(
        "no motion was found that ends at the goal on the nominal machine too (solver status:"
        f" {solution.status} after {solution.iterations} iterations)",
        source=problem.source,
        advice=["more time (goal.duration)", "compensation (compensation.on = true)"],
    )


def _towards(job: Task, ends: Array, smoothing: float) -> Task:
    """Return the task with other angles (M+1, n) of the nominal machine's joints at the waypoints
    and the end, rad, NaN where they are free."""
    low, high = ends - END_ROOM_RAD, ends + END_ROOM_RAD
    sides = np.nan_to_num(low, nan=-np.inf), np.nan_to_num(high, nan=np.inf)
    return replace(job, demands=replace(job.demands, joint_ends=sides, smoothing=smoothing))


def _task(
    problem: Problem, options: CollocationOptions, near: Plan, follower: Follower
) -> tuple[Task, Array]:
    """Return the task of a problem with the joints of the nominal machine as further states, and
    their angles (M+1, n) at the waypoints and the goal, rad, NaN where they are free.

    Joints that the goal leaves free and the order of waypoints are those of the plan `near`.
    """
    s = np.linspace(0.0, 1.0, 1001)
    q = near.trajectory.q(s * near.duration)
    end = np.append(problem.goal[0], q[-1, 1:])
    share = 1.0 if any(point.time_s for point in problem.waypoints) else PATH_SHARE

    def place(point: Waypoint) -> float:
        passed = s[np.argmin(point.distance(q))] * near.duration
        return share * float(point.time_s or passed) / near.duration

    points = sorted(problem.waypoints, key=place)
    reached = replace(problem.within_reach().expecting(end).likely, waypoints=tuple(points))
    fine = max(INTERVALS, int(MORE_INTERVALS * (len(near.t) - 1)))
    intervals = fine if options.intervals == "auto" else options.intervals
    mesh = through(intervals, [place(point) for point in points])
    job = collocation_task(reached, options, mesh, follower=follower)
    ends = np.array([q[1:] for q in (*(point.q for point in points), reached.goal)])
    return job, np.where(np.array(follower.widths[0]) > 0, ends, np.nan)
