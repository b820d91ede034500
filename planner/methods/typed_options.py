"""The options of each method as keywords of `solve`, for editors and type checkers.

The tables in `planner/problem/tables/method_options.py` check them, and hold meaning and ranges; a
test compares both. A method that is registered from outside has its options checked all the same.
"""

from __future__ import annotations

from typing import Literal, TypedDict

from planner.plan.plan import Plan
from planner.support.progress import Listener


class Call(TypedDict, total=False):
    """Keywords of `solve` that every method takes."""

    warm: Plan | None
    time_limit_s: float | None
    progress: Listener | None


class Polynomial(Call, total=False):
    """Keys of `[method.polynomial]`."""

    criterion: Literal["peak", "margin"]
    allow_singular: bool
    travel: Literal["auto", "middle"]
    offset: float | Literal["auto", "mean"]
    points: list[list[float]] | Literal["auto"]


class Piecewise(Call, total=False):
    """Keys of `[method.piecewise]`."""

    criterion: Literal["peak", "margin"]
    allow_singular: bool
    travel: Literal["auto", "middle"]
    offset: float | Literal["auto", "mean"]
    slots: int | None


class Sinusoid(Call, total=False):
    """Keys of `[method.sinusoid]`."""

    criterion: Literal["peak", "margin"]
    allow_singular: bool
    amplitude: float | Literal["auto"]


class SinusoidSteps(Call, total=False):
    """Keys of `[method.sinusoid_steps]`."""

    criterion: Literal["peak", "margin"]
    allow_singular: bool
    amplitude: float | list[float] | Literal["auto"]
    shares: list[float] | None


class Collocation(Call, total=False):
    """Keys of `[method.collocation]`."""

    intervals: int | Literal["auto"]
    degree: int
    scheme: Literal["radau", "legendre"]
    input: Literal["auto", "linear", "constant"]
    rest: bool
    objective: Literal["auto", "effort", "smooth", "edge", "time", "mixed"]
    effort_weight: float
    smoothness_weight: float
    edge_weight: float
    start: Literal["auto", "straight", "polynomial", "convex", "bump", "reverse", "wander"]
    starts: int
    variations: int
    attempts: int
    accuracy: float
    refinements: int
    solver: Literal["auto", "fatrop", "ipopt"]
    compile: bool
    tolerance: float
    max_iterations: int


class Convex(Call, total=False):
    """Keys of `[method.convex]`."""

    objective: Literal["smooth", "peak"]
    pieces: int
    input: Literal["auto", "constant", "linear"]
    travel: Literal["auto", "middle"]
    scan: int
    edge: float
    solver: Literal["auto", "osqp"]
    max_cuts: int


class Desensitised(Call, total=False):
    """Keys of `[method.desensitised]`."""

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
    rest: bool
    accuracy: float
    tolerance: float
    max_iterations: int
