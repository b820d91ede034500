"""Compensate a plan: commands that lead the nominal machine along its path and to its goal.

The nominal machine has every systematic effect and no spread.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.machine.commands import merge_times
from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.feedforward.correction import Correction
from planner.machine.feedforward.legs import MOST_AWAYS_DEG, unknown_rad
from planner.machine.feedforward.prediction import Prediction, predict
from planner.machine.feedforward.shaping import CommandShape, MotorCommands
from planner.machine.machine import Machine
from planner.plan.clock import Clock
from planner.plan.plan import Compensation, Plan, mark_cut_short
from planner.plan.trajectory import StateTrajectory
from planner.problem.tables.problem_file import CompensationTable
from planner.support import deadline
from planner.support.calculus.bernstein import Bernstein
from planner.support.deadline import TimeUpError, time_limit
from planner.systems.manipulator import Manipulator

CUT_SHORT_WORDS = "ended the compensation; these are the best commands so far"
"""Note of a plan whose compensation ran out of time."""

STATE_DIGITS = 5
"""Digits behind the point of the end's state and pose in degrees: less than a ten-thousandth of a
degree."""


def follow(plan: Plan, machine: Machine, options: CompensationTable) -> Plan:
    """Compensate a plan; the result is not verified.

    If time is up before the correction is finished, the result is the best plan so far.

    Args:
        plan: An executable plan.
        machine: The machine; its spreads are ignored.
        options: Which steps of the compensation are on.

    Raises:
        InputError: If the system is not an arm with friction disks.
        TimeUpError: If there is no time for a first prediction.
    """
    problem, system = plan.problem, plan.problem.system
    if not isinstance(system, Manipulator):
        raise InputError(
            f"compensation is for arms with friction disks (system.kind ="
            f" 'manipulator'); a {system.kind} has no mechanism between motors and motion to"
            " compensate",
            source=problem.source,
        )
    attempts: list[tuple[tuple[bool, bool, float], Correction, CommandShape, Plan, Prediction]] = []
    was_cut_short, plain_E_deg = False, predict(plan, machine).error_deg
    plain = options.model_copy(update={"take_up": False})
    ways = [(options, most_away) for most_away in MOST_AWAYS_DEG] + [(plain, MOST_AWAYS_DEG[0])]
    with time_limit(None) as span:
        for done, most_away in ways:
            shape = CommandShape(plan, system, machine, done, most_away)
            correction = Correction(plan, machine, shape, plain_E_deg)
            try:
                if done.correction:
                    correction.search()
            except TimeUpError:
                was_cut_short = True
            commands = MotorCommands(shape.t, correction.commands, shape.clock, shape.is_linear)
            compensation = Compensation(plan, machine.to_dict(), shape.clock)
            candidate, prediction = plan_with_commands(compensation, commands)
            error_deg = prediction.error_deg
            is_better = correction.keeps_all and error_deg < plain_E_deg
            # If it does not help, report the plan compensated as requested.
            in_vain = done is plain and not is_better
            rank = (in_vain or not correction.keeps_all, in_vain, error_deg)
            attempts.append((rank, correction, shape, candidate, prediction))
            if was_cut_short or is_better or not shape.clock.holds:
                break
    _, correction, shape, candidate, prediction = min(attempts, key=lambda each: each[0])
    notes = {
        "E_deg": prediction.error_deg,
        "plain_E_deg": plain_E_deg,
        "lead_s": candidate.lead_s,
        "tail_s": candidate.tail_s,
        "holds_s": [[begin, end] for begin, end in candidate.clock.holds],
        "uneven": _worst_joints(shape, system),
        "rounds": correction.rounds,
        "unknown_deg": float(np.rad2deg(unknown_rad(machine, system))),
    }
    every = {**plan.notes, "compensation": notes, **_ends(prediction)}
    candidate = replace(candidate, notes=every)
    return mark_cut_short(candidate, span, CUT_SHORT_WORDS) if was_cut_short else candidate


def _worst_joints(shape: CommandShape, system: Manipulator) -> list[dict[str, Any]]:
    """Return for each leg its start, s, the joint with the largest error, and that error,
    degrees."""
    out, earlier = list[dict[str, Any]](), 0.0
    for leg in shape.legs:
        if leg.uneven_rad > 0:
            joint = system.coordinates[2 + int(np.argmax(leg.misses))].name
            lacks = float(np.rad2deg(leg.uneven_rad))
            out.append({"t_s": leg.place_s + earlier, "joint": joint, "deg": lacks})
        earlier += leg.seconds(shape.tick)
    return out


def with_prediction(plan: Plan, machine: Machine) -> Plan:
    """Return a plan with its own inputs and the motion predicted on the nominal machine; not
    verified.

    The notes `end_state` and `end_theta_deg` say where the machine comes to rest.
    """
    t = merge_times(np.arange(0.0, plan.duration, DEFAULT_TICK_S), plan.t)
    prediction = predict(plan, machine, progress=lambda *_: deadline.check_stopped())
    values = prediction.q_at(t), plan.u(t)
    curves = (Bernstein(np.stack([each[:-1], each[1:]]), t) for each in values)
    return replace(
        plan,
        options={**plan.options, "end": "machine"},
        trajectory=StateTrajectory(plan.problem.system, *curves),
        compensation=Compensation(plan, machine.to_dict(), Clock.running(plan.duration)),
        notes={**plan.notes, "from_ideal_deg": prediction.error_deg, **_ends(prediction)},
    )


def _ends(prediction: Prediction) -> dict[str, list[float]]:
    """Return the state and the pose at rest after a plan, for its notes."""
    return {
        "end_state": np.round(prediction.end_state, STATE_DIGITS).tolist(),
        "end_theta_deg": np.round(np.rad2deg(prediction.end[1:]), STATE_DIGITS).tolist(),
    }


def plan_with_commands(
    compensation: Compensation, commands: MotorCommands
) -> tuple[Plan, Prediction]:
    """Return the compensated plan with these commands, and its prediction; not verified.

    Args:
        compensation: The plan whose motion is wanted, and the machine to compensate for.
        commands: Commands of the motors.

    Raises:
        TimeUpError: If the prediction takes too long.
    """
    plan = compensation.plan
    system = plan.problem.system
    still = np.repeat(plan.q(0.0)[None], len(commands.t), axis=0)
    out = replace(
        plan,
        trajectory=commands.trajectory(system, still),
        verified=False,
        certificate=None,
        compensation=compensation,
    )
    machine = Machine.from_table(compensation.machine)
    prediction = predict(out, machine, progress=lambda *_: deadline.check_stopped())
    moved = commands.trajectory(system, prediction.q_at(commands.t))
    return replace(out, trajectory=moved), prediction
