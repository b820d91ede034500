"""The methods that make plans: one file each, one registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from planner.plan import Plan
from planner.problem import Problem
from planner.schema.desensitised import DesensitisedOptions
from planner.schema.methods import (
    CollocationOptions,
    ConvexOptions,
    PiecewiseOptions,
    PolynomialOptions,
    SinusoidOptions,
    SinusoidStepsOptions,
)


@dataclass(frozen=True)
class Method:
    """An entry of the registry.

    Attributes:
        name: As users write it; also the name of its `[method.*]` table.
        summary: One line for listings.
        options: The table of its options.
        plan: From problem and options to a plan that is not verified yet.
        replan: The same from a plan of a neighbouring problem, or None.
        refines: The method whose plan it starts from, or None. Where that finds none this finds
            none, so that `check` does not try it.
        finds_time: Whether it says itself that a duration is too short, and finds one that is not.
    """

    name: str
    summary: str
    options: type[Any]
    plan: Callable[[Problem, Any], Plan]
    replan: Callable[[Problem, Any, Plan], Plan] | None = None
    refines: str | None = None
    finds_time: bool = False


def _later(module: str, name: str) -> Callable[..., Plan]:
    """A method's function, whose module (and with it, say, OSQP) is imported when it is called."""

    def call(*arguments: Any) -> Plan:
        plan: Plan = getattr(import_module(f"{__name__}.{module}"), name)(*arguments)
        return plan

    return call


_ALL = (
    Method(
        "polynomial",
        "the paper's law: v1 constant, v2 polynomial, with constraint points",
        PolynomialOptions,
        _later("polynomial", "plan_polynomial"),
    ),
    Method(
        "piecewise",
        "multirate: v1 constant, v2 piecewise constant",
        PiecewiseOptions,
        _later("piecewise", "plan_piecewise"),
    ),
    Method(
        "sinusoid",
        "one period of v1 = a0 + a1 sin wt, v2 = sum of bj cos jwt",
        SinusoidOptions,
        _later("sinusoid", "plan_sinusoid"),
    ),
    Method(
        "sinusoid_steps",
        "z1, z2 first, then one further coordinate by each period of sinusoids",
        SinusoidStepsOptions,
        _later("sinusoid_steps", "plan_sinusoid_steps"),
    ),
    Method(
        "collocation",
        "optimal plans in the coordinates themselves, within all limits, by direct collocation",
        CollocationOptions,
        _later("collocation", "plan_collocation"),
        _later("replan", "replan_collocation"),
        finds_time=True,
    ),
    Method(
        "convex",
        "the optimal path in the chart: global with a gap, or a certificate that there is none",
        ConvexOptions,
        _later("convex", "plan_convex"),
    ),
    Method(
        "desensitised",
        "least response to errors of inputs, start and constants, weighed against effort",
        DesensitisedOptions,
        _later("desensitised", "plan_desensitised"),
        refines="collocation",
        finds_time=True,
    ),
)

METHODS = {method.name: method for method in _ALL}
