"""Check whether a problem has a plan; if not, report why and which change would help."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.errors import InputError, MethodError, NoPlanError
from planner.methods.keeping import not_promised
from planner.methods.refusal import (
    Change,
    duration_changes,
    path_changes,
    reach_changes,
    try_changes,
)
from planner.methods.registry import METHODS, parse_spec, parse_specs
from planner.plan.measures import DomainReport
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.problem.feasibility import (
    DurationBound,
    End,
    TravelWindow,
    chart_ends_report,
    least_duration,
    travel_window,
    why_too_short,
)
from planner.problem.free_space import why_blocked
from planner.problem.nonholonomy import Nonholonomy, nonholonomy
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.problem.reach import Reach, goal_reach
from planner.solve import solve, solve_and_check
from planner.support.arrays import Frozen
from planner.support.deadline import time_limit, time_share
from planner.support.progress import expect_listener
from planner.support.tables import key_with_unit
from planner.verification.summary import plan_summary, refusal_summary
from planner.verification.verify import verify

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Reversal:
    """Verdict whether the first coordinate must reverse: "needed", "not needed" or "open"."""

    verdict: str
    reason: str


@dataclass(frozen=True)
class Remedy(Frozen):
    """A change of the problem that was tried and gave a verified plan.

    Attributes:
        changes: Dotted keys to values, as `Problem.changed` takes them.
        method: Name of the method that has a plan of the changed problem.
        plan: Summary of that plan, see `planner.verification.summary.summary_keys`.
        words: The changes in words.
    """

    changes: Mapping[str, Any]
    method: str
    plan: dict[str, Any]
    words: str

    def __str__(self) -> str:
        freed = "goal.duration" in self.changes
        took = f", which takes {self.plan['duration_s']:.4g} s" if freed else ""
        return f"{self.words}: the method '{self.method}' then has a verified plan{took} (tried)"

    def to_dict(self) -> dict[str, Any]:
        """Return the remedy as JSON-ready data; undefined numbers are NaN."""
        return {"changes": self.changes, "method": self.method, "plan": self.plan}


@dataclass(frozen=True, eq=False)
class Analysis(Frozen):
    """Result of `check`: whether a problem has a plan, and the evidence.

    Attributes:
        problem: The problem.
        ends: Start and goal in chained coordinates.
        reach: Possible joint angles at a goal that leaves some joints free; None if the goal fixes
            all.
        window: Travels that are possible without a reversal; None if no such window is known.
        reversal: Whether the first coordinate must reverse.
        duration_bound: Lower bound of the duration; no plan is shorter.
        plain_polynomial: The travel, and the times at which the polynomial without constraint
            points leaves the chart's domain and at which z₂ crosses zero; None if not singular.
        nonholonomy: Controllability at the start, at the goal and at θ₁ = 0.
        not_promised: Labels of the requirements that each method does not guarantee to keep, which
            are known before the search (`planner.methods.keeping`).
        outcomes: For each method the summary of its best variant, with the keys of
            `planner.verification.summary.summary_keys` and `label`, the variant.
        refusals: The refusal of each method that has no plan, by label.
        remedy: A change of the problem with which a method has a plan; None if a method has a plan
            of the unchanged problem, or if no change helped.
        in_the_way: The bodies without which a method has a plan, in words, if no change helped;
            else empty.
        ended_early: What ended the search early, in words; None if the search was completed.
    """

    problem: Problem
    ends: tuple[End, End]
    reach: Reach | None
    window: TravelWindow | None
    reversal: Reversal
    duration_bound: DurationBound
    plain_polynomial: tuple[float, DomainReport] | None
    nonholonomy: Nonholonomy
    not_promised: Mapping[str, tuple[str, ...]]
    outcomes: tuple[dict[str, Any], ...]
    refusals: Mapping[str, NoPlanError]
    remedy: Remedy | None
    in_the_way: str = ""
    ended_early: str | None = None

    def __repr__(self) -> str:
        return f"Analysis({self.problem.name!r}: {self.verdict})"

    @property
    def has_plan(self) -> bool:
        """Whether at least one method has a verified plan."""
        return any(o["verified"] for o in self.outcomes)

    @property
    def proven_impossible(self) -> bool:
        """Whether it is proven that no plan of any kind exists."""
        return self._proof is not None

    @property
    def _proof(self) -> str | None:
        """Proof, in words, that no plan of any kind exists; None without a proof."""
        return why_too_short(self.problem) or why_blocked(self.problem)

    @property
    def verdict(self) -> str:
        """Sentences that say whether the problem has a plan, and which change would help."""
        if self.has_plan:
            kinds = [_kind(o) for o in self.outcomes if o["verified"]]
            return f"There is a plan: {'; '.join(kinds)}."
        text = "No plan was found; this alone does not show that none exists."
        if proof := self._proof:
            text = f"{proof[0].upper()}{proof[1:]}."
        elif self.ended_early:
            text += f" ({self.ended_early[0].upper()}{self.ended_early[1:]}.)"
        text += f" {self.in_the_way}" if self.in_the_way else ""
        return text if self.remedy is None else f"{text} Change {self.remedy}."

    def to_dict(self) -> dict[str, Any]:
        """Return the analysis as JSON-ready data; undefined numbers are NaN."""
        system = self.problem.system
        return {
            "problem": self.problem.name,
            "verdict": self.verdict,
            "has_plan": self.has_plan,
            "proven_impossible": self.proven_impossible,
            "constants": system.to_dict() | {"k_g_rule": getattr(system, "k_g_rule", None)},
            "ends": {end.name: end.to_dict() for end in self.ends},
            "reach": None if self.reach is None else self.reach.to_dict(),
            "travel_window": _window_dict(self.problem, self.window),
            "reversal": {"verdict": self.reversal.verdict, "reason": self.reversal.reason},
            "least_duration_s": self.duration_bound.seconds,
            "least_duration_reason": self.duration_bound.reason,
            "plain_polynomial": _polynomial_dict(self.problem, self.plain_polynomial),
            "nonholonomy": self.nonholonomy.to_dict(),
            "not_promised": {name: list(labels) for name, labels in self.not_promised.items()},
            "methods": list(self.outcomes),
            "remedy": None if self.remedy is None else self.remedy.to_dict(),
            "in_the_way": self.in_the_way or None,
            "ended_early": self.ended_early,
        }


def check(
    problem: AnyProblem,
    methods: str | Sequence[str] | None = None,
    progress: Progress | None = None,
    time_limit_s: float | None = None,
) -> Analysis:
    """Examine a problem and try every method on it.

    Args:
        problem: The problem.
        methods: Methods to try, as `compare` takes them. By default every method that does not
            start from the plan of another method; the polynomial also with automatic constraint
            points, and `piecewise` with ten slots, each if it has no plan without.
        progress: Called with one line of text before each slow step.
        time_limit_s: Seconds for the whole analysis. The methods and the search for a remedy share
            the time that remains; see `planner.solve`.

    Raises:
        InputError: If a method is unknown, `problem` is not a `Problem`, `progress` is no function
            or `time_limit_s` is not a number above zero.
    """
    say = expect_listener(progress)
    problem = problem_of(problem)
    unrefined = [Spec(name) for name, method in METHODS.items() if method.refines is None]
    specs = unrefined if methods is None else parse_specs(problem, methods)
    window, reach = travel_window(problem), goal_reach(problem)
    outcomes, refusals = [], dict[str, NoPlanError]()
    remedy, in_the_way = None, ""
    with time_limit(time_limit_s) as span:
        words = f"its share of {span.why}" if time_limit_s is not None else ""
        for k, spec in enumerate(specs):
            say(f"trying {spec.label}")
            variants = [v for v in VARIANTS if methods is None and v.method == spec.label]
            with time_share(1 / (len(specs) - k + 1), words):
                outcomes.append(_outcome(problem, (spec, *variants), refusals))
        if not any(o["verified"] for o in outcomes):
            remedy, in_the_way = find_remedy(problem, [s.label for s in specs], say, reach)
    say("checking the plain polynomial")
    singular = any(o["method"] == "polynomial" and o["status"] == "singular" for o in outcomes)
    return Analysis(
        problem=problem,
        ends=chart_ends_report(problem),
        reach=reach,
        window=window,
        reversal=_reversal(problem, window, outcomes),
        duration_bound=least_duration(problem),
        plain_polynomial=_plain_polynomial(problem, window) if singular else None,
        nonholonomy=nonholonomy(problem),
        not_promised={spec.label: _open_requirements(problem, spec.method) for spec in specs},
        outcomes=tuple(outcomes),
        refusals=refusals,
        remedy=remedy,
        in_the_way=in_the_way,
        ended_early=f"{span.why} ended the search" if span.was_reached else None,
    )


def find_remedy(
    problem: Problem, names: Sequence[str], say: Progress, reach: Reach | None = None
) -> tuple[Remedy | None, str]:
    """Return the first change of the problem that gives a method a verified plan, or None.

    If only a change that removes bodies gives a plan, return what that plan meets, in words.
    """

    def attempt(change: Change) -> Plan:
        return solve_and_check(problem.changed(change.keys), change.method, advice=False)[0]

    nearer = reach_changes(problem, reach) if reach else []
    able = sorted(names, key=lambda name: name != "collocation")  # the most general method first
    every = (*nearer, *duration_changes(problem), *path_changes(problem))
    ordered = sorted(every, key=lambda change: change.solid)
    changes = [replace(change, method=name) for change in ordered for name in able]
    result = try_changes(changes, attempt, say)
    if result.change is None or result.plan is None:
        return None, ""
    if result.change.solid:
        broken = verify(replace(result.plan, problem=problem)).violations
        met = ", ".join(str(v) for v in broken if v.demand is not None and v.demand.solid)
        way = f"Without {result.change.without} the method '{result.change.method}' has a plan"
        return None, f"{way}, in which {met}."
    words = str(replace(result.change, method=""))
    remedy = Remedy(result.change.keys, result.change.method, plan_summary(result.plan), words)
    return remedy, ""


VARIANTS = tuple(map(parse_spec, ("polynomial:points=auto", "piecewise:slots=10")))
"""Variants that `check` tries if their method has no plan, since it does not choose them itself.
With `criterion = "margin"`, other shares, `convex:objective=peak` or `input=linear` no method had a
plan of more of 80 random problems."""


def _outcome(
    problem: Problem, variants: Sequence[Spec], refusals: dict[str, NoPlanError]
) -> dict[str, Any]:
    """Try variants of a method; return the summary of the first plan, or of the first refusal,
    which joins `refusals`."""
    first, refused = variants[0], list[NoPlanError]()
    for spec in variants:
        try:
            found = solve_and_check(problem, spec, advice=False)
            return {"label": spec.label, **plan_summary(*found)}
        except NoPlanError as error:
            refused.append(error)
        except InputError as error:  # the method does not accept such a problem
            refused.append(NoPlanError(error.body, source=error.source))
            refused[-1].status = "bad_input"
    refusals[first.label] = refused[0]
    return {"label": first.label, **refusal_summary(refused[0], first.method, problem.system)}


def _open_requirements(problem: Problem, name: str) -> tuple[str, ...]:
    try:
        return not_promised(problem, METHODS[name].keeps)
    except MethodError:  # the method's outcome reports it
        return ()


def _reversal(
    problem: Problem, window: TravelWindow | None, outcomes: list[dict[str, Any]]
) -> Reversal:
    one_way = [o["label"] for o in outcomes if o["verified"] and o["direction"] == "one way"]
    if one_way:
        return Reversal("not needed", f"the {one_way[0]} plan moves one way")
    if window is None:
        named = "coordinates" if problem.system.has_user_coordinates else "joints"
        what = f"goals that leave {named} free" if problem.free else "this system"
        return Reversal("open", f"no travel window is known for {what}")
    if window.empty:
        return Reversal("needed", window.reason)
    if problem.travel is not None and problem.travel not in window:
        return Reversal("needed", "the travel lies outside the window of motions without reversal")
    if window.exact:
        return Reversal(
            "not needed",
            "motions without reversal exist, if the limits of inputs and joints allow them",
        )
    return Reversal("open", "the window is only a necessary condition for more than 3 joints")


def _plain_polynomial(
    problem: Problem, window: TravelWindow | None
) -> tuple[float, DomainReport] | None:
    """Return travel and domain report of the polynomial plan without constraint points.

    Return None if this plan is not singular, or if no travel is known for it.
    """
    travel = problem.travel
    if travel is None and window is not None and not window.empty and np.isfinite(window.high):
        travel = float(window.low + window.high) / 2
    if travel is None:
        return None
    changes = {"limits": {}, "goal.duration": problem.duration or 1.0}
    try:
        task = problem.with_travel(travel).changed(changes)
        plan = solve(task, "polynomial", points=[], allow_singular=True)
    except (InputError, NoPlanError):
        return None
    return (travel, plan.domain) if plan.status == "singular" else None


def _kind(outcome: dict[str, Any]) -> str:
    where = "inside the chart" if outcome["domain_ok"] else "through the edge of the chart"
    return f"{outcome['label']} ({outcome['direction']}, {where})"


def _window_dict(problem: Problem, window: TravelWindow | None) -> dict[str, Any] | None:
    if window is None:
        return None
    return {
        "low_rad": window.low,
        "high_rad": window.high,
        "exact": window.exact,
        "empty_because": window.reason or None,
        "travel_rad": problem.travel,
        "travel_inside": None if problem.travel is None else problem.travel in window,
    }


def _polynomial_dict(
    problem: Problem, result: tuple[float, DomainReport] | None
) -> dict[str, Any] | None:
    if result is None:
        return None
    travel, report = result
    return {
        key_with_unit("travel", problem.system.coordinates[0].unit): travel,
        "z2_crossings_s": list(report.z2_crossings_s),
        "exits_s": list(report.exits_s),
        "domain_margin": report.margin,
        "domain_margin_time_s": report.time_s,
        "domain_margin_label": report.label,
    }
