"""What is known of a motion, and the verdicts on functions of it that must not be negative."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from operator import attrgetter

import numpy as np
from numpy.polynomial.chebyshev import chebval

from planner.plan.claims import Claim, Status
from planner.plan.plan import Plan
from planner.plan.retimed import RetimedTrajectory
from planner.problem.requirements.requirement import Part
from planner.support.arrays import Array
from planner.verification.enclosure import Enclosure, enclose
from planner.verification.input_models import (
    CellChoice,
    InputSource,
    enclose_trajectory,
    resolve,
    source_of,
)
from planner.verification.models import Margin, Model, least_values

NO_BOUND_REASON = "no bound on the motion or its inputs is known on all of it"

SUBSTITUTE_REASON = "its rows, which the proof reads, are a substitute for its values"

STANDSTILL_REASON = (
    "the inputs of a retimed path are quotients of zeros where the path stands still"
)


@dataclass(frozen=True, eq=False)
class EnclosedMotion:
    """A motion, enclosed on one clock.

    Attributes:
        enclosure: The inputs, and perhaps the coordinates.
        source: Whose inputs these are.
        reads: Which of coordinates "q", inputs "u" and their rates "du" are known.
        retimed: The trajectory along whose path this is, if the clock is the path's own.
        why: Why something on it is not bounded.
    """

    enclosure: Enclosure
    source: InputSource
    reads: frozenset[str] = frozenset({"q", "u", "du"})
    retimed: RetimedTrajectory | None = None
    why: str = NO_BOUND_REASON

    @cached_property
    def inputs(self) -> list[Model]:
        """Models of the inputs."""
        return self.enclosure.models(*self.enclosure.u)

    @cached_property
    def rates(self) -> list[Model]:
        """Models of their rates, inside the pieces."""
        return self.enclosure.models(*self.source.slopes(self.enclosure.cells))

    @property
    def end_s(self) -> float:
        """Its own time at the end, seconds."""
        return float(self.enclosure.cells.breaks[-1])

    @property
    def edges(self) -> Array:
        """Where its cells begin, and the end, in the plan's time, seconds."""
        edges = np.append(self.enclosure.cells.times(np.array([-1.0]))[:, 0], self.end_s)
        return edges if self.retimed is None else self.retimed.time_of(edges)

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Coordinates (N,) and inputs (2,) at its own time, to what the models leave open."""
        ends = self.enclosure.cells.times(np.array([-1.0, 1.0]))
        k = int(np.clip(np.searchsorted(ends[:, 0], time_s, side="right") - 1, 0, len(ends) - 1))
        x = 2 * (time_s - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
        q, u = ([chebval(x, m.c[k]) for m in of] for of in (self.enclosure.states, self.inputs))
        return np.array(q), np.array(u)

    def claim(
        self,
        part: Part,
        tolerance: float,
        low: float,
        high: float,
        when: float,
        required: bool = True,
        why: str = "",
    ) -> Claim:
        """The verdict on a least margin between two bounds; its own time becomes the plan's.

        A margin down to −tolerance is kept, as `verify` counts it.
        """
        upper = float(high) if np.isfinite(high) else np.nan
        time_s = float(when) if np.isfinite(when) else None
        if time_s is not None and self.retimed is not None:
            time_s = float(self.retimed.time_of(time_s))
        status: Status = "undecided"
        if low >= -tolerance:
            status, why = "proven", ""
        elif upper < -tolerance:
            status, why = "violated", ""
        elif not why:
            open_ = f"the margin lies between {low:.3g} and {upper:.3g}"
            why = open_ if np.isfinite(low) else self.why
        return Claim(part.label, status, low, upper, time_s, part.unit, required, why)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What proofs of a plan rest on.

    Attributes:
        plan: The plan.
        path: The true motion, of a retimed plan in the path's own time and without its inputs.
        plan_q: The plan's own coordinates there.
    """

    plan: Plan
    path: EnclosedMotion
    plan_q: list[Model]

    def motion_for(self, reads: frozenset[str]) -> EnclosedMotion:
        """A motion that encloses all of these."""
        if self.path.retimed is None or reads <= self.path.reads:
            return self.path
        return self._motion_over_time if "q" in reads else self._inputs_over_time

    def refine(self, motion: EnclosedMotion, coarse: CellChoice) -> EnclosedMotion:
        """The same on cells that are split where they are too coarse."""
        plan, source = self.plan, replace(motion.source, halvings=InputSource.halvings)
        start = plan.problem.start if "q" in motion.reads else None
        if motion is self.path and start is not None:
            return replace(motion, enclosure=enclose_trajectory(plan.trajectory, start, coarse)[1])
        return replace(motion, enclosure=resolve(source, start, coarse))

    @cached_property
    def _inputs_over_time(self) -> EnclosedMotion:
        """The inputs of a retimed plan in its own time."""
        assert self.path.retimed is not None
        source = source_of(self.path.retimed)
        return EnclosedMotion(
            resolve(source), source, frozenset({"u", "du"}), why=STANDSTILL_REASON
        )

    @cached_property
    def _motion_over_time(self) -> EnclosedMotion:
        """Its coordinates too in its own time."""
        plan, inputs = self.plan, self._inputs_over_time
        enclosure = enclose(
            plan.trajectory, inputs.enclosure.cells, inputs.enclosure.u, plan.problem.start
        )
        return replace(inputs, enclosure=enclosure, reads=frozenset({"q", "u", "du"}))


@dataclass(frozen=True, eq=False)
class Obligation:
    """What is still to prove: every one of some functions is ≥ 0 at all times.

    Attributes:
        part: Whose label and unit the claim has.
        margins: (sign, value, limit) of sign · value + limit.
        motion: What the values are functions of.
        tolerance: How far below zero the least may be.
        required: Whether the problem asks for it.
        margin_at: Where the functions only have the sign of the margin: the margin itself, of
            coordinates (N,) and inputs (2,).
    """

    part: Part
    margins: list[Margin]
    motion: EnclosedMotion
    tolerance: float
    required: bool = True
    margin_at: Callable[[Array, Array], float] | None = None


Proof = Obligation | Claim


def decide(proofs: list[Proof]) -> list[Claim]:
    """The claims, in order; what is still to prove on one clock is bounded all at once."""
    pending = [each for each in proofs if isinstance(each, Obligation)]
    verdicts: dict[int, Claim] = {}
    for motion in {id(each.motion): each.motion for each in pending}.values():
        obligations = [each for each in pending if each.motion is motion]
        scales = np.array([each.part.scale for each in obligations for _ in each.margins])
        margins = [margin for each in obligations for margin in each.margins]
        bounds = iter(least_values(margins, motion.enclosure.cells, scales))
        for each in obligations:
            values = list(islice(bounds, len(each.margins)))
            least = min(map(attrgetter("guaranteed"), values))
            worst = min(values, key=attrgetter("attained"))
            most, when, why = worst.attained, worst.time_s, ""
            if each.margin_at is not None and np.isfinite(when):
                most, why = each.margin_at(*motion.at(when)), SUBSTITUTE_REASON
                least = 0.0 if least >= 0 else -np.inf
            given = each.part, each.tolerance, least, most, when, each.required, why
            verdicts[id(each)] = motion.claim(*given)
    return [verdicts.get(id(each), each) for each in proofs]  # type: ignore[arg-type]
