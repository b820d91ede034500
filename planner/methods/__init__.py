"""The methods that make plans: one file each, one registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from planner.methods.collocation import plan_collocation
from planner.methods.convex import plan_convex
from planner.methods.desensitised import plan_desensitised
from planner.methods.piecewise import plan_piecewise
from planner.methods.polynomial import plan_polynomial
from planner.methods.replan import replan_collocation
from planner.methods.sinusoid import plan_sinusoid
from planner.methods.sinusoid_steps import plan_sinusoid_steps
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
    """

    name: str
    summary: str
    options: type[Any]
    plan: Callable[[Problem, Any], Plan]
    replan: Callable[[Problem, Any, Plan], Plan] | None = None
    refines: str | None = None


_ALL = (
    Method(
        "polynomial",
        "the paper's law: v1 constant, v2 polynomial, with constraint points",
        PolynomialOptions,
        plan_polynomial,
    ),
    Method(
        "piecewise",
        "multirate: v1 constant, v2 piecewise constant",
        PiecewiseOptions,
        plan_piecewise,
    ),
    Method(
        "sinusoid",
        "one period of v1 = a0 + a1 sin wt, v2 = sum of bj cos jwt",
        SinusoidOptions,
        plan_sinusoid,
    ),
    Method(
        "sinusoid_steps",
        "z1, z2 first, then one further coordinate by each period of sinusoids",
        SinusoidStepsOptions,
        plan_sinusoid_steps,
    ),
    Method(
        "collocation",
        "optimal plans in the coordinates themselves, within all limits, by direct collocation",
        CollocationOptions,
        plan_collocation,
        replan_collocation,
    ),
    Method(
        "convex",
        "optimal in the chart: v1 constant, v2 on pieces; global with a gap, or a certificate",
        ConvexOptions,
        plan_convex,
    ),
    Method(
        "desensitised",
        "least response to errors of inputs, start and constants, weighed against effort",
        DesensitisedOptions,
        plan_desensitised,
        refines="collocation",
    ),
)

METHODS = {method.name: method for method in _ALL}
