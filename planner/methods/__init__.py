"""The methods that make plans: one file each, one registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from planner.methods.polynomial import plan_polynomial
from planner.plan import Plan
from planner.problem import Problem
from planner.schema import PolynomialOptions


@dataclass(frozen=True)
class Method:
    """An entry of the registry.

    Attributes:
        name: As users write it; also the name of its `[method.*]` table.
        summary: One line for listings.
        options: The table of its options.
        plan: From problem and options to a plan that is not verified yet.
    """

    name: str
    summary: str
    options: type[Any]
    plan: Callable[[Problem, Any], Plan]


_ALL = (
    Method(
        "polynomial",
        "the paper's law: v1 constant, v2 polynomial, with constraint points",
        PolynomialOptions,
        plan_polynomial,
    ),
)

METHODS = {method.name: method for method in _ALL}
