"""What all samples of a replay share: reference, regulator, programmes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.feedback.course import Course
from planner.feedback.forecast import gearhead_play
from planner.feedback.limits import input_limit, input_scale, refuse_beyond
from planner.feedback.programme import Programme
from planner.feedback.reference import Reference, reference, resting
from planner.feedback.regulator import Weights, regulator
from planner.feedback.run_up import run_up
from planner.feedback.timing import timing
from planner.machine import Machine
from planner.plan import Plan
from planner.schema.feedback import FeedbackTable
from planner.systems.base import Array, TriangularSystem

RUN_UP_ERROR_DEG = 5.0
"""The error during the run-up that weighs as much as one unit of correction, degrees."""

RESTING_WEIGHT = 1e4
"""Weight of a correction where the drive rests, as a part of that elsewhere."""


@dataclass(frozen=True, eq=False)
class Design:
    """The tracker of one plan on one kind of machine.

    Attributes:
        ref: The course on the tracker's clock.
        programme: The control steps.
        play: Whole play of each motor's gearhead, (2, 1), rad; zero when it is not crossed.
        resolution: Of each reading, (N, 1).
    """

    ref: Reference
    programme: Programme
    play: Array
    resolution: Array
    system: TriangularSystem

    @property
    def ramp(self) -> bool:
        """Whether corrections change steadily over a period, for the limit of the input rates."""
        return bool(np.any(np.isfinite(self.ref.rate)))


def design(plan: Plan, machine: Machine, options: FeedbackTable) -> Design:
    """Prepare the tracker of a plan on a kind of machine; what differs between samples is not used.

    Raises:
        InputError: If the options do not fit the machine.
        UntrackableError: If the plan's inputs are far beyond what may be commanded.
    """
    refuse_beyond(plan, machine)
    system = plan.problem.system
    course = Course(plan, run_up(plan, machine, options))
    clock = timing(options, system, machine, course.lead_s)
    span = plan.duration + options.overtime_s - clock.wait - clock.shift[0] - clock.begin
    count = max(1, int(np.ceil(span / clock.period - 1e-9)))
    ref = reference(course, clock, input_limit(plan, machine), count, options.least_speed)
    law = regulator(ref, _weights(plan, ref, input_scale(plan, machine), options))
    horizon = max(1, round(options.horizon_s / clock.period))
    play = gearhead_play(system, machine) * options.take_up_play
    return Design(
        ref=ref,
        programme=Programme(ref, law, horizon, options.max_iterations),
        play=play,
        resolution=_resolution(system, machine),
        system=system,
    )


def _weights(plan: Plan, ref: Reference, scale: Array, options: FeedbackTable) -> Weights:
    """The cost, from the options' units; a length in metres counts as an angle in radians."""
    tracked = np.ones(ref.q.shape[1])
    if plan.problem.system.coordinates[0].unit == "rad":
        tracked[0] = 0.0
    goal = tracked / np.deg2rad(options.goal_error_deg) ** 2
    path = tracked / np.deg2rad(options.path_error_deg) ** 2
    path = np.repeat(path[None], len(ref.feed), axis=0)
    begun = ref.s[:-1] >= 0
    path[~begun] = tracked / np.deg2rad(RUN_UP_ERROR_DEG) ** 2
    if not begun[0]:
        path[np.argmax(begun)] += goal / ref.timing.period
    size, step = options.correction * scale, options.correction_step * scale
    sizes = np.repeat(1 / size[None] ** 2, len(ref.feed), axis=0)
    sizes[resting(ref), 0] *= RESTING_WEIGHT
    return Weights(path, goal, sizes, 1 / step**2)


def _resolution(system: TriangularSystem, machine: Machine) -> Array:
    """Smallest step of each reading, (N, 1).

    Of the angles' encoders; infinite for the disk's angle, which has none; 0 for the rest, which is
    read exactly.
    """
    effect = machine.effects.get("encoder_resolution_deg")
    steps = np.broadcast_to(np.array(effect.value if effect else 0.0), system.size - 1)
    out = np.zeros((system.size, 1))
    for i, coordinate in enumerate(system.coordinates):
        if coordinate.unit == "rad":
            out[i] = np.deg2rad(steps[i - 1]) if i else np.inf
    return out
