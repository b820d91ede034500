"""The `[method.desensitised]` table."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from planner.schema.base import Table

Weight = Annotated[float, Field(ge=0)]
Size = Annotated[float, Field(ge=0)]
Sizes = Size | Annotated[list[Size], Field(min_length=1)]


class DesensitisedOptions(Table):
    """Options of plans that are made insensitive to errors of inputs, start and constants."""

    passive: Weight = Field(
        1.0,
        description="Weight of the passive block squared (deg^2): the response of theta2 ... thetan"
        " to the start of theta1 and the gain of u2.",
    )
    terminal: Weight = Field(
        1.0, description="Weight of the whole terminal response squared (deg^2)."
    )
    path: Weight = Field(
        0.0, description="Weight of the response squared, averaged along the path (deg^2)."
    )
    effort: Annotated[float, Field(gt=0)] = Field(
        0.005, description="Weight of the integral of u1^2 + u2^2: what the trade-off turns on."
    )
    time: Annotated[float, Field(gt=0)] = Field(
        0.01, description='Weight of the duration in s when goal.duration = "free".'
    )
    effort_limit: Annotated[float, Field(gt=0)] | None = Field(
        None, description="Largest integral of u1^2 + u2^2 allowed; none when left out."
    )
    gain: Sizes = Field(0.01, description="Spread of the input gains (fraction); one or two.")
    bias: Sizes = Field(0.0, description="Spread of the input biases (rad/s); one or two.")
    delay_s: Sizes = Field(0.0, description="Spread of the inputs' delays (s); one or two.")
    stretch: Sizes = Field(
        0.0, description="Spread of the inputs' clock rates (fraction); one or two."
    )
    start_deg: Sizes = Field(
        0.5, description="Spread of the angles at the start (deg); one number, or one an angle."
    )
    start_m: Sizes = Field(
        0.005, description="Spread of the lengths at the start (m), where a system has such."
    )
    gear: Sizes = Field(0.0, description="Spread of K2 ... Kn (fraction); one number, or n-1.")
    backoff: Annotated[float, Field(ge=0, le=6)] = Field(
        0.0,
        description="Limits on joints and z2 are kept with a margin of so many standard deviations"
        " of the errors above, everywhere along the path.",
    )
    reversal: bool = Field(
        True, description="Whether the first input may change its sign; false: one way only."
    )
    starts: Annotated[int, Field(ge=1, le=20)] = Field(
        4, description="First guesses tried; the best plan is kept and its start named."
    )
    intervals: Annotated[int, Field(ge=4, le=1000)] = Field(40, description="Mesh intervals.")
    input: Literal["auto", "constant", "linear"] = Field(
        "auto",
        description="Input in an interval: constant, or continuous and linear. auto: linear when a"
        " rate limit or rest asks for continuity.",
    )
    rest: bool = Field(False, description="Inputs zero at both ends.")
    accuracy: Annotated[float, Field(gt=0, lt=1e-2)] = Field(
        5e-6,
        description="Largest difference at the end, in radians, between the plan's q(t) and the"
        " motion its input really makes; the mesh is refined until it is kept.",
    )
    tolerance: Annotated[float, Field(gt=0, lt=1e-2)] = Field(1e-8, description="Solver tolerance.")
    max_iterations: Annotated[int, Field(ge=1)] = Field(
        200,
        description="Solver iterations a start; a motion that keeps every limit counts even where"
        " its optimality has not settled by then.",
    )
