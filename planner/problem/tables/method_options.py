"""The `[method.*]` tables: the options of each method.

The `[method.desensitised]` table.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator
from pydantic.fields import FieldInfo

from planner.support.user_tables import Table

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
        False,
        description="Whether the disk may turn back more often than in the plan of least effort."
        " Each turn costs passive joints their backlash and shaft torsion, of which the response"
        " knows nothing: true is for machines without.",
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


Point = Annotated[list[float], Field(min_length=2, max_length=2)]

MOST_POINTS = 20
"""Each raises the degree of v2 by one; conditions on polynomials of more have no digit left."""


class LawOptions(Table):
    """Options of every law of the chained form."""

    criterion: Literal["peak", "margin"] = Field(
        "peak",
        description="What a choice left to the law makes best, among motions inside the chart's"
        " domain and within limits: the smallest peak input (over its limit where it has one), or"
        " the largest margin to the domain's edge, ties to the smaller peak.",
    )
    allow_singular: bool = Field(
        False,
        description="Return a path outside the chart's domain for study; it cannot be executed.",
    )


class LegOptions(LawOptions):
    """Options of laws with v1 constant on each leg."""

    travel: Literal["auto", "middle"] = Field(
        "auto",
        description="When goal.travel is free: the travel that is best by `criterion`, or the"
        " middle of the widest range of travels that stay inside the chart's domain.",
    )
    offset: float | Literal["auto", "mean"] = Field(
        "auto",
        description="Travel of the first of two legs when z1(0) = z1(T), not zero. auto: chosen by"
        " `criterion`; mean: the paper's rule, the mean of z(0), often a poor one.",
    )

    @field_validator("offset", mode="before")
    @classmethod
    def _was_left_out(cls, offset: object) -> object:
        return "mean" if offset is None else offset  # in plans of earlier versions


class PolynomialOptions(LegOptions):
    """Options of the paper's polynomial law."""

    points: Annotated[list[Point], Field(max_length=MOST_POINTS)] | Literal["auto"] = Field(
        default_factory=list,
        description=f"Constraint points [time in s, z2], eq. (28), at most {MOST_POINTS}; or"
        " 'auto': as many as help, at most two, chosen by `criterion` together with the travel"
        " where that is free.",
    )


class PiecewiseOptions(LegOptions):
    """Options of the piecewise constant (multirate) law."""

    slots: Annotated[int, Field(ge=1, le=200)] | None = Field(
        None,
        description="Slots of constant v2: at least N-1, the number taken when left out; with more"
        " the least integral of v2^2 is taken. With two legs, slots of each leg.",
    )


class SinusoidOptions(LawOptions):
    """Options of the sinusoids all at once."""

    amplitude: float | Literal["auto"] = Field(
        "auto",
        description="a1/omega in the unit of z1, not zero: z1 leaves its straight line by up to"
        " twice this. 'auto': chosen by `criterion` together with the travel where that is free.",
    )

    @field_validator("amplitude")
    @classmethod
    def _moves(cls, amplitude: float | str) -> float | str:
        if amplitude == 0:
            raise ValueError("is not zero: without it the law cannot reach z4 and beyond")
        return amplitude


class SinusoidStepsOptions(LawOptions):
    """Options of the sinusoids step by step."""

    amplitude: float | list[float] | Literal["auto"] = Field(
        "auto",
        description="alpha/omega in the unit of z1, not zero, one number or one a step: z1 swings"
        " by twice this in each period. 'auto': one number chosen by `criterion` together with the"
        " travel where that is free.",
    )
    shares: list[Annotated[float, Field(gt=0)]] | None = Field(
        None,
        description="Parts of the duration given to the first leg and to each of the N-2 periods;"
        " equal when left out. They change speeds, not the path.",
    )

    @field_validator("amplitude")
    @classmethod
    def _moves(cls, amplitude: float | list[float] | str) -> float | list[float] | str:
        if amplitude == 0 or (isinstance(amplitude, list) and 0 in amplitude):
            raise ValueError("is not zero: a period without it moves nothing")
        return amplitude


class CollocationOptions(Table):
    """Options of direct collocation."""

    intervals: Annotated[int, Field(ge=1, le=2000)] | Literal["auto"] = Field(
        "auto",
        description="Mesh intervals to begin with. auto: 14 for a straight line's neighbourhood in"
        " a given time with a linear input; else 40 for paths, and as many for a motion as its"
        " length wants, at least 80 where the duration is free.",
    )
    degree: Annotated[int, Field(ge=1, le=5)] = Field(
        3, description="Collocation points an interval."
    )
    scheme: Literal["radau", "legendre"] = Field(
        "legendre", description="Gauss-Legendre (order 2d) or Radau (order 2d-1) points."
    )
    input: Literal["auto", "linear", "constant"] = Field(
        "auto",
        description="Input in an interval: linear, and continuous over all; or constant, which may"
        " jump. auto: linear.",
    )
    rest: bool = Field(False, description="Inputs zero at both ends.")
    objective: Literal["auto", "effort", "smooth", "edge", "time", "mixed"] = Field(
        "auto",
        description="What is made least. effort: the integral of u1^2 + u2^2, for a fixed duration."
        " smooth: that of the squared input rates, likewise. edge: closeness to the edge of the"
        " chart's domain, the mean over time of the sum over its margins of exp(-margin/0.05), with"
        " 1 % of weight on the effort, likewise."
        " time: the duration, with 1 % of weight on the effort relative to the input limits (which"
        " must be given), so it comes within 2 % of the least. mixed: the duration and the others,"
        " weighted. auto: effort if the duration is fixed; else time if both inputs are limited;"
        " else mixed.",
    )
    effort_weight: Annotated[float, Field(gt=0)] = Field(
        1.0, description="Weight of the effort beside the duration in the objective 'mixed'."
    )
    smoothness_weight: Annotated[float, Field(ge=0)] = Field(
        0.0, description="Weight of the squared input rates' integral in the objective 'mixed'."
    )
    edge_weight: Annotated[float, Field(ge=0)] = Field(
        0.0, description="Weight of the closeness to the domain's edge in the objective 'mixed'."
    )
    start: Literal["auto", "straight", "polynomial", "convex", "bump", "reverse", "wander"] = Field(
        "auto",
        description="First guess. straight: a line; bump: the path coordinate goes out and back;"
        " reverse: it leaves the line and returns late; wander: smooth random loops from fixed"
        " seeds. auto: the line where one way suffices; else some of each, and the best kept."
        " polynomial, convex: deprecated, the same as auto (those methods' plans led to no better"
        " motions).",
    )
    starts: Annotated[int, Field(ge=1)] = Field(
        10,
        description="Paths found before the best is taken (start = 'auto' or 'wander'). With 'auto'"
        " a path whose drive never turns back is enough by itself, and so is one that is found"
        " three times.",
    )
    variations: Annotated[int, Field(ge=0)] = Field(
        0, description="Deprecated: accepted, without effect. More `attempts` search further."
    )
    attempts: Annotated[int, Field(ge=1)] = Field(
        16,
        description="First guesses tried at most before giving up; with start = 'auto' three times"
        " as many more where every motion found is too slow for the duration given.",
    )
    accuracy: Annotated[float, Field(gt=0, lt=1e-2)] = Field(
        5e-6,
        description="Largest difference at the end, in radians, between the plan's q(t) and the"
        " motion its input really makes (ten times that on the way); the mesh is refined until it"
        " is kept.",
    )
    refinements: Annotated[int, Field(ge=0, le=10)] = Field(
        4, description="Times the mesh may be refined; 0 keeps the mesh as given."
    )
    solver: Literal["auto", "fatrop", "ipopt"] = Field(
        "auto",
        description="Who solves the nonlinear programme. auto: Fatrop, which knows the stages,"
        " next to the answer and near a straight line in a given time; IPOPT elsewhere and where"
        " Fatrop fails.",
    )
    compile: bool = Field(
        False,
        description="Compile the functions of one mesh interval with the C compiler (cc, gcc, clang"
        " or $CC): a second or two the first time, kept in the user's cache folder.",
    )
    tolerance: Annotated[float, Field(gt=0, lt=1e-2)] = Field(1e-9, description="Solver tolerance.")
    max_iterations: Annotated[int, Field(ge=1)] = Field(
        500, description="Solver iterations a start."
    )
    time_limit_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        None,
        description="Seconds after which the best verified plan found so far is the answer, and"
        " says so in its status, or a refusal that says how far the search came. No limit if left"
        " out.",
    )

    @field_validator("start")
    @classmethod
    def _still_known(cls, start: str) -> str:
        return "auto" if start in ("polynomial", "convex") else start


class ConvexOptions(Table):
    """Options of the path in chained coordinates that is optimal among those of one class."""

    objective: Literal["smooth", "peak"] = Field(
        "smooth",
        description="What is least: the integral of (dz2/dz1)^2 over |z1| (at one travel and"
        " duration, and v1 constant, the same as that of v2^2); or the greatest |v2|, v1 constant.",
    )
    pieces: Annotated[int, Field(ge=2, le=400)] = Field(60, description="Equal pieces of v2.")
    input: Literal["auto", "constant", "linear"] = Field(
        "auto",
        description="v2/v1 constant on each piece, or continuous and linear. auto: linear when"
        " input rates have a limit, since a jump has no finite rate.",
    )
    travel: Literal["auto", "middle"] = Field(
        "auto",
        description="When goal.travel is free: the travel of the best objective, or the middle of"
        " the range of travels that have a path.",
    )
    scan: Annotated[int, Field(ge=3, le=1000)] = Field(
        25, description="Travels tried before the search is refined about the best."
    )
    edge: Annotated[float, Field(ge=0, lt=0.1)] = Field(
        1e-6,
        description="Least distance from the chart's edge: sin^2 of theta1 for n = 2 and 3, every"
        " margin elsewhere; half the distance of start or goal where that is less.",
    )
    solver: Literal["auto", "osqp"] = Field(
        "auto",
        description="Who solves the quadratic programmes: an active set, and OSQP where that is not"
        " accurate (auto); or OSQP first.",
    )
    max_cuts: Annotated[int, Field(ge=1)] = Field(
        100, description="Rounds of cutting planes allowed at one travel."
    )


class MethodsTable(Table):
    """One table a method."""

    polynomial: PolynomialOptions = Field(default_factory=PolynomialOptions)
    piecewise: PiecewiseOptions = Field(default_factory=PiecewiseOptions)
    sinusoid: SinusoidOptions = Field(default_factory=SinusoidOptions)
    sinusoid_steps: SinusoidStepsOptions = Field(default_factory=SinusoidStepsOptions)
    collocation: CollocationOptions = Field(default_factory=CollocationOptions)
    convex: ConvexOptions = Field(default_factory=ConvexOptions)
    desensitised: DesensitisedOptions = Field(default_factory=DesensitisedOptions)

    @classmethod
    def add(cls, name: str, options: type[Table]) -> None:
        """A further table; tables that hold this one are built anew by the caller."""
        # The class stays the same object: problems that there are, and pickled ones, stay good.
        cls.model_fields[name] = FieldInfo(annotation=options, default_factory=options)
        cls.model_rebuild(force=True)
