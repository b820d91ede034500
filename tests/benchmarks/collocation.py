"""Speed of collocation beside scripts written by hand, on the same problems in the same process.

    python tests/benchmarks/collocation.py [--rounds N] [--compile NAMES] [--out FOLDER]

Contestants take turns, so that a busy computer disturbs all alike; times are the least and ratios
the medians over the rounds. Of the rivals only the solver's call is timed, of `planner` the whole
of planning, from problem to plan, without the independent verification (which is listed by itself).
Writes results/benchmarks: a page, a picture, and all numbers as JSON.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bench_report
import numpy as np
from bench_cases import Case, along, cases, chain
from rich.console import Console
from rich.progress import Progress
from rivals import Outcome, radau_ipopt, shooting_fatrop
from scipy.integrate import solve_ivp
from scipy.stats import linregress

import planner
from planner.methods.collocation import plan_collocation
from planner.methods.convex import plan_convex
from planner.methods.replan import replan_collocation
from planner.ocp.backends import Settings
from planner.ocp.bounds import Asked
from planner.ocp.form import Form
from planner.ocp.mesh import uniform
from planner.ocp.objective import objective
from planner.ocp.pipeline import DIRECT
from planner.ocp.task import task
from planner.schema.methods import CollocationOptions, ConvexOptions

OUT = Path(__file__).parents[2] / "results" / "benchmarks"
RADAU, SHOOTING, COMPILED = "plain Radau + IPOPT", "bare Fatrop", "bare Fatrop, compiled"
RADAU_OURS = "plain Radau + IPOPT, our mesh"
OURS, WARM = "planner", "planner, warm"
OURS_C, WARM_C = "planner, compile", "planner, compile, warm"
INTERVALS, JOINTS = (10, 20, 40, 80, 160, 320), range(3, 11)

ENOUGH_S = 20.0
"""Seconds after which a contest begins no further round."""

Call = Callable[[], Outcome]


def main() -> int:
    """Run all contests and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--compile", default="paper", help="cases whose bare Fatrop is compiled")
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    with Progress(console=console, transient=True) as progress:
        step = progress.add_task("collocation", total=len(cases()) + 4)
        contests = {}
        for case in cases():
            progress.update(step, description=f"contest: {case.name}")
            contests[case.name] = contest(case, arguments.rounds, case.name in arguments.compile)
            progress.advance(step)
        scaling = {}
        for name, measure in (
            ("intervals", over_intervals),
            ("joints", over_joints),
            ("convex", convex_against_osqp),
            ("fresh", bench_report.fresh_process),
        ):
            progress.update(step, description=name)
            scaling[name] = measure()
            progress.advance(step)
    bench_report.write(arguments.out, {"contests": contests, **scaling})
    return 0


def contest(case: Case, rounds: int, compiled: bool) -> dict[str, Any]:
    """All contestants on one case: times, iterations, objective, error at the goal."""
    makers: dict[str, Callable[[], Call]] = {
        RADAU: lambda: radau_ipopt(case.arm),
        RADAU_OURS: lambda: radau_ipopt(case.arm, intervals=DIRECT, linear=True),
        SHOOTING: lambda: shooting_fatrop(case.arm),
        OURS: lambda: ours(case, compile=False),
        WARM: lambda: ours_warm(case, compile=False),
        OURS_C: lambda: ours(case, compile=True),
        WARM_C: lambda: ours_warm(case, compile=True),
    }
    if compiled:
        makers[COMPILED] = lambda: shooting_fatrop(case.arm, compiled=True)
    calls, build = {}, {}
    for name, make in makers.items():
        began = time.perf_counter()
        calls[name] = make()
        last = calls[name]()
        build[name] = time.perf_counter() - began - last.seconds
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    began = time.perf_counter()
    for k in range(rounds):
        if k >= 2 and time.perf_counter() - began > ENOUGH_S:
            break
        for name, call in calls.items():
            last = call()
            seconds[name].append(last.seconds)
    return {name: _row(case, name, calls[name](), seconds, build[name]) for name in calls}


def _row(
    case: Case, name: str, outcome: Outcome, seconds: dict[str, list[float]], build: float
) -> dict[str, Any]:
    own = np.array(seconds[name])
    against = {
        rival: float(np.median(np.array(seconds[rival]) / own))
        for rival in (RADAU, SHOOTING, COMPILED, OURS, OURS_C)
        if rival in seconds
    }
    warm = name in (WARM, WARM_C)
    return {
        "least_s": float(own.min()),
        "median_s": float(np.median(own)),
        "build_s": build,
        "iterations": outcome.iterations,
        "objective": outcome.objective,
        "goal_error_rad": goal_error(case.neighbour if warm else case.problem, outcome),
        "times_faster_than": against,
    }


def ours(case: Case, compile: bool) -> Call:
    """From problem to plan; from the same straight line as the rivals."""
    options = CollocationOptions(start="straight", compile=compile)
    return lambda: _timed(lambda: plan_collocation(case.problem, options))


def ours_warm(case: Case, compile: bool) -> Call:
    """The neighbouring problem, from the plan of the case."""
    options = CollocationOptions(start="straight", compile=compile)
    plan = plan_collocation(case.problem, options)
    return lambda: _timed(lambda: replan_collocation(case.neighbour, options, plan))


def _timed(make: Callable[[], planner.Plan]) -> Outcome:
    began = time.perf_counter()
    plan = make()
    seconds = time.perf_counter() - began
    u = plan.trajectory.u_curve.c
    return Outcome(seconds, plan.objective, plan.iterations, u[0], u[-1], plan.t)


def goal_error(problem: planner.Problem, outcome: Outcome) -> float:
    """Largest error at the goal, in radians, of the motion that an outcome's inputs really make."""
    if np.isnan(outcome.objective):
        return float("nan")
    q, K = problem.start, len(outcome.left)
    edges = outcome.edges
    if edges is None:
        edges = np.linspace(0, problem.duration, K + 1)
    for k in range(K):
        a, b = edges[k], edges[k + 1]

        def rates(t: float, q: Any, a: float = a, b: float = b, k: int = k) -> Any:
            share = (t - a) / (b - a)
            return problem.system.rates(q, (1 - share) * outcome.left[k] + share * outcome.right[k])

        q = solve_ivp(rates, (a, b), q, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    return float(np.nanmax(np.abs(q - problem.goal)))


def over_intervals() -> dict[str, Any]:
    """Time an iteration on finer and finer meshes of the paper's problem."""
    problem, rows = cases()[0].problem, {}
    for intervals in INTERVALS:
        options = CollocationOptions(start="straight", intervals=intervals, refinements=0)
        rows[intervals] = _repeated(problem, options, 4)
    return {"rows": rows, "exponent": _exponent(rows)}


def over_joints() -> dict[str, Any]:
    """Time an iteration for longer and longer chains; the coordinates are the joints and one more.

    All start from the motion that their goal was taken from, with IPOPT, which long chains need.
    """
    rows, mesh = {}, uniform(20)
    for joints in JOINTS:
        problem = chain(joints)
        form = Form(20, "legendre", 3, "linear")
        job = task(
            problem, objective(problem, CollocationOptions()), form, mesh, Asked(), Settings()
        )
        start = along(problem, mesh)
        runs = [replace(job, settings=Settings(solver="ipopt")).solve(start) for _ in range(2)]
        rows[joints + 1] = {
            "iterations": runs[0].iterations,
            "per_iteration_s": min(run.seconds for run in runs) / runs[0].iterations,
            "build_s": job.build_time_s,
        }
    return {"rows": rows, "exponent": _exponent(rows)}


def _repeated(problem: planner.Problem, options: CollocationOptions, times: int) -> dict[str, Any]:
    first = plan_collocation(problem, options)
    seconds = [_timed(lambda: plan_collocation(problem, options)).seconds for _ in range(times)]
    per = min(seconds) / first.iterations
    return {
        "least_s": min(seconds),
        "iterations": first.iterations,
        "per_iteration_s": per,
        "build_s": first.build_time_s,
    }


def _exponent(rows: dict[int, dict[str, Any]]) -> float:
    sizes, values = list(rows), [row["per_iteration_s"] for row in rows.values()]
    return float(linregress(np.log(sizes), np.log(values)).slope)


def convex_against_osqp() -> dict[str, Any]:
    """The convex method as a whole against OSQP's own time on the last programme."""
    problem = cases()[0].problem.changed({"goal.travel": 0.79, "limits": {"z2_margin": 0.01}})
    options = ConvexOptions()
    plans = [plan_convex(problem, options) for _ in range(7)]
    return {
        "plan_s": min(plan.solve_time_s for plan in plans),
        "osqp_s": min(
            plan_convex(problem, ConvexOptions(solver="osqp")).notes["solver"]["osqp_s"]
            for _ in range(7)
        ),
    }


if __name__ == "__main__":
    sys.exit(main())
