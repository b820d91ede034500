"""The solvers IPOPT and Fatrop behind one interface, both through CasADi.

Both get the same functions and derivatives; Fatrop also gets the structure of the stages.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np

from planner.methods.collocation.transcription.bounds import Bounds
from planner.methods.collocation.transcription.transcription import Program, Transcription
from planner.methods.collocation.transcription.unknowns import Index
from planner.plan.measures import INTEGRALS
from planner.problem.tables.method_options import SolverName
from planner.support import deadline
from planner.support.arrays import Array
from planner.support.solver_calls import QUIET, QUIET_IPOPT, NlpCall, call_within, iteration_work

NEAR_DISTANCE = 1e-4
"""Initial distance of the unknowns from their bounds if the start is near the answer."""

FATROP_ROWS = 1e-8
"""Tolerance of the rows in Fatrop, which is independent of the objective's factor."""

FATROP_RELAXES = 1e-8
"""Distance by which Fatrop's iterates may exceed a bound, relative to the bound or to one."""

PATIENCE_S, PATIENCE_EACH_S = 5.0, 0.05
"""Limit on Fatrop's processor time, s: a constant part and a part for each interval, together over
four times what Fatrop needs for 500 iterations, and ten times for 100."""

SHORT_CHAIN = 5
"""Largest number of coordinates of a short chain. On longer chains Fatrop fails: it eliminates the
goal backwards through the inputs of the last few intervals, which loses all digits."""

GOAL_PENALTY = 1e5
"""Factor of a soft goal in Fatrop's objective: paths end 3e-7 to 1e-5 off, IPOPT goes on there."""

COARSE_INTERVALS = 40
"""Number of intervals above which a path is being refined rather than searched."""

MANY_INTERVALS, MOST_ITERATIONS = 300, 120
"""Number of intervals above which iterations take long, and the most that are then allowed."""


@dataclass(frozen=True)
class Settings:
    """Options of the solver.

    Attributes:
        tolerance: Tolerance of optimality and of the rows.
        max_iterations: Largest number of iterations.
        near: Whether the start is close to the answer, as from a coarser mesh or looser limits.
        wide: Whether near starts begin with a large barrier, since a small one has failed.
        direct: Whether the start is a straight line and the answer is close to a straight line.
        solver: The solver; "auto" tries a second solver if the first fails.
    """

    tolerance: float = 1e-9
    max_iterations: int = 500
    near: bool = False
    direct: bool = False
    wide: bool = False
    solver: Literal["auto", SolverName] = "auto"


@dataclass(frozen=True, eq=False)
class SolverAnswer:
    """The answer of a solver.

    Attributes:
        vector: The unknowns, shape (size,).
        finished: Whether the solver reports success.
        status: The solver's own status text.
        iterations: Number of iterations.
    """

    vector: Array
    finished: bool
    status: str
    iterations: int


@dataclass(frozen=True)
class Strategy:
    """The way to solve from starts of one kind: solvers, barriers and iterations.

    Attributes:
        order: Solvers to try in turn, unless the settings name one.
        weight: Factor of the objective for Fatrop. Fatrop starts with all bound multipliers at one.
            If the objective is small, a third of its iterations only correct them. Far from the
            answer a large objective makes the rows converge slowly.
        barrier: Initial barrier parameter of Fatrop, multiplied by `weight` if the start is near;
            None for Fatrop's default, 0.1.
        ipopt: Options of IPOPT for the barrier: fixed or adaptive.
        fatrop_iterations: Largest number of iterations of Fatrop. What it can solve takes some
            tens, with a soft goal some hundreds.
        fatrop_tolerance: Least tolerance of Fatrop. With less than the default, rounding keeps
            Fatrop from finishing when limits are active. A smaller tolerance changes the objective
            by less than 1e-7 and leaves rows as accurate.
        iterations: Largest number of iterations.
        reference_s: Duration, s, in the search for a path. A long duration makes the effort small
            relative to the rows: then paths of long chains are found more often, but paths of
            short chains are longer.
        guesses: Number of first guesses for the arm with which the ladder begins.
    """

    order: tuple[SolverName, ...]
    weight: float
    barrier: float | None
    ipopt: dict[str, Any]
    iterations: int = 10**6
    fatrop_iterations: int = 100
    fatrop_tolerance: float = 1e-7
    reference_s: float = 10.0
    guesses: int = 16


_ADAPTIVE: dict[str, Any] = {"mu_strategy": "adaptive"}
_PUSHES = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
_CLOSE: dict[str, Any] = {"mu_init": 1e-6, **dict.fromkeys(_PUSHES, NEAR_DISTANCE)}
_FEASIBLE: dict[str, Any] = {"mu_init": 1e-2, **dict.fromkeys(_PUSHES, 1e-3)}

STRATEGIES = {
    # the answer is close to the start: 4 to 20 iterations in 130 of the 134 random problems that
    # converged, up to 50 if narrow limits are active
    "straight": Strategy(("fatrop", "ipopt"), 1e2, 1e-4, _ADAPTIVE, iterations=50),
    "straight, long chain": Strategy(("ipopt",), 1e2, 1e-4, _ADAPTIVE, iterations=50),
    # Fatrop takes half of IPOPT's time
    "near": Strategy(("fatrop", "ipopt"), 1e3, 1e-5, _CLOSE),
    # beside posts Fatrop either takes some tens, or creeps along the posts, since the start is far
    # from the best motion; with a large barrier it moves freely
    "near, posts": Strategy(("fatrop",), 1e3, 1e-5, _CLOSE, fatrop_iterations=70),
    "near, wide": Strategy(("fatrop", "ipopt"), 1e2, 1e-2, _FEASIBLE, 200, 200),
    "near, long chain": Strategy(("ipopt",), 1e3, 1e-5, _CLOSE),
    "near, many intervals": Strategy(("ipopt",), 1e3, 1e-5, _CLOSE, MOST_ITERATIONS),
    # a path at its own speed is a feasible start that is far from the best
    "timing": Strategy(("ipopt",), 1.0, None, _FEASIBLE),
    # Fatrop (1.1.8) is hardly faster here, and its iterates may be such that it never returns
    "far": Strategy(("ipopt",), 1.0, 1e-4, _ADAPTIVE),
    # what takes longer leads nowhere or is found from another guess
    "far, posts": Strategy(("fatrop", "ipopt"), 1.0, 1.0, {}, 150, 150),
    # many optima: a large barrier that decreases stepwise finds better ones and avoids long detours
    # along z2 = 0; it is also not slow when the limits of a path are tightened
    "far, winding": Strategy(("ipopt",), 1.0, None, {}),
    # 1.4 times IPOPT's iterations, each in 0.45 of the time; IPOPT then needs some ten
    "soft goal": Strategy(
        ("fatrop", "ipopt"), 1e-3, None, {}, fatrop_iterations=500, fatrop_tolerance=0.1
    ),
    "far, long chain": Strategy(("ipopt",), 1.0, None, {}, reference_s=100.0, guesses=0),
}
"""The strategy for each kind of start, by name."""

LADDER_ITERATIONS = {"guess": 300, "shortening": 100, "timing": 400}
"""Largest numbers of iterations on the ladder: of each guess for its first arm, and to shorten a
path; and least number of iterations allowed to time a long path that is already a motion."""


def strategy(nlp: Transcription, settings: Settings) -> Strategy:
    """Return the strategy for a transcription and for the kind of start that the settings state."""
    form, posts = nlp.form, any(each.divides for each in nlp.form.kept)
    short = nlp.system.size <= SHORT_CHAIN and not (form.augmented or form.follower)
    winding = any("q" in required.reads and not required.is_direct for required in form.kept)
    is_narrow = form.inner or (form.intervals > COARSE_INTERVALS and not form.free_duration)
    if settings.near and posts and short:
        kind = "near, wide" if settings.wide else "near, posts"
    elif settings.near and form.intervals > MANY_INTERVALS:
        kind = "near, many intervals"
    elif form.soft_goal and not settings.near:
        kind = "soft goal"
    elif settings.near or settings.direct:
        kind = ("near" if settings.near else "straight") + ", long chain" * (not short)
    elif form.augmented or form.follower:
        kind = "far"
    elif not short:
        kind = "far, long chain"
    elif posts:
        kind = "far, posts"
    elif form.inner and form.free_duration:
        kind = "timing"
    else:
        kind = "far, winding" if winding or is_narrow else "far"
    return STRATEGIES[kind]


def attempts(nlp: Transcription, settings: Settings) -> list[Settings]:
    """Return the settings to try for a transcription, in order, each with a solver's name."""
    if settings.solver != "auto":
        return [settings]
    row, wide = strategy(nlp, settings), replace(settings, wide=True)
    tries = [replace(settings, solver=name) for name in row.order]
    return tries + (attempts(nlp, wide) if row is STRATEGIES["near, posts"] else [])


Backend = Callable[[Array, Bounds], SolverAnswer]
"""Solver as a function from a start (size,) and the problem's numbers to an answer."""


class _Ipopt:
    """The solver IPOPT, with bounds that every iterate keeps exactly.

    From a start close to the answer (`Settings.near`), IPOPT moves the unknowns hardly away from
    the bounds and begins with a small barrier parameter. IPOPT's warm start with multipliers saved
    a few more iterations on easy problems and failed on long problems.
    """

    def __init__(self, nlp: Transcription, settings: Settings) -> None:
        row = strategy(nlp, settings)
        options: dict[str, Any] = {
            **QUIET_IPOPT,
            "tol": settings.tolerance,
            "constr_viol_tol": settings.tolerance,
            "max_iter": min(settings.max_iterations, row.iterations),
            "bound_relax_factor": 0.0,
            **row.ipopt,
        }
        program = nlp.program
        functions = {"nlp_grad_f": program.value_gradient, "nlp_hess_l": program.triangle}
        options = {"no_nlp_grad": True, "ipopt": options}
        self._call = _nlpsol(nlp, "ipopt", functions, options, watched=True)

    def __call__(self, start: Array, data: Bounds) -> SolverAnswer:
        sides = {"lbx": data.lower, "ubx": data.upper, "lbg": data.row_lower, "ubg": data.row_upper}
        answer = self._call(x0=start, p=data.parameters, **sides)
        stats = self._call.stats()
        vector = np.asarray(answer["x"], dtype=float).ravel()
        status = stats["return_status"]
        finished = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
        return SolverAnswer(vector, finished, status, int(stats["iter_count"]))


class _Fatrop:
    """The solver Fatrop, which exploits the structure of the programme in stages.

    CasADi's interface (3.8) loses Fatrop's options when the pattern of fixed and free bounds
    changes between two calls, so each pattern has its own solver memory.

    Source: Vanroye et al., FATROP: A Fast Constrained Optimal Control Problem Solver for Robot
    Trajectory Optimization and Control, IROS 2023.
    """

    def __init__(self, nlp: Transcription, settings: Settings) -> None:
        row = strategy(nlp, settings)
        self._weight, self._soft = row.weight, row is STRATEGIES["soft goal"]
        options: dict[str, Any] = {
            "print_level": 0,
            "tol": max(settings.tolerance, row.fatrop_tolerance) * row.weight,
            "constr_viol_tol": FATROP_ROWS,
            "max_iter": min(settings.max_iterations, row.iterations, row.fatrop_iterations),
        }
        if settings.near:
            options |= {"bound_push": NEAR_DISTANCE, "bound_frac": NEAR_DISTANCE}
        # where rows depend on each other, as at a joint on a post, multipliers may never settle
        if settings.wide:
            options |= {"tol_acceptable": 1e2 * options["tol"], "acceptable_iter": 10}
        if row.barrier is not None:
            options["mu_init"] = row.barrier * (row.weight if settings.near else 1.0)
        program = nlp.program
        functions = {"nlp_grad_f": program.gradient, "nlp_hess_l": program.gradient_and_hessian}
        functions["nlp_grad"] = _values(program)
        self._nlp, self._functions = nlp, functions
        self._options: dict[str, Any] = {"fatrop": options, **_stages(nlp)}
        self._intervals = nlp.form.intervals
        self._fresh()

    def _fresh(self) -> None:
        self._call = _nlpsol(self._nlp, "fatrop", self._functions, self._options)
        self._lock = threading.Lock()
        self._memories: dict[bytes, tuple[Any, Callable[[], None]]] = {}

    def __call__(self, start: Array, data: Bounds) -> SolverAnswer:
        """Solve from a start with Fatrop; return the start as a failure if Fatrop exceeds its time.

        Fatrop's search for a direction may never end. Such a call goes on using its memory, so the
        next call gets new memory.
        """
        answer = None
        try:
            seconds = PATIENCE_S + PATIENCE_EACH_S * self._intervals
            answer = call_within(seconds, lambda: self._answer(start, data))
        finally:
            if answer is None:
                self._fresh()
        answer = answer or SolverAnswer(start, False, "Does_Not_Return", 0)
        deadline.spend(answer.iterations * iteration_work(self._nlp.program.problem))
        return answer

    def _answer(self, start: Array, data: Bounds) -> SolverAnswer:
        if self._soft:
            data = _with_soft_goal(data, self._nlp.layout.nodes[-1])
        bounds = _draw_in(data.lower, data.upper), _draw_in(data.row_lower, data.row_upper)
        weighted = data.parameters.copy()
        weighted[:INTEGRALS] *= self._weight
        inputs = (start, weighted, *bounds[0], *bounds[1])
        vector = np.empty(len(start))
        with self._lock:
            if data.pattern not in self._memories:
                self._memories[data.pattern] = self._call.buffer()
            buffer, evaluate = self._memories[data.pattern]
            for k, values in enumerate(inputs):
                buffer.set_arg(k, values.data)
            buffer.set_res(0, vector.data)
            evaluate()
            stats = buffer.stats()
        finished = bool(stats["success"])
        status = "Solve_Succeeded" if finished else "Search_Direction_Or_Iterations_Failed"
        return SolverAnswer(vector, finished, status, int(stats["iter_count"]))


SOLVERS: dict[SolverName, Callable[[Transcription, Settings], Backend]] = {
    "fatrop": _Fatrop,
    "ipopt": _Ipopt,
}
"""The solvers by name. Each prints nothing and stops at a time limit and at Ctrl-C."""


def backend(nlp: Transcription, settings: Settings) -> Backend:
    """Return the solver that the settings name, cached by transcription and settings."""
    if settings not in nlp.solvers:
        assert settings.solver != "auto", "choose one of `attempts` first"
        nlp.solvers[settings] = SOLVERS[settings.solver](nlp, settings)
    solver: Backend = nlp.solvers[settings]
    return solver


def _with_soft_goal(data: Bounds, last: Index) -> Bounds:
    """Return the numbers with the given unknowns free, and with the penalty where they were fixed.

    Fatrop then eliminates no goal backwards, which fails on long chains (see `SHORT_CHAIN`).
    """
    lower, upper, numbers = data.lower.copy(), data.upper.copy(), data.parameters.copy()
    fixed = lower[last] == upper[last]
    goal = np.where(fixed, lower[last], 0.0)
    numbers[-2 * len(last) :] = np.concatenate([goal, GOAL_PENALTY * fixed])
    lower[last[fixed]], upper[last[fixed]] = -np.inf, np.inf
    return replace(data, lower=lower, upper=upper, parameters=numbers)


def _draw_in(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return bounds tightened by as much as Fatrop relaxes them; bounds of fixed values stay."""
    low, high = lower + _relaxation(lower), upper - _relaxation(upper)
    wide = low < high
    return np.where(wide, low, lower), np.where(wide, high, upper)


def _relaxation(bound: Array) -> Array:
    return FATROP_RELAXES * np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 0.0))


def _values(program: Program) -> Any:
    """Build the function that CasADi calls at the end for f and g, with unused zero gradients."""
    x, p = program.problem["x"], program.problem["p"]
    scale, duals = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", program.problem["g"].numel())
    unread = [ca.MX.zeros(x.numel()), ca.MX.zeros(p.numel())]
    values = [program.problem["f"], program.problem["g"], *unread]
    names = ["x", "p", "lam_f", "lam_g"], ["f", "g", "grad_gamma_x", "grad_gamma_p"]
    return ca.Function("nlp_grad", [x, p, scale, duals], values, *names)


def _stages(nlp: Transcription) -> dict[str, Any]:
    layout = nlp.layout
    return {
        "structure_detection": "manual",
        "N": layout.intervals,
        "nx": [layout.state] * (layout.intervals + 1),
        "nu": [layout.control] * layout.intervals + [0],
        "ng": [nlp.height - layout.state] * layout.intervals + [0],
    }


def _nlpsol(
    nlp: Transcription,
    name: str,
    functions: dict[str, Any],
    options: dict[str, Any],
    watched: bool = False,
) -> Any:
    """Build a CasADi solver that uses the program's derivatives in place of CasADi's.

    CasADi asks for functions by name; `casadi.nlpsol(...).get_function()` lists a solver's names.
    CasADi silently ignores other names, so check that a wrong derivative has an effect. Set
    `watched` if the solver calls back after each iteration and no iteration can hang; it then stops
    in time (`NlpCall`). Otherwise call it through `call_within`; never both, which aborts at exit.
    """
    program = nlp.program
    known = {"nlp_f": program.f, "nlp_g": program.g, "nlp_jac_g": program.jacobian}
    options = {**QUIET, "cache": known | functions, **options}
    if watched:
        return NlpCall(name, "collocation", program.problem, options)
    return ca.nlpsol("collocation", name, program.problem, options)
