"""What many machines make of one log's commands, at once.

How the arm stood in its backlash when a log begins is not known. It need not be: once each joint
has moved by `KNOWN_DEG` its axis lies against the side that it was pushed to, and nothing is left
of the start but an offset of each angle. So angles count from then on, and the offsets at the start
are numbers of the log's own. A link with inertia was hit by its axis and swings for seconds, until
friction holds it where the drive turns back; its angles count once it has been pushed both ways.
"""

from __future__ import annotations

import numpy as np

from planner.errors import InputError
from planner.machine.commands import Command
from planner.machine.identification.parameters import Parameters
from planner.machine.simulate import make_motion
from planner.plan.recorded.log import Log
from planner.problem.problem import Problem
from planner.support.arrays import Array

KNOWN_DEG = 1.0
"""A joint that has moved so far is pushed: it is ten times what an encoder is off."""

STEP_S = 0.0025
"""Step of the simulation: its error, 0.001 degrees, is a thirtieth of an encoder's."""

NOISE_BLOCK_S = 1.0
"""Length of the parts of a log that its noise is read from, s."""

LEAST_NOISE_DEG = 0.005
"""A reading is hardly better, whatever its file says."""


class LogModel:
    """A log, and machines under its commands.

    Args:
        log: The log.
        problem: Gives the arm.
        parameters: What the machines differ in.

    Attributes:
        log: The log.
        known: Index of the row from which on the state of the arm is known.
        noise: Standard deviation of a reading of each joint, (n,), rad.

    Raises:
        InputError: If the arm has another number of joints, or a joint of the log does not move.
    """

    def __init__(self, log: Log, problem: Problem, parameters: Parameters) -> None:
        self.log, self._parameters = log, parameters
        self._plan = log.plan(problem)
        self.known = known_row(log, parameters.preset.fidelity == "dynamic")
        self.noise = reading_noise(log)
        hold = log.interval_s if log.is_even else None
        preset = parameters.preset
        step = STEP_S if preset.fidelity == "quasi-static" else preset.step_s
        self._machine = preset.with_(step_s=step, control_period_s=hold or False)
        one = parameters.draws(np.zeros((1, len(parameters.rows))))
        self._command = Command(self._plan, hold, one, step, log.t)
        self._rows = np.searchsorted(self._command.t, log.t)

    def angles(self, x: Array, offsets: Array) -> Array:
        """Angles of machines x (S, P) that start off the first reading by (S, n) rad, (S, R, n)."""
        start = np.repeat(self._plan.q(0.0)[:, None], len(x), axis=1)
        start[1:] += offsets.T
        draws = self._parameters.draws(x)
        desired = np.zeros((len(self._command.t), len(start) - 1, 1))
        motion = make_motion(self._plan, self._machine, draws, start)
        motion.begin(self._command, desired, self._rows)
        motion.advance(len(self._command.t) - 1)
        return np.asarray(motion.q[:, :, 1:])

    def settled_offsets(self, x: Array) -> Array:
        """Offsets (S, n) with which the machines x (S, P) stand as read once the state is known."""
        rows = slice(self.known, self.known + READINGS)
        offsets = np.zeros((len(x), self.log.theta.shape[1]))
        for _ in range(OFFSET_ROUNDS):
            gap = self.log.theta[rows] - self.angles(x, offsets)[:, rows]
            offsets = offsets + gap.mean(axis=1)
        return offsets


READINGS, OFFSET_ROUNDS = 100, 3
"""Readings whose mean tells where a joint is, a second in which a link with inertia swings to and
fro; rounds after which an offset, which acts on the joints behind by cosines, no longer changes
(the second changes it by 0.01 degrees)."""


def known_row(log: Log, has_inertia: bool = False) -> int:
    """Index of the row from which on every joint has been pushed by its axis.

    Args:
        log: The log.
        has_inertia: Whether joints must have been pushed both ways; those that the log does not
            push both ways need not.

    Raises:
        InputError: If a joint does not move.
    """
    moved = np.abs(log.theta - log.theta[0]) > np.deg2rad(KNOWN_DEG)
    still = np.flatnonzero(~moved.any(axis=0))
    if still.size:
        names = ", ".join(f"theta{i + 1}" for i in still)
        raise InputError(
            f"{log.source}: {names} moves by less than {KNOWN_DEG:g} degree; a log must move every"
            " joint (planner.excitation(problem) is a motion that does)"
        )
    row = int(moved.argmax(axis=0).max())
    if has_inertia:
        risen = log.theta - np.minimum.accumulate(log.theta) > np.deg2rad(KNOWN_DEG)
        fallen = np.maximum.accumulate(log.theta) - log.theta > np.deg2rad(KNOWN_DEG)
        both = np.logical_or.accumulate(risen) & np.logical_or.accumulate(fallen)
        row = max(row, int(both.argmax(axis=0).max()))
    return row


def reading_noise(log: Log) -> Array:
    """Standard deviation of a log's readings, (n,), rad: noise and resolution together.

    From second differences, in which the motion of an arm hardly shows at a controller's rate;
    where it does, as where the drive reverses, it does in few blocks, and the median block counts.
    """
    second = np.diff(log.theta, 2, axis=0)
    blocks = np.array_split(second, max(1, round(log.t[-1] / NOISE_BLOCK_S)))
    each = np.stack([np.sqrt(np.mean(block**2, axis=0) / 6) for block in blocks])
    return np.asarray(np.maximum(np.median(each, axis=0), np.deg2rad(LEAST_NOISE_DEG)))
