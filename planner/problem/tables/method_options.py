"""The `[method.*]` tables: the options of each method.

Everything about an option is defined here once: type, range, default, description, and whether the
explorer has a slider for it. `make generated` writes `planner/methods/options.pyi`, which editors
read, from these tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, field_validator
from pydantic.fields import FieldInfo

from planner.support.user_tables import Pair, Table


@dataclass(frozen=True)
class Slider:
    """Ends of an option's slider in the explorer; integer ends make a slider of integers.

    The slider of an option without these ends is logarithmic around the option's default.
    """

    low: float
    high: float


NO_SLIDER = Slider(0, 0)
"""Mark of an option without slider: set elsewhere on the screen, or only a solver's effort."""

Weight = Annotated[float, Field(ge=0), Slider(0.0, 10.0)]
Size = Annotated[float, Field(ge=0)]
Sizes = Annotated[Size | Annotated[list[Size], Field(min_length=1)], NO_SLIDER]
Rest = Annotated[
    Literal["auto"] | bool,
    Field(
        description="Inputs zero at both ends. auto: if [limits] limits the rates of inputs, so"
        " that motors can carry out the plan as it is."
    ),
]


Intervals = Annotated[Annotated[int, Field(ge=1, le=2000)] | Literal["auto"], Slider(5, 120)]
Accuracy = Annotated[float, Field(gt=0, lt=1e-2), NO_SLIDER]
Iterations = Annotated[int, Field(ge=1), NO_SLIDER]


class DesensitisedOptions(Table):
    """Options of plans that are made insensitive to errors of inputs, start and constants."""

    passive: Weight = 1.0
    """Weight of the passive block squared (deg^2): the response of theta2 ... thetan to the start
    of theta1 and the gain of u2."""
    terminal: Weight = 1.0
    """Weight of the whole terminal response squared (deg^2)."""
    path: Weight = 0.0
    """Weight of the response squared, averaged along the path (deg^2)."""
    effort: Annotated[float, Field(gt=0)] = 0.005
    """Weight of the integral of u1^2 + u2^2, which is traded against the response."""
    time: Annotated[float, Field(gt=0)] = 0.01
    """Weight of the duration in s when goal.duration = "free"."""
    effort_limit: Annotated[float, Field(gt=0)] | None = None
    """Largest allowed integral of u1^2 + u2^2; no limit when left out."""
    gain: Sizes = 0.01
    """Standard deviation of the input gains (fraction); one number or two."""
    bias: Sizes = 0.0
    """Standard deviation of the input biases (rad/s); one number or two."""
    delay_s: Sizes = 0.0
    """Standard deviation of the inputs' delays (s); one number or two."""
    stretch: Sizes = 0.0
    """Standard deviation of the inputs' clock rates (fraction); one number or two."""
    start_deg: Sizes = 0.5
    """Standard deviation of the angles at the start (deg); one number, or one per angle."""
    start_m: Sizes = 0.005
    """Standard deviation of the lengths at the start (m), for systems with lengths."""
    gear: Sizes = 0.0
    """Standard deviation of K2 ... Kn (fraction); one number, or n-1."""
    backoff: Annotated[float, Field(ge=0, le=6), Slider(0.0, 4.0)] = 0.0
    """Limits of joints and z2 are kept along the whole path with a margin of this many standard
    deviations, caused by the errors above."""
    reversal: bool = False
    """Whether the disk may reverse more often than in the plan of least effort. Each reversal
    crosses the backlash and shaft torsion of passive joints, which the response ignores: use true
    only for machines without them."""
    starts: Annotated[int, Field(ge=1, le=20), Slider(1, 6)] = 4
    """Number of first guesses; the best plan is returned."""
    intervals: Annotated[int, Field(ge=4, le=1000), Slider(5, 120)] = 40
    """Mesh intervals."""
    input: Literal["auto", "constant", "linear"] = "auto"
    """Input in an interval: constant, or continuous and linear. auto: linear when a rate limit or
    rest asks for continuity."""
    rest: Rest = "auto"
    accuracy: Accuracy = 5e-6
    """Largest allowed difference at the end, in radians, between the plan's q(t) and the integral
    of its inputs; the mesh is refined until it is met."""
    tolerance: Accuracy = 1e-8
    """Solver tolerance."""
    max_iterations: Iterations = 200
    """Solver iterations per first guess. After that many, a motion that keeps every limit is used
    even if it is not optimal yet."""


MOST_POINTS = 20
"""Largest number of constraint points; with more, v2's equations are ill-conditioned."""


class LawOptions(Table):
    """Options of every closed-form method."""

    criterion: Literal["peak", "margin"] = "peak"
    """What to minimise where the method has a choice, among motions inside the chart's domain and
    within limits: the peak input (over its limit where it has one); or, with 'margin', how near the
    motion comes to the domain's edge, ties to the smaller peak."""
    allow_singular: Annotated[bool, NO_SLIDER] = False
    """Return a path outside the chart's domain, for study; it cannot be executed."""


class TravelOptions(LawOptions):
    """Options of closed-form methods whose only free number is the travel."""

    travel: Annotated[Literal["auto", "middle"], NO_SLIDER] = "auto"
    """If goal.travel is free: the best travel by `criterion` (auto), or the middle of the widest
    range of travels inside the chart's domain (middle)."""


class LegOptions(TravelOptions):
    """Options of closed-form methods with constant v1 on each of one or two legs."""

    offset: float | Literal["auto", "mean"] = "auto"
    """Travel of the first of two legs if z1(0) = z1(T); not zero. auto: chosen by `criterion`;
    mean: the paper's rule, the mean of z(0), often a poor choice."""


class PolynomialOptions(LegOptions):
    """Options of the paper's polynomial method."""

    points: Annotated[list[Pair], Field(max_length=MOST_POINTS)] | Literal["auto"] = Field(
        default_factory=list,
        description=f"Constraint points [time in s, z2], eq. (28), at most {MOST_POINTS}; or"
        " 'auto': up to two points, chosen by `criterion` together with a free travel.",
    )


class PiecewiseOptions(LegOptions):
    """Options of the piecewise constant (multirate) method."""

    slots: Annotated[Annotated[int, Field(ge=1, le=200)] | None, Slider(1, 20)] = None
    """Number of intervals with constant v2, per leg; at least N-1, which is the default. With more,
    the solution with the least integral of v2^2 is used."""


class SinusoidOptions(LawOptions):
    """Options of the method `sinusoid`, which applies sinusoids of all frequencies at once."""

    amplitude: Annotated[float | Literal["auto"], Slider(-1.5, 1.5)] = "auto"
    """a1/omega in the unit of z1, not zero: z1 deviates from its straight line by up to twice this.
    'auto': chosen by `criterion` together with a free travel."""

    @field_validator("amplitude")
    @classmethod
    def _check_amplitude(cls, amplitude: float | str) -> float | str:
        if amplitude == 0:
            raise ValueError("must not be zero: without it the method cannot reach z4 and beyond")
        return amplitude


class SinusoidStepsOptions(LawOptions):
    """Options of the method `sinusoid_steps`, which steers one further coordinate per period."""

    amplitude: Annotated[float | list[float] | Literal["auto"], Slider(-1.5, 1.5)] = "auto"
    """alpha/omega in the unit of z1, not zero, one number or one per step: z1 oscillates by twice
    this in each period. 'auto': one number chosen by `criterion` together with a free travel."""
    shares: list[Annotated[float, Field(gt=0)]] | None = None
    """Shares of the duration for the first leg and each of the N-2 periods; equal by default. They
    change speeds, not the path."""

    @field_validator("amplitude")
    @classmethod
    def _check_amplitude(cls, amplitude: float | list[float] | str) -> float | list[float] | str:
        if amplitude == 0 or (isinstance(amplitude, list) and 0 in amplitude):
            raise ValueError("must not be zero: a period without it moves nothing")
        return amplitude


SolverName = Literal["fatrop", "ipopt"]
"""Solvers of `planner/methods/collocation/solvers.py`."""


class CollocationOptions(Table):
    """Options of direct collocation."""

    intervals: Intervals = "auto"
    """Initial number of mesh intervals. auto: 14 for simple problems with a given duration and
    linear inputs; otherwise 40 for paths, and for motions a number by their length, at least 80 if
    the duration is free."""
    degree: Annotated[int, Field(ge=1, le=5), Slider(1, 5)] = 3
    """Collocation points per interval."""
    scheme: Literal["radau", "legendre"] = "legendre"
    """Gauss-Legendre (order 2d) or Radau (order 2d-1) points."""
    input: Literal["auto", "linear", "constant"] = "auto"
    """Input in an interval: linear, and continuous over all; or constant, which may jump. auto:
    linear."""
    rest: Rest = "auto"
    objective: Literal["auto", "effort", "smooth", "edge", "time", "mixed"] = "auto"
    """Objective to minimise. For a fixed duration: effort, the integral of u1^2 + u2^2; smooth, the
    integral of the squared input rates; edge, the closeness to the edge of the chart's domain (mean
    over time of the sum over its margins of exp(-margin/0.05), plus the effort with a weight of 1
    %). time: the duration, plus the effort relative to the input limits (which are needed) with a
    weight of 1 %; the result is within 2 % of the least duration. mixed: a weighted sum of duration
    and the others. auto: effort if the duration is fixed; else time if both inputs are limited;
    else mixed."""
    end: Literal["plan", "machine"] = "plan"
    """Where the plan must end at the goal. plan: in the ideal kinematics; machine: on the nominal
    machine of an arm too, by a turn beyond the goal and back. Such a plan rests at both ends; its
    errors are measured from the motion predicted on that machine."""
    spread_weight: Annotated[float, Field(ge=0)] = 0.0
    """With end = 'machine': weight of the ends' spread beside the objective, per deg^2: the mean
    square distance from the nominal machine's end of those of machines whose lost motion is one
    standard deviation more or less. 10 to 50 with the effort: the ends of 95 % of the machines come
    closer by 2 to 10 % for 1.1 to 2.3 times the effort."""
    effort_weight: Annotated[float, Field(gt=0)] = 1.0
    """Weight of the effort beside the duration in the objective 'mixed'."""
    smoothness_weight: Annotated[float, Field(ge=0)] = 0.0
    """Weight of the squared input rates' integral in the objective 'mixed'."""
    edge_weight: Annotated[float, Field(ge=0)] = 0.0
    """Weight of the closeness to the domain's edge in the objective 'mixed'."""
    start: Literal["auto", "straight", "bump", "reverse", "wander"] = "auto"
    """First guess. straight: a straight line; bump: the first coordinate goes out and back;
    reverse: it leaves the line and returns late; wander: smooth random loops with fixed seeds.
    auto: the line, if no reversal is needed and the arm has at most three joints; else some of each
    kind, and the best result is used."""
    starts: Annotated[int, Field(ge=1), Slider(1, 6)] = 10
    """Number of paths to find before the best is used (start = 'auto' or 'wander'). With 'auto' the
    search also ends with a path without reversal (up to three joints), when the first five paths
    are the same, or when the shortest of nine or more has been found three times."""
    attempts: Annotated[int, Field(ge=1), Slider(1, 24)] = 16
    """Largest number of first guesses."""
    accuracy: Accuracy = 5e-6
    """Largest allowed difference at the end, in radians, between the plan's q(t) and the integral
    of its inputs (ten times as much before the end); the mesh is refined until it is met, and until
    the objective has settled: a finer mesh would save at most about 0.1 %."""
    refinements: Annotated[int, Field(ge=0, le=10), NO_SLIDER] = 4
    """Largest number of mesh refinements; 0 keeps the initial mesh."""
    solver: Annotated[Literal["auto", SolverName], NO_SLIDER] = "auto"
    """Solver of the nonlinear program. auto: Fatrop, which uses the stage structure, close to a
    solution, for simple problems with a given duration, and for paths of arms with more than three
    joints; IPOPT otherwise, at the end of such paths, and where Fatrop fails."""
    tolerance: Accuracy = 1e-9
    """Solver tolerance."""
    max_iterations: Iterations = 500
    """Solver iterations per first guess."""
    time_limit_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Seconds for planning; by default 60 s of processor time. When they are over, the best
    verified plan found is returned with the status 'time_limit'; without one, a refusal says how
    far the search got."""


class ConvexOptions(Table):
    """Options of the method `convex`: the best path with v2/v1 piecewise constant or linear."""

    objective: Literal["smooth", "peak"] = "smooth"
    """Objective to minimise: the integral of (dz2/dz1)^2 over |z1| (for constant v1, travel and
    duration equivalent to that of v2^2), or the largest |v2| with v1 constant."""
    pieces: Annotated[int, Field(ge=2, le=400), Slider(10, 200)] = 60
    """Number of equal pieces of v2."""
    input: Literal["auto", "constant", "linear"] = "auto"
    """v2/v1 constant on each piece, or continuous and linear. auto: linear when input rates have a
    limit, since a jump has no finite rate."""
    rest: Rest = "auto"
    travel: Annotated[Literal["auto", "middle"], NO_SLIDER] = "auto"
    """If goal.travel is free: the travel with the best objective (auto), or the middle of the range
    of travels that have a path (middle)."""
    scan: Annotated[int, Field(ge=3, le=1000), NO_SLIDER] = 25
    """Number of travels tried before the search is refined around the best."""
    edge: Annotated[float, Field(ge=0, lt=0.1), NO_SLIDER] = 1e-6
    """Least distance from the edge of the chart: sin^2 of theta1 for n = 2 and 3, otherwise every
    margin; at most half of the distance of start and goal."""
    max_cuts: Iterations = 100
    """Largest number of rounds of cutting planes for one travel."""


class MethodsTable(Table):
    """The `[method.*]` tables, one per method."""

    polynomial: PolynomialOptions = Field(default_factory=PolynomialOptions)
    piecewise: PiecewiseOptions = Field(default_factory=PiecewiseOptions)
    sinusoid: SinusoidOptions = Field(default_factory=SinusoidOptions)
    sinusoid_steps: SinusoidStepsOptions = Field(default_factory=SinusoidStepsOptions)
    collocation: CollocationOptions = Field(default_factory=CollocationOptions)
    convex: ConvexOptions = Field(default_factory=ConvexOptions)
    desensitised: DesensitisedOptions = Field(default_factory=DesensitisedOptions)

    @classmethod
    def add(cls, name: str, options: type[Table]) -> None:
        """Add the table of a method's options; the caller rebuilds the tables around this one."""
        # Keep the class object, so that existing and pickled problems stay valid.
        cls.model_fields[name] = FieldInfo(annotation=options, default_factory=options)
        cls.model_rebuild(force=True)
