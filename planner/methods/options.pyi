"""Keywords of `planner.solve` by method. Written from the tables of options by `make generated`."""

from typing import Any, Literal, Protocol, TypedDict, Unpack, overload

from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.support.progress import Listener

class SolveKeywords(TypedDict, total=False):
    warm: Plan | None
    time_limit_s: float | None
    progress: Listener | None

class Polynomial(SolveKeywords, total=False):
    criterion: Literal["peak", "margin"]
    allow_singular: bool
    travel: Literal["auto", "middle"]
    offset: float | Literal["auto", "mean"]
    points: list[list[float]] | Literal["auto"]

class Piecewise(SolveKeywords, total=False):
    criterion: Literal["peak", "margin"]
    allow_singular: bool
    travel: Literal["auto", "middle"]
    offset: float | Literal["auto", "mean"]
    slots: int | None

class Sinusoid(SolveKeywords, total=False):
    criterion: Literal["peak", "margin"]
    allow_singular: bool
    amplitude: float | Literal["auto"]

class SinusoidSteps(SolveKeywords, total=False):
    criterion: Literal["peak", "margin"]
    allow_singular: bool
    amplitude: float | list[float] | Literal["auto"]
    shares: list[float] | None

class Collocation(SolveKeywords, total=False):
    intervals: int | Literal["auto"]
    degree: int
    scheme: Literal["radau", "legendre"]
    input: Literal["auto", "linear", "constant"]
    rest: Literal["auto"] | bool
    objective: Literal["auto", "effort", "smooth", "edge", "time", "mixed"]
    end: Literal["plan", "machine"]
    spread_weight: float
    effort_weight: float
    smoothness_weight: float
    edge_weight: float
    start: Literal["auto", "straight", "bump", "reverse", "wander"]
    starts: int
    attempts: int
    accuracy: float
    refinements: int
    solver: Literal["auto", "fatrop", "ipopt"]
    tolerance: float
    max_iterations: int

class Convex(SolveKeywords, total=False):
    objective: Literal["smooth", "peak"]
    pieces: int
    input: Literal["auto", "constant", "linear"]
    rest: Literal["auto"] | bool
    travel: Literal["auto", "middle"]
    scan: int
    edge: float
    max_cuts: int

class Desensitised(SolveKeywords, total=False):
    passive: float
    terminal: float
    path: float
    effort: float
    time: float
    effort_limit: float | None
    gain: float | list[float]
    bias: float | list[float]
    delay_s: float | list[float]
    stretch: float | list[float]
    start_deg: float | list[float]
    start_m: float | list[float]
    gear: float | list[float]
    backoff: float
    reversal: bool
    starts: int
    intervals: int
    input: Literal["auto", "constant", "linear"]
    rest: Literal["auto"] | bool
    accuracy: float
    tolerance: float
    max_iterations: int

class Solve(Protocol):
    """`planner.solve`, with the keywords of the method that is named."""

    @overload
    def __call__(
        self, problem: Problem, method: Literal["collocation"] = ..., **options: Unpack[Collocation]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["polynomial"], **options: Unpack[Polynomial]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["piecewise"], **options: Unpack[Piecewise]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["sinusoid"], **options: Unpack[Sinusoid]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["sinusoid_steps"], **options: Unpack[SinusoidSteps]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["convex"], **options: Unpack[Convex]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: Literal["desensitised"], **options: Unpack[Desensitised]
    ) -> Plan: ...

    @overload
    def __call__(
        self, problem: Problem, method: str = ..., **options: Any
    ) -> Plan: ...
