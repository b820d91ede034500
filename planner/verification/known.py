"""What is known of a motion, and the verdicts on functions of it that must not be negative."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.plan.claims import Claim, Status
from planner.plan.plan import Plan
from planner.plan.retimed import RetimedTrajectory
from planner.problem.requirements.requirement import Part
from planner.verification.enclosure import Enclosure, enclose
from planner.verification.input_models import Coarse, Source, enclosed, resolve, source_of
from planner.verification.models import Margin, Model, least

EQUAL = 1e-9
"""Excess over a limit, relative to it, that counts as equality."""

UNBOUNDED = "no bound on the motion or its inputs is known on all of it"

STANDSTILL = "the inputs of a retimed path are quotients of zeros where the path stands still"


@dataclass(frozen=True, eq=False)
class Known:
    """What is enclosed on one clock.

    Attributes:
        motion: The inputs, and perhaps the coordinates.
        source: Whose inputs these are.
        reads: Which of coordinates "q", inputs "u" and their rates "du" are known.
        retimed: The trajectory along whose path this is, if the clock is the path's own.
        why: Why something on it is not bounded.
    """

    motion: Enclosure
    source: Source
    reads: frozenset[str] = frozenset({"q", "u", "du"})
    retimed: RetimedTrajectory | None = None
    why: str = UNBOUNDED

    @cached_property
    def inputs(self) -> list[Model]:
        """Models of the inputs."""
        return self.motion.models(*self.motion.u)

    @cached_property
    def rates(self) -> list[Model]:
        """Models of their rates, inside the pieces."""
        return self.motion.models(*self.source.slopes(self.motion.cells))

    @property
    def end_s(self) -> float:
        """Its own time at the end, seconds."""
        return float(self.motion.cells.breaks[-1])

    def claim(
        self, part: Part, scale: float, low: float, high: float, when: float, required: bool = True
    ) -> Claim:
        """The verdict on a least margin between two bounds; its own time becomes the plan's."""
        slack, known = EQUAL * scale, float(high) if np.isfinite(high) else np.nan
        time_s, why = float(when) if np.isfinite(when) else None, ""
        if time_s is not None and self.retimed is not None:
            time_s = self.retimed.time_of(time_s)
        status: Status = "undecided"
        if low >= -slack:
            status = "proven"
        elif known < -slack:
            status = "violated"
        else:
            open_ = f"the margin lies between {low:.3g} and {known:.3g}"
            why = open_ if np.isfinite(low) else self.why
        return Claim(part.label, status, low, known, time_s, part.unit, required, why)


@dataclass(frozen=True, eq=False)
class On:
    """What proofs of a plan rest on.

    Attributes:
        plan: The plan.
        path: The true motion, of a retimed plan in the path's own time and without its inputs.
        own: The plan's own coordinates there.
    """

    plan: Plan
    path: Known
    own: list[Model]

    def known(self, reads: frozenset[str]) -> Known:
        """What knows all of these."""
        if self.path.retimed is None or reads <= self.path.reads:
            return self.path
        return self._whole if "q" in reads else self._timed

    def finer(self, known: Known, coarse: Coarse) -> Known:
        """The same on cells that are split where they are too coarse."""
        plan, source = self.plan, replace(known.source, halvings=Source.halvings)
        start = plan.problem.start if "q" in known.reads else None
        if known is self.path and start is not None:
            return replace(known, motion=enclosed(plan.trajectory, start, coarse)[1])
        return replace(known, motion=resolve(source, start, coarse))

    @cached_property
    def _timed(self) -> Known:
        """The inputs of a retimed plan in its own time."""
        assert self.path.retimed is not None
        source = source_of(self.path.retimed)
        return Known(resolve(source), source, frozenset({"u", "du"}), why=STANDSTILL)

    @cached_property
    def _whole(self) -> Known:
        """Its coordinates too in its own time."""
        plan, timed = self.plan, self._timed
        own = enclose(plan.trajectory, timed.motion.cells, timed.motion.u, plan.problem.start)
        return replace(timed, motion=own, reads=frozenset({"q", "u", "du"}))


@dataclass(frozen=True, eq=False)
class ToProve:
    """Every one of some functions must be ≥ 0 at all times.

    Attributes:
        part: Whose label and unit the claim has.
        margins: (sign, value, limit) of sign · value + limit.
        known: What the values are functions of.
        required: Whether the problem asks for it.
    """

    part: Part
    margins: list[Margin]
    known: Known
    required: bool = True


Proof = ToProve | Claim


def decide(found: list[Proof]) -> list[Claim]:
    """The claims, in order; what is still to prove on one clock is bounded all at once."""
    wanted = [each for each in found if isinstance(each, ToProve)]
    verdicts: dict[int, Claim] = {}
    for known in {id(each.known): each.known for each in wanted}.values():
        own = [each for each in wanted if each.known is known]
        scales = np.array([each.part.scale for each in own for _ in each.margins])
        margins = [margin for each in own for margin in each.margins]
        bounds = iter(least(margins, known.motion.cells, scales))
        for each in own:
            of = [next(bounds) for _ in each.margins]
            guaranteed, worst = min(x.guaranteed for x in of), min(of, key=lambda x: x.attained)
            given = each.part, each.part.scale, guaranteed, worst.attained, worst.time_s
            verdicts[id(each)] = known.claim(*given, each.required)
    return [verdicts.get(id(each), each) for each in found]  # type: ignore[arg-type]
