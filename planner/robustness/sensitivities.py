"""Sensitivities of several plans of one problem, side by side.

Start and goal alone decide the irreducible part of every total; what is left to choose between
plans is the passive block, which the path decides.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.machine.feedforward.legs import compensable
from planner.plan.measures import effort, effort_unit, turns
from planner.plan.plan import COMPENSATED, Plan, expect_plan
from planner.problem.problem import Problem
from planner.robustness.sensitivity import PAPER_SPREAD, Sensitivity, sensitivity
from planner.support.arrays import Array
from planner.support.package import import_function
from planner.support.tables import Column, number
from planner.systems.triangular_system import TriangularSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ALIKE = 0.02
"""Passive blocks that differ by less, relative to the least, are called alike: 0.01 degrees of the
0.5 that are usual, which no encoder of the prototype tells."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """The sensitivities of several plans.

    Attributes:
        found: The sensitivities of each plan, by its label.
        spread: Standard deviations of the errors; see `Sensitivity.total_deg`.
    """

    found: Mapping[str, Sensitivity]
    spread: Mapping[str, float]

    def __repr__(self) -> str:
        blocks = ", ".join(
            f"{label} {value:.3g}" for label, value in self.passive_block_deg.items()
        )
        return f"Sensitivities(passive block in deg: {blocks})"

    @property
    def system(self) -> TriangularSystem:
        """The system of all plans."""
        return next(iter(self.found.values())).plan.problem.system

    @property
    def passive_block_deg(self) -> dict[str, float]:
        """The passive block of each plan, degrees."""
        return {k: each.passive_block_deg(self.spread) for k, each in self.found.items()}

    @property
    def sentence(self) -> str:
        """What the plans differ in, in one sentence."""
        blocks = self.passive_block_deg
        least, most = min(blocks, key=lambda k: blocks[k]), max(blocks, key=lambda k: blocks[k])
        low, high = blocks[least], blocks[most]
        floors = [each.floor_deg(self.spread) for each in self.found.values()]
        floor = f"{_degrees(max(floors))} deg of each total is irreducible"
        if high - low <= ALIKE * low:
            return f"The passive block is {_degrees(low)} deg for every plan; {floor}."
        return (
            f"The passive block, which the path decides, is least for {least} ({_degrees(low)} deg)"
            f" and largest for {most} ({_degrees(high)} deg, {high / low:.2g} times as much);"
            f" {floor}."
        )

    @property
    def verdict(self) -> str:
        """Whether the least total is worth its effort, at what price, and what to run next."""
        spent = {k: effort(each.plan.trajectory) for k, each in self.found.items()}
        totals = {k: each.total_deg(self.spread) for k, each in self.found.items()}
        cheapest, calm = (min(each, key=lambda k: each[k]) for each in (spent, totals))
        if calm == cheapest:
            said = f"{calm} has the least total and the least effort"
        else:
            gain = worth(totals[cheapest], totals[calm], spent[calm] / spent[cheapest])
            said = f"{calm} instead of {cheapest}: {gain}"
        return f"{said}. {next_step(self.found[cheapest].plan.problem, cheapest, calm)}"

    @property
    def sizes(self) -> list[tuple[float, str]]:
        """Standard deviation and unit of each error that has one."""
        first = next(iter(self.found.values()))
        sigma = first.standard_deviation(self.spread)
        return [(float(sigma[p]), first.units[p]) for p in np.flatnonzero(sigma)]

    @property
    def responses(self) -> tuple[list[str], dict[str, Array]]:
        """Names of the m errors of `sizes`, and by label each plan's response to them.

        It is the root sum of squares of all angles at the end, shape (m,), degrees, for one
        standard deviation.
        """
        first = next(iter(self.found.values()))
        keep = np.flatnonzero(first.standard_deviation(self.spread))
        values = {k: each.contribution_deg(self.spread) for k, each in self.found.items()}
        return (
            [first.parameters[p] for p in keep],
            {k: np.linalg.norm(each[:, keep], axis=0) for k, each in values.items()},
        )

    def columns(self) -> list[Column[str]]:
        """A label's numbers, as tables show them."""
        found, spread = self.found, self.spread

        def spent(label: str) -> float:
            return effort(found[label].plan.trajectory)

        return [
            Column("plan", "", lambda k: k, left=True, code=True),
            Column("passive block", "deg", lambda k: found[k].passive_block_deg(spread), _degrees),
            Column("total", "deg", lambda k: found[k].total_deg(spread), _degrees),
            Column("irreducible", "deg", lambda k: found[k].floor_deg(spread), _degrees),
            Column("effort", effort_unit(self.system), spent, number),
            Column("turns", "", lambda k: len(turns(found[k].plan.trajectory))),
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready: what `Sensitivity.to_dict` has of each plan, and the sentence."""
        plans = {k: each.to_dict(self.spread) for k, each in self.found.items()}
        return {"plans": plans, "sentence": self.sentence, "verdict": self.verdict}

    def figure(self) -> Figure:
        """Response of each plan, whole and to each error."""
        figure: tuple[Figure, Any] = import_function(
            "planner.report.figures.sensitivities.plot_sensitivities"
        )(self)
        return figure[0]


def worth(before: float, after: float, price: float, cost: str = "effort") -> str:
    """Whether a smaller response is worth its price, without a full stop.

    It is if the response falls by a larger factor than the cost rises.

    Args:
        before: Response of the cheaper plan at the end, degrees.
        after: Response of the other one, degrees.
        price: Cost of the other one as a multiple of the cheaper plan's.
        cost: What is spent.
    """
    worth_it = after * price < before
    less = f"the total falls by {100 * (1 - after / before):.0f} %"
    less += (
        f" ({_degrees(before)} to {_degrees(after)} deg) for {number(price, 2)} times the {cost}"
    )
    why = "a larger factor than its price" if worth_it else "a smaller factor than its price"
    return f"{'worth it' if worth_it else 'not worth it'}, {less}, {why}"


def next_step(problem: Problem, *methods: str) -> str:
    """What to run after a sensitivity: compensated plans first, where there are any, as a sentence.

    Args:
        problem: What the plans solve.
        methods: Labels of plans to set side by side.
    """
    names = dict.fromkeys(methods)
    words = "Next, see the plans on machines"
    if compensable(problem.system):
        words = "Next, compensate: on arms it takes away more than any path does"
        names = dict.fromkeys(re.sub(r"^\w+", rf"\g<0> {COMPENSATED}", k) for k in names)
    command = shlex.join(["planner", "compare", problem.source, "--methods", ",".join(names)])
    return f"{words}: {command}"


MEANINGS = (
    "Passive block: what errors of the start of joint 1 (of a vehicle: of its first angle) and of"
    " the gain of u2 do to the angles after it, at the end; the path decides it. Irreducible: what"
    " start and goal alone decide; no path changes it. Total: all, as root of the sum of squares."
)
"""What the words of the tables mean."""


def _degrees(angle: float) -> str:
    return f"{angle:.3f}"


def sensitivities(
    plans: Mapping[str, Plan | None], spread: Mapping[str, float] = PAPER_SPREAD
) -> Sensitivities:
    """Compute the first-order sensitivities of several plans.

    Args:
        plans: Plans by label, for example `comparison.plans`. Those that cannot be executed, and
            labels without a plan, are left out; a refused plan that can be executed is not.
        spread: Standard deviations of the errors; see `Sensitivity.total_deg`.

    Raises:
        InputError: If no plan is left, one is compensated, or the plans are of several systems.
    """
    for plan in filter(None, plans.values()):
        expect_plan(plan)
    known = {k: plan for k, plan in plans.items() if plan is not None and plan.executable}
    if not known:
        raise InputError("there is no executable plan to compute sensitivities of")
    if len({plan.problem.system for plan in known.values()}) > 1:
        raise InputError("the plans are of several systems; compare plans of one")
    return Sensitivities({k: sensitivity(plan) for k, plan in known.items()}, spread)
