"""Feedback for replays: `planner.replay(plan, machine, feedback=True)`."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.feedback.control import Control
from planner.feedback.design import Design, design
from planner.machine import Machine
from planner.plan import Plan
from planner.schema import parse
from planner.schema.feedback import FeedbackTable


class Tracker:
    """A receding-horizon tracker: one small quadratic programme every control period.

    Every 0.1 s it reads the joint encoders, predicts where the commands already on their way will
    take the arm, and corrects the plan's inputs so that a cost over the whole rest of the motion is
    least, within the limits on inputs, their rates, joints and z₂. What it knows of the machine are
    its mean values: control period, delay, servo bandwidth, gearhead play, encoder resolution,
    velocity limit.

    When a programme has no solution its state limits are widened to what the regulator, clipped to
    the input limits, makes of them; when OSQP is late, the corrections decided before go on as
    planned. Both are counted in `Replay.fallbacks`.

    Args:
        options: The `[feedback]` table; defaults when left out.
        changes: Keys of the table that replace it: `Tracker(run_up=False)`.

    Raises:
        InputError: If a key is unknown or a value impossible.
    """

    _KEPT = 4

    def __init__(self, options: FeedbackTable | None = None, **changes: Any) -> None:
        given = {} if options is None else options.model_dump(exclude_unset=True)
        self.options = parse(FeedbackTable, {**given, **changes}, "feedback")
        self._designs: OrderedDict[tuple[int, Machine], tuple[Plan, Design]] = OrderedDict()

    def start(self, plan: Plan, machine: Machine, numbers: NDArray[np.int64]) -> Control:
        """A controller of the samples `numbers` (S,); see `planner.machine.loop.Feedback`.

        Raises:
            InputError: If the options do not fit the machine.
            UntrackableError: If the plan's inputs are far beyond what may be commanded.
        """
        return Control(self.design(plan, machine), len(numbers))

    def design(self, plan: Plan, machine: Machine) -> Design:
        """What the samples share; kept for the next run of the same plan on the same machine."""
        key = (id(plan), machine)
        if key not in self._designs:
            self._designs[key] = (plan, design(plan, machine, self.options))
            if len(self._designs) > self._KEPT:
                self._designs.popitem(last=False)
        return self._designs[key][1]
