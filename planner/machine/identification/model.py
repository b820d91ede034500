"""Simulate one log's commands on many machines at once.

The position of the arm in its backlash is unknown when a log begins. Once each joint has moved by
`KNOWN_DEG`, and its axis by `SURE_SHARE` of the lost motion, the axis touches the side towards
which it pushes, wherever it began, and the unknown start remains only as an offset of each angle.
So angles count from then on, and each log has its own offsets as parameters. A link with inertia
that its axis has hit swings for seconds, until friction stops it where the drive reverses; so its
angles count only after it has been pushed in both directions.
"""

from __future__ import annotations

import numpy as np

from planner.errors import InputError
from planner.machine.commands import Command
from planner.machine.feedback.means import lost_motion
from planner.machine.identification.diagnosis import commanded
from planner.machine.identification.parameters import Parameters
from planner.machine.simulate import make_motion
from planner.plan.recorded.log import Log
from planner.problem.problem import Problem
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

KNOWN_DEG = 1.0
"""Motion after which a joint is pushed by its axis, degrees: ten times an encoder's error."""

SURE_SHARE = 2.0
"""Motion of an axis in one direction after which it touches wherever it began, in lost motions of
the preset. A homed arm begins at one side, the model in the middle."""

STEP_S = 0.0025
"""Time step of the simulation; its error, 0.001 degrees, is a thirtieth of an encoder's."""

NOISE_BLOCK_S = 1.0
"""Length of the blocks of a log from which its noise is estimated, s."""

LEAST_NOISE_DEG = 0.005
"""Least noise of a reading that is assumed, whatever the log shows."""


class LogModel:
    """Simulation of many machines under the commands of one log.

    Args:
        log: The log.
        problem: The problem that defines the arm.
        parameters: The parameters in which the machines differ.

    Attributes:
        log: The log.
        known: Index of the first row at which the state of the arm is known.
        noise: Standard deviation of a reading of each joint, (n,), rad.

    Raises:
        InputError: If the arm has another number of joints, or a joint of the log does not move.
    """

    def __init__(self, log: Log, problem: Problem, parameters: Parameters) -> None:
        self.log, self._parameters = log, parameters
        self._plan = log.plan(problem)
        self.known = known_row(log, parameters.preset.fidelity == "dynamic")
        assert isinstance(problem.system, Manipulator)
        axes = commanded(log, problem.system)[:, 1:]
        swing = np.maximum(axes - np.minimum.accumulate(axes), np.maximum.accumulate(axes) - axes)
        sure = swing > SURE_SHARE * lost_motion(problem.system, parameters.preset)
        self.known = max(self.known, *sure.argmax(axis=0).tolist())
        self.noise = reading_noise(log)
        hold = log.interval_s if log.is_even else None
        preset = parameters.preset
        step = STEP_S if preset.fidelity == "quasi-static" else preset.step_s
        self._machine = preset.with_(step_s=step, control_period_s=hold or False)
        one = parameters.draws(np.zeros((1, len(parameters.rows))))
        self._command = Command(self._plan, hold, one, step, log.t)
        self._rows = np.searchsorted(self._command.t, log.t)

    def angles(self, x: Array, offsets: Array) -> Array:
        """Return the angles (S, R, n), rad, of machines x (S, P) that start at the first reading
        plus offsets (S, n)."""
        start = np.repeat(self._plan.q(0.0)[:, None], len(x), axis=1)
        zeros = self._parameters.zeros(x)
        start[1:] += offsets.T - zeros.T
        draws = self._parameters.draws(x)
        desired = np.zeros((len(self._command.t), len(start) - 1, 1))
        motion = make_motion(self._plan, self._machine, draws, start)
        motion.begin(self._command, desired, self._rows)
        motion.advance(len(self._command.t) - 1)
        return np.asarray(motion.q[:, :, 1:] + zeros[:, None])

    def settled_offsets(self, x: Array) -> Array:
        """Return the offsets (S, n) with which machines x (S, P) agree with the readings once the
        state is known."""
        rows = slice(self.known, self.known + READINGS)
        offsets = np.zeros((len(x), self.log.theta.shape[1]))
        for _ in range(OFFSET_ROUNDS):
            gap = self.log.theta[rows] - self.angles(x, offsets)[:, rows]
            offsets = offsets + gap.mean(axis=1)
        return offsets


READINGS, OFFSET_ROUNDS = 100, 3
"""Number of readings whose mean gives the position of a joint: a second, in which a link with
inertia swings to and fro. And number of rounds until the offsets, which depend on each other
through cosines, no longer change (the second round changes them by 0.01 degrees)."""


def known_row(log: Log, has_inertia: bool = False) -> int:
    """Return the index of the first row at which every joint has been pushed by its axis.

    Args:
        log: The log.
        has_inertia: Whether links have inertia. Each joint must then have been pushed in both
            directions, unless the log pushes it in only one.

    Raises:
        InputError: If a joint does not move.
    """
    has_moved = np.abs(log.theta - log.theta[0]) > np.deg2rad(KNOWN_DEG)
    still = np.flatnonzero(~has_moved.any(axis=0))
    if still.size:
        names = ", ".join(f"theta{i + 1}" for i in still)
        raise InputError(
            f"{log.source}: {names} moves by less than {KNOWN_DEG:g} degree; a log must move every"
            " joint (planner.excitation(problem) is a motion that does)"
        )
    row = int(has_moved.argmax(axis=0).max())
    if has_inertia:
        risen = log.theta - np.minimum.accumulate(log.theta) > np.deg2rad(KNOWN_DEG)
        fallen = np.maximum.accumulate(log.theta) - log.theta > np.deg2rad(KNOWN_DEG)
        both = np.logical_or.accumulate(risen) & np.logical_or.accumulate(fallen)
        row = max(row, int(both.argmax(axis=0).max()))
    return row


def reading_noise(log: Log) -> Array:
    """Return the standard deviation of a log's readings, (n,), rad: noise and resolution together.

    The noise is the median over blocks of the second differences. At a controller's rate the motion
    of an arm hardly affects these, except in a few blocks, as where the drive reverses.
    """
    second = np.diff(log.theta, 2, axis=0)
    blocks = np.array_split(second, max(1, round(log.t[-1] / NOISE_BLOCK_S)))
    each = np.stack([np.sqrt(np.mean(block**2, axis=0) / 6) for block in blocks])
    return np.asarray(np.maximum(np.median(each, axis=0), np.deg2rad(LEAST_NOISE_DEG)))
