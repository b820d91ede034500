"""Where a recorded run leaves the band that 95 % of the machines keep, and what is likely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.machine.identification.identify import predict_run
from planner.machine.machine import Machine
from planner.machine.replay import replay
from planner.plan.plan import Plan
from planner.plan.recorded.log import Log
from planner.problem.problem import Problem
from planner.support.arrays import Array

MACHINES = 100

MEAN_S = 0.2
"""Time over which readings are averaged, s: noise and steps of an encoder leave no band."""


@dataclass(frozen=True)
class Departure:
    """Where a run first leaves the band of a machine.

    Attributes:
        t_s: Time in the log, s.
        joint: Number of the joint, from 1.
        off_deg: Its reading minus the middle of the band there, degrees.
        is_arm: Whether the machine's prediction from the run's own start is off by the band or half
            as much: then the arm is not this machine. Else it started in another pose or state.
    """

    t_s: float
    joint: int
    off_deg: float
    is_arm: bool

    def __str__(self) -> str:
        likely = "the start was not as planned: home the arm and read its pose"
        if self.is_arm:
            likely = "the arm is not this machine (any more): record the excitation and identify"
        side = "above" if self.off_deg > 0 else "below"
        return (
            f"leaves the band of 95 % of the machines at {self.t_s:.3g} s: theta{self.joint} is"
            f" {abs(self.off_deg):.2g} deg {side} its middle; likely {likely}"
        )


def departure(
    log: Log, problem: Problem, machine: Machine, plan: Plan | None = None
) -> Departure | None:
    """Return where a run first leaves the band that 95 % of the machines keep; None if nowhere.

    95 % of the machines stay in the whole band, whose width follows their spread, the noise of the
    encoders and the half width of an identified machine. Its middle is the motion of the plan on
    the machine; without a plan, or for a homing motion, which the encoders cut short, it is the
    prediction from the log's own start.

    Args:
        log: The run.
        problem: The problem of the arm.
        machine: The machine, whose spreads make the band.
        plan: The plan that was executed.
    """
    known = plan is not None and "until" not in plan.notes
    motion = plan if plan is not None and known else log.plan(problem)
    run = replay(motion, machine, MACHINES)
    noise = machine.mean("encoder_noise_deg", log.theta.shape[1])
    floor = noise + machine.mean("encoder_resolution_deg") / 2
    floor = floor + told_deg(machine)
    middle, width = band(np.rad2deg(run.q[:, :, 1:]), floor)
    t = log.t - log.start_s(plan) if plan is not None and known else log.t
    both = middle, width
    middle, half = (np.stack([np.interp(t, run.t, x) for x in y.T], axis=1) for y in both)
    gap = _mean(log, log.theta_deg - predict_run(log, problem, machine).theta_deg)
    off = _mean(log, log.theta_deg - middle) if known else gap
    if np.all(np.abs(off) <= half):
        return None
    k = int(np.argmax(np.any(np.abs(off) > half, axis=1)))
    i = int(np.argmax(np.abs(off[k]) / half[k]))
    is_arm = bool(np.any(np.abs(gap) > half) or np.max(np.abs(gap)) > np.max(np.abs(off)) / 2)
    return Departure(float(log.t[k]), i + 1, float(off[k, i]), is_arm)


def told_deg(machine: Machine) -> float:
    """Return the half width within which an identified machine predicts ends, degrees; else 0."""
    return (machine.worth and machine.worth.half_width_deg) or 0.0


def band(theta: Array, floor: Array | float) -> tuple[Array, Array]:
    """Return middle and half width (R, n) of the band in which 95 % of S machines stay throughout.

    Args:
        theta: Angles of the machines, (S, R, n).
        floor: Addition to their standard deviation, (n,) or a number.
    """
    middle, spread = np.median(theta, axis=0), np.std(theta, axis=0) + floor
    widest = np.max(np.abs(theta - middle) / spread, axis=(1, 2))  # of each machine
    return middle, spread * max(1.0, float(np.percentile(widest, 95)))


def _mean(log: Log, values: Array) -> Array:
    """Return running means (R, n) over `MEAN_S`."""
    window = np.ones(max(1, round(MEAN_S / log.interval_s)))
    count = np.convolve(np.ones(len(values)), window, "same")
    return np.stack([np.convolve(x, window, "same") / count for x in values.T], axis=1)
