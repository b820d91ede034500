"""Speed of collocation beside scripts written by hand, on the same problems in the same process.

    python tests/benchmarks/collocation.py [--rounds N] [--out FOLDER]

Times are processor time, which a busy computer disturbs least, and contestants take turns; ratios
are medians over the rounds. Of the rivals only the solver's call is timed, of `planner` the whole
of planning, from problem to plan; "whole way" adds the independent verification and the proof.
Frameworks (`frameworks.py`, the extra `rivals`) join in on two of the problems. The page begins
with the table of `beside.py`, which runs before.
Writes results/benchmarks: a page, a picture, and all numbers as JSON.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import bench_report
import numpy as np
import peers
import peers_theirs
from bench_cases import Case, along, cases, chain
from frameworks import frameworks, missing
from rich.console import Console
from rich.progress import Progress
from rivals import Outcome, radau_ipopt, shooting_fatrop
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator
from scipy.stats import linregress

import planner
from planner import chained_form
from planner.methods.collocation.method import plan_collocation, replan_collocation
from planner.methods.collocation.pipeline import DIRECT_INTERVALS
from planner.methods.collocation.solvers import Settings
from planner.methods.collocation.task import task
from planner.methods.collocation.transcription.bounds import InputDemands
from planner.methods.collocation.transcription.form import Form, objective, uniform
from planner.methods.convex.method import plan_convex
from planner.problem.tables.method_options import CollocationOptions, ConvexOptions
from planner.verification.verify import GOAL_TOLERANCE, LIMIT_TOLERANCE

OUT = Path(__file__).parents[2] / "results" / "benchmarks"
RADAU, SHOOTING = "plain Radau + IPOPT", "bare Fatrop"
RADAU_OURS = "plain Radau + IPOPT, our mesh"
OURS, WARM = "planner", "planner, warm"
WHOLE = "planner, whole way"
FRAMEWORKS_ON, FRAMEWORK_ROUNDS = ("paper", "limits"), 3
"""Problems on which frameworks join in, and rounds that they take part in: each takes long."""

SOLVES = 300
"""Solves whose memory is looked at."""

INTERVALS, JOINTS = (10, 20, 40, 80, 160, 320), range(3, 9)

LOOKS = 21
"""Places in each piece at which limits are looked at."""

ENOUGH_S = 20.0
"""Seconds after which a contest begins no further round."""

Call = Callable[[], Outcome]


def main() -> int:
    """Run all contests and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    with Progress(console=console, transient=True) as progress:
        step = progress.add_task("collocation", total=len(cases()) + 6)
        contests = {}
        for case in cases():
            progress.update(step, description=f"contest: {case.name}")
            contests[case.name] = contest(case, arguments.rounds)
            progress.advance(step)
        scaling = {}
        for name, measure in (
            ("intervals", over_intervals),
            ("joints", over_joints),
            ("convex", convex_time),
            ("paths", path_timings),
            ("fresh", bench_report.fresh_process),
            ("memory", memory),
        ):
            progress.update(step, description=name)
            scaling[name] = measure()
            progress.advance(step)
    found = {"contests": contests, "left_out": missing(), **scaling}
    bench_report.write(arguments.out, found)
    if missing():
        print(f"left out, for they are not installed: {', '.join(missing())}")
    return 0


def contest(case: Case, rounds: int) -> dict[str, Any]:
    """All contestants on one case: times, iterations, objective, error at the goal."""
    makers: dict[str, Callable[[], Call]] = {
        RADAU: lambda: radau_ipopt(case.arm),
        RADAU_OURS: lambda: radau_ipopt(case.arm, intervals=DIRECT_INTERVALS, linear=True),
        SHOOTING: lambda: shooting_fatrop(case.arm),
        OURS: lambda: ours(case),
        WHOLE: lambda: ours_verified(case),
        WARM: lambda: ours_warm(case),
    }
    others = frameworks(case.arm) if case.name in FRAMEWORKS_ON else {}
    makers |= others
    calls, build = {}, {}
    for name, make in makers.items():
        began = time.process_time()
        calls[name] = make()
        last = calls[name]()
        build[name] = time.process_time() - began - last.seconds
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    began = time.perf_counter()
    for k in range(rounds):
        if k >= 2 and time.perf_counter() - began > ENOUGH_S:
            break
        for name, call in calls.items():
            if name not in others or k < FRAMEWORK_ROUNDS:
                seconds[name].append(call().seconds)
    return {name: _row(case, name, calls[name](), seconds, build[name]) for name in calls}


def _row(
    case: Case, name: str, outcome: Outcome, seconds: dict[str, list[float]], build: float
) -> dict[str, Any]:
    own = np.array(seconds[name])
    against = {
        rival: float(np.median(np.array(seconds[rival])[: len(own)] / own))
        for rival in (RADAU, SHOOTING, OURS)
        if rival in seconds
    }
    problem = case.neighbour if name == WARM else case.problem
    goal, over = judged(problem, outcome)
    return {
        "least_s": float(own.min()),
        "median_s": float(np.median(own)),
        "build_s": build,
        "iterations": outcome.iterations,
        "objective": outcome.objective,
        "goal_error_rad": goal,
        "over_limits": over,
        "passes": bool(goal <= GOAL_TOLERANCE and over <= LIMIT_TOLERANCE),
        "times_faster_than": against,
    }


def ours(case: Case) -> Call:
    """From problem to plan; from the same straight line as the rivals."""
    options = CollocationOptions(start="straight")
    return lambda: _timed(lambda: plan_collocation(case.problem, options))


def ours_verified(case: Case) -> Call:
    """From problem to a plan that is verified and certified."""
    return lambda: _timed(lambda: planner.solve(case.problem, "collocation", start="straight"))


def ours_warm(case: Case) -> Call:
    """The neighbouring problem, from the plan of the case."""
    options = CollocationOptions(start="straight")
    plan = plan_collocation(case.problem, options)
    return lambda: _timed(lambda: replan_collocation(case.neighbour, options, plan))


def _timed(make: Callable[[], planner.Plan]) -> Outcome:
    began = time.process_time()
    plan = make()
    seconds = time.process_time() - began
    u = plan.trajectory.u_curve.c
    inputs = np.stack([u[0], u[-1]], axis=1)
    return Outcome(seconds, plan.objective, plan.iterations, inputs, edges=plan.t)


def judged(problem: planner.Problem, outcome: Outcome) -> tuple[float, float]:
    """What SciPy says of the motion that an outcome's inputs really make.

    Returns:
        The largest error at the goal, rad, and the largest excess over a limit, relative to it.
    """
    if np.isnan(outcome.objective):
        return np.nan, np.nan
    limits, system, q, over = problem.limits, problem.system, problem.start, 0.0
    pieces, count = outcome.inputs.shape[:2]
    shares = np.linspace(0, 1, count) if outcome.shares is None else outcome.shares
    edges = outcome.edges
    if edges is None:
        edges = np.linspace(0, problem.duration, pieces + 1)
    for k in range(pieces):
        a, b = edges[k], edges[k + 1]
        input_at = _polynomial(a + (b - a) * shares, outcome.inputs[k])
        rates = lambda t, q, u=input_at: system.rates(q, u(t))  # noqa: E731
        times = np.linspace(a, b, LOOKS)
        states = solve_ivp(rates, (a, b), q, "DOP853", times, rtol=1e-11, atol=1e-13).y.T
        worst = [np.abs(states) / limits.joint - 1, np.abs(input_at(times)) / limits.input - 1]
        if (margin := limits.z2_margin) is not None:
            z2 = problem.z2_sign * chained_form(system).z(states)[:, 1]
            worst.append((margin - z2) / max(margin, 1e-3))
        q, over = states[-1], max(over, *(float(np.max(each)) for each in worst))
    return float(np.nanmax(np.abs(q - problem.goal))), over


def _polynomial(times: Any, values: Any) -> Callable[[Any], Any]:
    """Through values (m, 2) at times (m,)."""
    if len(times) == 1:
        return lambda t: np.broadcast_to(values[0], (*np.shape(t), 2))
    return BarycentricInterpolator(times, values)


def memory() -> dict[str, Any]:
    """Resident memory, MiB, after each third of `SOLVES` varied problems, in two processes.

    The first plans from scratch, the second from the plan before. Both begin with a few solves,
    after which everything that is kept is there.
    """
    return {arm: _grown(arm == "warm") for arm in ("cold", "warm")}


def _grown(warm: bool) -> list[float]:
    code = f"import collocation; collocation.solved_again_and_again({warm})"
    folder = Path(__file__).parent
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder
    )
    return [round(float(word), 1) for word in said.stdout.split()]


def solved_again_and_again(warm: bool) -> None:
    """Solve varied problems and print the process's memory four times, MiB."""
    rng, plan = np.random.default_rng(3), None
    for k in range(SOLVES + 31):
        if k >= 30 and (k - 30) % (SOLVES // 3) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            print(pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
        base = cases()[k % 2].problem
        goal = np.rad2deg(base.goal[1:]) + rng.uniform(-0.5, 0.5, 3)
        problem = base.changed({"goal.theta_deg": goal.tolist()})
        plan = planner.solve(problem, "collocation", warm=plan if warm else None, start="straight")


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
            problem,
            objective(problem, CollocationOptions()),
            form,
            mesh,
            InputDemands(),
            Settings(),
        )
        start = along(problem, mesh)
        job, seconds = replace(job, settings=Settings(solver="ipopt")), []
        for _ in range(4):
            began = time.process_time()
            found = job.solve(start)
            seconds.append(time.process_time() - began)
        rows[joints + 1] = {
            "iterations": found.iterations,
            "per_iteration_s": min(seconds[1:]) / found.iterations,
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


def path_timings() -> dict[str, dict[str, float]]:
    """Of random paths: seconds a path, and % above toppra's time on a fine grid in the median."""
    if not find_spec("toppra"):
        return {}
    theirs, count = peers_theirs.timings(), peers_theirs.PATHS
    ours = np.array([peers.timing(seed) for seed in range(count)])
    seconds = {"planner": float(np.mean(ours[:, 1])), "toppra": theirs["seconds"] / count}
    durations = {"planner": ours[:, 0], "toppra": np.array(theirs["durations"])}
    return {
        name: {"seconds": seconds[name], "above": 100 * float(np.median(own / theirs["fine"] - 1))}
        for name, own in durations.items()
    }


def convex_time() -> float:
    """Solve time of the convex method as a whole, s."""
    problem = cases()[0].problem.changed({"goal.travel": 0.79, "limits": {"z2_margin": 0.01}})
    return min(plan_convex(problem, ConvexOptions()).solve_time_s for _ in range(5))


if __name__ == "__main__":
    sys.exit(main())
