"""Compare the sensitivities of several plans of one problem.

The floor of each total depends only on start and goal. Plans differ in the passive
block, which depends on the path.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import InputError, expect
from planner.machine.feedforward.legs import compensable
from planner.methods.registry import parse_spec
from planner.plan.measures import effort, effort_unit, turns
from planner.plan.plan import Plan, expect_plan
from planner.plan.spec import Spec
from planner.problem.problem import Problem
from planner.problem.settings import problem_words
from planner.robustness.sensitivity import MEANINGS, PAPER_SPREAD, Sensitivity, sensitivity
from planner.support.arrays import Array, Frozen
from planner.support.package import Figure, Table, draw_figure, import_function
from planner.support.tables import Column, CommandLine, number, terminal_table
from planner.systems.triangular_system import TriangularSystem

ALIKE = 0.02
"""Relative difference below which passive blocks count as equal: 0.01 degrees of a usual block of
0.5 degrees, less than the resolution of the prototype's encoders."""


@dataclass(frozen=True, eq=False)
class Sensitivities(Frozen):
    """The sensitivities of several plans.

    Attributes:
        plans: The sensitivities of the plans by label.
        spread: Standard deviations of the errors; see `Sensitivity.total_deg`.
    """

    plans: Mapping[str, Sensitivity]
    spread: Mapping[str, float]

    def __repr__(self) -> str:
        blocks = ", ".join(f"{k} {value:.3g}" for k, value in self.passive_block_deg.items())
        return f"Sensitivities(passive block in deg: {blocks})"

    @property
    def system(self) -> TriangularSystem:
        """The system of all plans."""
        return next(iter(self.plans.values())).plan.problem.system

    @property
    def passive_block_deg(self) -> dict[str, float]:
        """The passive block of each plan, degrees."""
        return {k: each.passive_block_deg(self.spread) for k, each in self.plans.items()}

    @property
    def sentence(self) -> str:
        """How the plans differ, in one sentence."""
        blocks = self.passive_block_deg
        least, most = min(blocks, key=lambda k: blocks[k]), max(blocks, key=lambda k: blocks[k])
        low, high = blocks[least], blocks[most]
        floors = [each.floor_deg(self.spread) for each in self.plans.values()]
        floor = f"{_degrees(max(floors))} deg of each total is the floor"
        if high - low <= ALIKE * low:
            return f"The passive block is {_degrees(low)} deg for every plan; {floor}."
        return (
            f"The passive block, which the path decides, is smallest for {least} ({_degrees(low)}"
            f" deg) and largest for {most} ({_degrees(high)} deg, {high / low:.3g} times as much);"
            f" {floor}."
        )

    @property
    def verdict(self) -> CommandLine:
        """Whether the smallest total is worth its effort, and which command to run next."""
        spent = {k: effort(each.plan.trajectory) for k, each in self.plans.items()}
        totals = {k: each.total_deg(self.spread) for k, each in self.plans.items()}
        cheapest, calm = (min(each, key=lambda k: each[k]) for each in (spent, totals))
        if calm == cheapest:
            text = f"{calm} has the smallest total and the least effort"
        else:
            floor = self.plans[cheapest].floor_deg(self.spread)
            gain = worth(totals[cheapest], totals[calm], floor, spent[calm] / spent[cheapest])
            text = f"{calm} instead of {cheapest}: {gain}"
        both = {label: self.plans[label].plan for label in (cheapest, calm)}
        step = next_step(both[cheapest].problem, *map(_spec, both, both.values()))
        return CommandLine(f"{text}. {step}")

    @property
    def sizes(self) -> list[tuple[float, str]]:
        """Standard deviation and unit of each error with a nonzero standard deviation."""
        first = next(iter(self.plans.values()))
        sigma = first.standard_deviation(self.spread)
        return [(float(sigma[p]), first.units[p]) for p in np.flatnonzero(sigma)]

    @property
    def responses(self) -> tuple[list[str], dict[str, Array]]:
        """Names of the m errors of `sizes`, and the response of each plan to them, by label.

        A response is the root sum of squares over all angles at the end, shape (m,), degrees, for
        one standard deviation.
        """
        first = next(iter(self.plans.values()))
        keep = np.flatnonzero(first.standard_deviation(self.spread))
        values = {k: each.contribution_deg(self.spread) for k, each in self.plans.items()}
        return (
            [first.parameters[p] for p in keep],
            {k: np.linalg.norm(each[:, keep], axis=0) for k, each in values.items()},
        )

    @property
    def columns(self) -> list[Column[str]]:
        """The columns of the table; its rows are labels of plans."""
        plans, spread = self.plans, self.spread

        def spent(label: str) -> float:
            return effort(plans[label].plan.trajectory)

        return [
            Column("plan", "", lambda k: k, left=True, width=22, code=True),
            Column("passive block", "deg", lambda k: plans[k].passive_block_deg(spread), _degrees),
            Column("total", "deg", lambda k: plans[k].total_deg(spread), _degrees),
            Column("floor", "deg", lambda k: plans[k].floor_deg(spread), _degrees),
            Column("effort", effort_unit(self.system), spent, number),
            Column("turns", "", lambda k: len(turns(plans[k].plan.trajectory))),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data: `Sensitivity.to_dict` of each plan, sentence and verdict."""
        plans = {k: each.to_dict(self.spread) for k, each in self.plans.items()}
        return {"plans": plans, "sentence": self.sentence, "verdict": self.verdict}

    def table(self) -> Table:
        """Return the table for a terminal, one row per plan: `rich.print(found.table())`."""
        return terminal_table(self.columns, self.plans, caption=MEANINGS)

    def save(self, folder: str | Path) -> Path:
        """Write table, data, figure and plans to a folder, all or nothing.

        Raises:
            InputError: If the folder cannot be written or holds something else.
        """
        return Path(import_function("planner.report.folders.save_sensitivities")(self, folder))

    def plot(self) -> Figure:
        """Draw the total response of each plan and its response to each error."""
        return draw_figure("robustness.plot_sensitivities", self)


def worth(before: float, after: float, floor: float, price: float, cost: str = "effort") -> str:
    """Return in words, without a full stop, whether a smaller response is worth its cost.

    It is if the part that a plan can change falls by a larger factor than the cost rises.

    Args:
        before: Total of the cheaper plan, degrees.
        after: Total of the other plan, degrees.
        floor: The part of both totals that no plan can change, degrees.
        price: Cost of the other plan, as a multiple of the cheaper plan's.
        cost: Name of the cost.
    """
    before, after = (np.sqrt(max(total**2 - floor**2, 0.0)) for total in (before, after))
    worth_it = after * price < before
    return (
        f"{'worth it' if worth_it else 'not worth it'}, the total above its floor falls by"
        f" {100 * (1 - after / before):.0f} % ({_degrees(before)} to {_degrees(after)} deg) for"
        f" {number(price, 2)} times the {cost}, a {'larger' if worth_it else 'smaller'} factor than"
        " the cost"
    )


def _spec(label: str, plan: Plan) -> Spec:
    """Return the spec that a label names; of a label of the user's own, that of its plan."""
    with suppress(InputError):
        spec = parse_spec(label)
        if spec.method == plan.method:
            return spec
    return Spec(plan.method)


def next_step(problem: Problem, *specs: Spec) -> CommandLine:
    """Return a sentence with the command to run next: a comparison, of compensated plans on arms.

    Args:
        problem: The problem of the plans.
        specs: The plans to compare.
    """
    words, end = "Next, compare the plans on machines", problem.methods.collocation.end
    ready = (s.compensated or s.options.get("end", end) == "machine" for s in specs)
    if compensable(problem.system) and not any(ready):
        words = "Next, compensate: on arms this reduces errors more than any path"
        specs = tuple(replace(spec, compensated=True) for spec in specs)
    names = dict.fromkeys(spec.text for spec in specs)
    command = ["planner", "compare", *problem_words(problem), "--methods", ",".join(names)]
    return CommandLine.of(*command, after=f"{words}: ")


def _degrees(angle: float) -> str:
    return f"{angle:.3f}"


def sensitivities(
    plans: Mapping[str, Plan | None], spread: Mapping[str, float] = PAPER_SPREAD
) -> Sensitivities:
    """Compute the first-order sensitivities of several plans.

    Args:
        plans: Plans by label, for example `comparison.plans`. Plans that cannot be executed and
            labels without a plan are left out; refused plans are included if they can be executed.
        spread: Standard deviations of the errors; see `Sensitivity.total_deg`.

    Raises:
        InputError: If no plan is left, the plans have different systems, or they have no labels.
    """
    expect(Mapping, plans, "give plans by label, for example comparison.plans")
    for plan in filter(None, plans.values()):
        expect_plan(plan)
    executable = {k: plan for k, plan in plans.items() if plan is not None and plan.executable}
    if not executable:
        raise InputError("no plan can be executed, so there are no sensitivities to compute")
    if len({plan.problem.system for plan in executable.values()}) > 1:
        raise InputError("the plans are of several systems; compare plans of one")
    return Sensitivities({k: sensitivity(plan) for k, plan in executable.items()}, spread)
