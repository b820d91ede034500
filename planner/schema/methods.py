"""The `[method.*]` tables: the options of each method."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from planner.schema.base import Table

Point = Annotated[list[float], Field(min_length=2, max_length=2)]


class PolynomialOptions(Table):
    """Options of the paper's polynomial law."""

    points: list[Point] = Field(
        default_factory=list, description="Constraint points [time in s, z2], eq. (28)."
    )
    travel: Literal["auto", "middle"] = Field(
        "auto",
        description="When goal.travel is free: the travel of least peak input inside the chart's"
        " domain, or the middle of the widest range of travels that stay inside.",
    )
    offset: float | None = Field(
        None,
        description="Travel of the first of two legs when z1(0) = z1(T); mean of z(0) if left out.",
    )
    allow_singular: bool = Field(
        False,
        description="Return a path outside the chart's domain for study; it cannot be executed.",
    )


class CollocationOptions(Table):
    """Options of direct collocation."""

    intervals: Annotated[int, Field(ge=1, le=2000)] = Field(40, description="Mesh intervals.")
    degree: Annotated[int, Field(ge=1, le=5)] = Field(
        3, description="Collocation points an interval."
    )
    scheme: Literal["radau", "legendre"] = Field(
        "radau", description="Radau (order 2d-1) or Gauss-Legendre (order 2d) points."
    )
    input: Literal["auto", "constant", "linear"] = Field(
        "auto",
        description="Input in an interval: constant, or continuous and linear. auto: linear when a"
        " rate limit or rest asks for continuity.",
    )
    rest: bool = Field(False, description="Inputs zero at both ends.")
    start: Literal["auto", "straight", "bump", "reverse"] = Field(
        "auto", description="First guess; auto tries several and names the winner."
    )
    tolerance: Annotated[float, Field(gt=0, lt=1e-2)] = Field(1e-9, description="Solver tolerance.")
    max_iterations: Annotated[int, Field(ge=1)] = Field(
        500, description="Solver iterations a start."
    )


class MethodsTable(Table):
    """One table a method."""

    polynomial: PolynomialOptions = Field(default_factory=PolynomialOptions)
    collocation: CollocationOptions = Field(default_factory=CollocationOptions)
