"""The solvers behind one interface: IPOPT and Fatrop, through CasADi.

Both get the same functions with the same derivatives; Fatrop also the stages they consist of.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.bounds import Bounds
from planner.methods.collocation.transcription.form import TERMS
from planner.methods.collocation.transcription.transcription import Program, Transcription
from planner.problem.tables.method_options import SolverName
from planner.support.arrays import Array
from planner.support.solver_calls import IpoptCall, call_within

NEAR_DISTANCE = 1e-4
"""Distance to the bounds to begin with when the start is near the answer."""

FATROP_ROWS = 1e-8
"""Tolerance of the rows for Fatrop, whatever the objective's factor."""

FATROP_ITERATIONS = 100
"""Where Fatrop solves a problem at all it needs tens of iterations."""

FATROP_TOLERANCE = 1e-7
"""Below this rounding keeps Fatrop from finishing where limits are active. Rows are as exact as
ever; the objective is within 1e-7 of that of a sharper tolerance."""

FATROP_RELAXES = 1e-8
"""By how much, relative to a bound or to one, Fatrop lets its iterates pass bounds."""

PATIENCE_S, PATIENCE_EACH_S = 5.0, 0.05
"""Processor time for Fatrop to return, and for each interval more: over ten times what it takes."""

SHORT_CHAIN = 5
"""Most coordinates of a short chain. Beyond, Fatrop is of no use: it eliminates the goal backwards
through the inputs of the last few intervals, which leaves no digit; and there are many optima."""

COARSE_INTERVALS = 40
"""Intervals beyond which a path is refined, no longer searched."""

MANY_INTERVALS, MOST_ITERATIONS = 300, 120
"""Intervals beyond which each iteration takes long, and those granted there; a good start needs
few."""


@dataclass(frozen=True)
class Settings:
    """Options of the solver.

    Attributes:
        tolerance: Of optimality and of the rows.
        max_iterations: Iterations before it gives up.
        near: Whether the start is close to the answer, as from a coarser mesh or looser limits.
        direct: Whether the start is a straight line, and the answer hardly more.
        solver: Who solves; "auto" lets the other try where the first fails.
    """

    tolerance: float = 1e-9
    max_iterations: int = 500
    near: bool = False
    direct: bool = False
    solver: Literal["auto", SolverName] = "auto"


@dataclass(frozen=True, eq=False)
class SolverAnswer:
    """What a solver says.

    Attributes:
        vector: The unknowns, shape (size,).
        finished: Whether it claims to have solved the problem.
        status: In its own words.
        iterations: How many it made.
    """

    vector: Array
    finished: bool
    status: str
    iterations: int


@dataclass(frozen=True)
class Strategy:
    """How starts of one kind are solved.

    Attributes:
        order: Solvers that are tried in turn, unless the settings name one.
        weight: Factor of the objective for Fatrop. Its bound multipliers all begin at one, which
            beside a small objective takes iterations to forget: a third of them from a straight
            line. Far from the answer a large objective gets in the way of the rows.
        barrier: To begin with, before that factor, for Fatrop; None for its own, 0.1.
        ipopt: How IPOPT begins: with a barrier of its own, or one that adapts.
        iterations: Most that are granted.
        reference_s: Duration of a path that is looked for. A long one makes the effort small
            beside the rows, which leads to paths of long chains more often, and to longer ones of
            short chains.
        guesses: First guesses for the arm that the ladder begins with.
    """

    order: tuple[SolverName, ...]
    weight: float
    barrier: float | None
    ipopt: dict[str, Any]
    iterations: int = 10**6
    reference_s: float = 10.0
    guesses: int = 16


_ADAPTIVE: dict[str, Any] = {"mu_strategy": "adaptive"}
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
_CLOSE: dict[str, Any] = {"mu_init": 1e-6, **dict.fromkeys(_PUSHES, NEAR_DISTANCE)}

STRATEGIES = {
    # the answer is hardly more than the start: 4 to 20 iterations in 130 of 134 random problems
    # that led to it, up to 50 where narrow limits are met
    "straight": Strategy(("fatrop", "ipopt"), 1e2, 1e-4, _ADAPTIVE, iterations=50),
    "straight, long chain": Strategy(("ipopt",), 1e2, 1e-4, _ADAPTIVE, iterations=50),
    # Fatrop takes half of IPOPT's time
    "near": Strategy(("fatrop", "ipopt"), 1e3, 1e-5, _CLOSE),
    "near, long chain": Strategy(("ipopt",), 1e3, 1e-5, _CLOSE),
    "near, many intervals": Strategy(("ipopt",), 1e3, 1e-5, _CLOSE, MOST_ITERATIONS),
    # Fatrop (1.1.8) is hardly faster here, and its iterates may be such that it never returns
    "far": Strategy(("ipopt",), 1.0, 1e-4, _ADAPTIVE),
    # many optima: a large barrier that is lowered step by step leads to better ones, and does not
    # lead a long way round along z2 = 0; nor does it crawl where a path is drawn inside its limits
    "far, winding": Strategy(("ipopt",), 1.0, None, {}),
    "far, long chain": Strategy(("ipopt",), 1.0, None, {}, reference_s=100.0, guesses=0),
}
"""Which solver, barrier and patience, in one place."""

LADDER_ITERATIONS = {"guess": 300, "shortening": 100, "timing": 400}
"""Iterations granted on the ladder: to each guess for the arm that it begins with, to a path that
is shortened, and at least to the timing, where the path is long and already a motion."""


def strategy(made: Transcription, settings: Settings) -> Strategy:
    """The row of `STRATEGIES` for a transcription and a kind of start."""
    form = made.form
    short = made.system.size <= SHORT_CHAIN and not form.augmented
    if settings.near and form.intervals > MANY_INTERVALS:
        return STRATEGIES["near, many intervals"]
    if settings.near or settings.direct:
        kind = "near" if settings.near else "straight"
        return STRATEGIES[kind if short else f"{kind}, long chain"]
    if form.augmented:
        return STRATEGIES["far"]
    if not short:
        return STRATEGIES["far, long chain"]
    winding = any("q" in required.reads and not required.is_direct for required in form.kept)
    drawn = form.inner or (form.intervals > COARSE_INTERVALS and not form.free_duration)
    return STRATEGIES["far, winding" if winding or drawn else "far"]


def names(made: Transcription, settings: Settings) -> tuple[SolverName, ...]:
    """The solvers to try, in this order."""
    return strategy(made, settings).order if settings.solver == "auto" else (settings.solver,)


Backend = Callable[[Array, Bounds], SolverAnswer]
"""From a start (size,) and the problem's numbers to an answer."""


class _Ipopt:
    """IPOPT. Limits hold exactly at every iterate: bounds are not relaxed.

    A near start keeps its distance to the bounds and begins with a small barrier. IPOPT's own warm
    start, with multipliers, saved a few iterations more on easy problems and failed on long ones.
    """

    def __init__(self, made: Transcription, settings: Settings) -> None:
        row = strategy(made, settings)
        options: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "tol": settings.tolerance,
            "constr_viol_tol": settings.tolerance,
            "max_iter": min(settings.max_iterations, row.iterations),
            "bound_relax_factor": 0.0,
            **row.ipopt,
        }
        program = made.program
        functions = {"nlp_grad_f": program.value_gradient, "nlp_hess_l": program.triangle}
        self._call = _nlpsol(made, "ipopt", functions, {"no_nlp_grad": True, "ipopt": options})

    def __call__(self, start: Array, data: Bounds) -> SolverAnswer:
        found = self._call(
            x0=start,
            p=data.parameters,
            lbx=data.lower,
            ubx=data.upper,
            lbg=data.row_lower,
            ubg=data.row_upper,
        )
        stats = self._call.stats()
        vector = np.asarray(found["x"], dtype=float).ravel()
        status = stats["return_status"]
        finished = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
        return SolverAnswer(vector, finished, status, int(stats["iter_count"]))


class _Fatrop:
    """Fatrop, which is told the stages.

    CasADi's interface (3.8) forgets Fatrop's options when the pattern of fixed and free bounds
    changes between two calls, so each pattern has a memory of its own.

    Source: Vanroye et al., FATROP: A Fast Constrained Optimal Control Problem Solver for Robot
    Trajectory Optimization and Control, IROS 2023.
    """

    def __init__(self, made: Transcription, settings: Settings) -> None:
        row = strategy(made, settings)
        self._weight = row.weight
        options: dict[str, Any] = {
            "print_level": 0,
            "tol": max(settings.tolerance, FATROP_TOLERANCE) * row.weight,
            "constr_viol_tol": FATROP_ROWS,
            "max_iter": min(settings.max_iterations, row.iterations, FATROP_ITERATIONS),
        }
        if settings.near:
            options |= {"bound_push": NEAR_DISTANCE, "bound_frac": NEAR_DISTANCE}
        if row.barrier is not None:
            options["mu_init"] = row.barrier * (row.weight if settings.near else 1.0)
        program = made.program
        functions = {"nlp_grad_f": program.gradient, "nlp_hess_l": program.hessian}
        functions["nlp_grad"] = _values(program)
        self._made, self._functions = made, functions
        self._options: dict[str, Any] = {"fatrop": options, **_stages(made)}
        self._intervals = made.form.intervals
        self._fresh()

    def _fresh(self) -> None:
        self._call = _nlpsol(self._made, "fatrop", self._functions, self._options)
        self._lock = threading.Lock()
        self._memories: dict[bytes, tuple[Any, Callable[[], None]]] = {}

    def __call__(self, start: Array, data: Bounds) -> SolverAnswer:
        """Answer, or give the start back: the search for a direction may loop for ever.

        Such a call keeps what it works on; the next one gets all of it anew, and answers as if
        nothing had been.
        """
        answer = None
        try:
            seconds = PATIENCE_S + PATIENCE_EACH_S * self._intervals
            answer = call_within(seconds, lambda: self._answer(start, data))
        finally:
            if answer is None:
                self._fresh()
        return answer or SolverAnswer(start, False, "Does_Not_Return", 0)

    def _answer(self, start: Array, data: Bounds) -> SolverAnswer:
        bounds = _draw_in(data.lower, data.upper), _draw_in(data.row_lower, data.row_upper)
        weighted = data.parameters.copy()
        weighted[:TERMS] *= self._weight
        given = (start, weighted, *bounds[0], *bounds[1])
        vector = np.empty(len(start))
        with self._lock:
            buffer, evaluate = self._memory(data)
            for k, values in enumerate(given):
                buffer.set_arg(k, values.data)
            buffer.set_res(0, vector.data)
            evaluate()
            stats = buffer.stats()
        finished = bool(stats["success"])
        status = "Solve_Succeeded" if finished else "Search_Direction_Or_Iterations_Failed"
        return SolverAnswer(vector, finished, status, int(stats["iter_count"]))

    def _memory(self, data: Bounds) -> tuple[Any, Callable[[], None]]:
        pattern = data.pattern
        if pattern not in self._memories:
            self._memories[pattern] = self._call.buffer()
        return self._memories[pattern]


SOLVERS: dict[SolverName, Callable[[Transcription, Settings], Backend]] = {
    "fatrop": _Fatrop,
    "ipopt": _Ipopt,
}


def backend(made: Transcription, settings: Settings) -> Backend:
    """The solver that the settings name, made once for each transcription and settings."""
    if settings not in made.solvers:
        assert settings.solver != "auto", "`names` says who that is"
        made.solvers[settings] = SOLVERS[settings.solver](made, settings)
    found: Backend = made.solvers[settings]
    return found


def _draw_in(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Bounds drawn in by as much as Fatrop will relax them; fixed values stay."""
    low, high = lower + _relaxation(lower), upper - _relaxation(upper)
    wide = low < high
    return np.where(wide, low, lower), np.where(wide, high, upper)


def _relaxation(bound: Array) -> Array:
    return FATROP_RELAXES * np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 0.0))


def _values(program: Program) -> Any:
    """What CasADi calls at the end, for f and g: gradients of the Lagrangian it leaves unread."""
    x, p = program.problem["x"], program.problem["p"]
    scale, duals = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", program.problem["g"].numel())
    unread = [ca.MX.zeros(x.numel()), ca.MX.zeros(p.numel())]
    values = [program.problem["f"], program.problem["g"], *unread]
    names = ["x", "p", "lam_f", "lam_g"], ["f", "g", "grad_gamma_x", "grad_gamma_p"]
    return ca.Function("nlp_grad", [x, p, scale, duals], values, *names)


def _stages(made: Transcription) -> dict[str, Any]:
    at = made.layout
    return {
        "structure_detection": "manual",
        "N": at.intervals,
        "nx": [at.state] * (at.intervals + 1),
        "nu": [at.control] * at.intervals + [0],
        "ng": [made.height - at.state] * at.intervals + [0],
    }


def _nlpsol(
    made: Transcription, name: str, functions: dict[str, Any], options: dict[str, Any]
) -> Any:
    """CasADi's solver with our derivatives in place of those it would form."""
    program = made.program
    known: dict[str, Any] = {
        "nlp_f": program.f,
        "nlp_g": program.g,
        "nlp_jac_g": program.jacobian,
        **functions,
    }
    common: dict[str, Any] = {
        "cache": known,
        "calc_lam_p": False,
        "print_time": False,
        "show_eval_warnings": False,
    }
    options = {**common, **options}
    if name == "ipopt":
        return IpoptCall("collocation", program.problem, options)
    return ca.nlpsol("collocation", name, program.problem, options)
