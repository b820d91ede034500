"""Enclosed motions of a plan, and proofs that functions of these motions are never negative."""

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

NO_BOUND_REASON = "no bound on the coordinates or the inputs is known for the whole motion"

SUBSTITUTE_REASON = (
    "the proof bounds a substitute for the limited quantity, such as u^2/limit for |u|"
)

STANDSTILL_REASON = "where a retimed path stands still, its inputs are computed as zero over zero"


@dataclass(frozen=True, eq=False)
class EnclosedMotion:
    """The true motion of a plan, enclosed over the plan's time or over a retimed path's own time.

    Attributes:
        enclosure: Enclosure of the inputs, and perhaps of the coordinates.
        source: Source of the inputs, from which finer cells can be enclosed.
        reads: The quantities that are enclosed: coordinates "q", inputs "u", their rates "du".
        retimed: The retimed trajectory, if the motion is over the path's time; else None.
        why: Reason to give for a quantity without a bound.
    """

    enclosure: Enclosure
    source: InputSource
    reads: frozenset[str] = frozenset({"q", "u", "du"})
    retimed: RetimedTrajectory | None = None
    why: str = NO_BOUND_REASON

    @cached_property
    def inputs(self) -> list[Model]:
        """Models of the inputs u₁ and u₂ over time."""
        return self.enclosure.models(*self.enclosure.u)

    @cached_property
    def rates(self) -> list[Model]:
        """Models of the rates du₁/dt and du₂/dt inside the pieces; jumps at breaks are left out."""
        return self.enclosure.models(*self.source.slopes(self.enclosure.cells))

    @property
    def end_s(self) -> float:
        """End of the motion, s, in the time over which it is enclosed (the path's if retimed)."""
        return float(self.enclosure.cells.breaks[-1])

    @property
    def edges(self) -> Array:
        """Start of each cell and the end of the last cell, in the plan's time, s, shape (C+1,)."""
        edges = np.append(self.enclosure.cells.times(np.array([-1.0]))[:, 0], self.end_s)
        return edges if self.retimed is None else self.retimed.time_of(edges)

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Return coordinates (N,) and inputs (2,) of the models at a time on the motion's clock."""
        ends = self.enclosure.cells.times(np.array([-1.0, 1.0]))
        k = int(np.clip(np.searchsorted(ends[:, 0], time_s, side="right") - 1, 0, len(ends) - 1))
        x = 2 * (time_s - ends[k, 0]) / (ends[k, 1] - ends[k, 0]) - 1
        both = self.enclosure.states, self.inputs
        q, u = ([chebval(x, model.c[k]) for model in models] for models in both)
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
        """Make the claim on a part whose least margin lies between the bounds `low` and `high`.

        A margin down to −tolerance counts as kept, as in `verify`. `when`, the time of the least
        margin, is in the motion's own time; the claim converts it to the plan's time. `why` is the
        reason to give if the claim is undecided; by default it says what bounds are known.
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
            open_ = f"the margin lies between {low:.3g} and {upper:.3g} {part.unit}".rstrip()
            why = open_ if np.isfinite(low) else self.why
        return Claim(part.label, status, low, upper, time_s, part.unit, required, why)


@dataclass(frozen=True, eq=False)
class Evidence:
    """The enclosed motions on which the proofs of a plan rest.

    Attributes:
        plan: The plan.
        path: The true motion; of a retimed plan only the coordinates, over the path's own time.
        plan_q: Models of the plan's own coordinates on the same cells.
    """

    plan: Plan
    path: EnclosedMotion
    plan_q: list[Model]

    def motion_for(self, reads: frozenset[str]) -> EnclosedMotion:
        """Return an enclosed motion that has all quantities named in `reads`: "q", "u", "du"."""
        if self.path.retimed is None or reads <= self.path.reads:
            return self.path
        return self._motion_over_time if "q" in reads else self._inputs_over_time

    def refine(self, motion: EnclosedMotion, coarse: CellChoice) -> EnclosedMotion:
        """Enclose the same motion again, with each cell that `coarse` selects split further."""
        plan, source = self.plan, replace(motion.source, halvings=InputSource.halvings)
        start = plan.problem.start if "q" in motion.reads else None
        if motion is self.path and start is not None:
            return replace(motion, enclosure=enclose_trajectory(plan.trajectory, start, coarse)[1])
        return replace(motion, enclosure=resolve(source, start, coarse))

    @cached_property
    def _inputs_over_time(self) -> EnclosedMotion:
        """Enclosed inputs of a retimed plan, as functions of the plan's time."""
        assert self.path.retimed is not None
        source = source_of(self.path.retimed)
        reads = frozenset({"u", "du"})
        return EnclosedMotion(resolve(source), source, reads, why=STANDSTILL_REASON)

    @cached_property
    def _motion_over_time(self) -> EnclosedMotion:
        """Enclosed inputs and coordinates of a retimed plan, as functions of the plan's time."""
        plan, inputs = self.plan, self._inputs_over_time
        cells, u = inputs.enclosure.cells, inputs.enclosure.u
        enclosure = enclose(plan.trajectory, cells, u, plan.problem.start)
        return replace(inputs, enclosure=enclosure, reads=frozenset({"q", "u", "du"}))


@dataclass(frozen=True, eq=False)
class Obligation:
    """A statement still to prove: some functions are ≥ 0 at all times.

    Attributes:
        part: Gives the label and unit of the claim.
        margins: The functions, each as (sign, value, limit) for sign · value + limit.
        motion: The motion of which the values are functions.
        tolerance: Largest allowed distance of the least value below zero.
        required: Whether the problem requires the statement to hold.
        margin_at: Computes the margin from coordinates (N,) and inputs (2,), if the functions share
            only the sign of the margin; else None.
    """

    part: Part
    margins: list[Margin]
    motion: EnclosedMotion
    tolerance: float
    required: bool = True
    margin_at: Callable[[Array, Array], float] | None = None


Proof = Obligation | Claim


def decide(proofs: list[Proof]) -> list[Claim]:
    """Return one claim for each proof, in order: obligations are decided, claims kept as given."""
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
            fields = each.part, each.tolerance, least, most, when, each.required, why
            verdicts[id(each)] = motion.claim(*fields)
    return [verdicts.get(id(each), each) for each in proofs]  # type: ignore[arg-type]
