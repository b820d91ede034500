"""What judging a plan costs: integration, domain of the chart, and proof.

    python tests/benchmarks/judging.py      # writes results/judging/README.md

Plans of every method and of every kind of system are made once; the times are those of
`planner.verify`, of `plan.domain`, which chart laws need before, and of `planner.certify`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import planner
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "results" / "judging" / "README.md"
REPEATS, LEAST = 3, 0.15
"""A time is the median of so many calls or more, of so many CPU s or more together."""

SPEED = {"input_rad_s": [0.5, 0.4]}
RATES = {"input_rad_s": [0.5, 0.4], "input_rate_rad_s2": [3.0, 2.0]}


def arm(joints: int, start: list[float], goal: list[float], duration: float | str) -> Any:
    """An arm of the paper's kind, its constants continued by the paper's rule."""
    ratio = 0.711625 / 0.870125
    return planner.Problem.from_dict(
        {
            "system": {
                "kind": "manipulator",
                "joints": joints,
                "K": [0.870125 * ratio**k for k in range(joints - 1)],
                "k_g": 0.668811,
            },
            "start": {"theta_deg": start},
            "goal": {"theta_deg": goal, "travel": "free", "duration": duration},
            "limits": {"input_rad_s": 0.5, "joint_deg": 80},
        }
    )


def cases() -> dict[str, Callable[[], planner.Plan]]:
    """Names of rows to how their plans are made."""

    def shipped(name: str, method: str, **options: Any) -> planner.Plan:
        return planner.solve(
            planner.load_problem(ROOT / f"problems/{name}.toml"), method, **options
        )

    def free(method: str, travel: float, **options: Any) -> planner.Plan:
        paper = planner.load_problem(ROOT / "problems/paper.toml")
        limits = {"input_rad_s": 1e3, "joint_deg": 89}
        if method == "polynomial":
            limits["input_rate_rad_s2"] = 1e9
        problem = paper.changed({"limits": limits, "goal.travel": travel})
        return planner.solve(problem, method, **options)

    def long(joints: int, duration: float) -> planner.Plan:
        start, goal = [10.0] * joints, [-20.0 + 10 * k for k in range(joints)]
        return planner.solve(arm(joints, start, goal, duration), "collocation")

    def unlimited(travel: float) -> planner.Plan:
        return free("polynomial", travel)

    return {
        "paper, collocation": lambda: shipped("paper", "collocation"),
        "crossing, collocation": lambda: shipped("crossing", "collocation"),
        "four joints, shipped": lambda: shipped("four-joint", "collocation"),
        "four joints, long": lambda: long(4, 150.0),
        "five joints, long": lambda: long(5, 600.0),
        "polynomial, 83 rad/s": lambda: unlimited(0.8112),
        "polynomial, steeper": lambda: unlimited(0.803),
        "convex": lambda: shipped("paper", "convex"),
        "sinusoid": lambda: shipped("paper", "sinusoid"),
        "piecewise": lambda: free("piecewise", 0.8112),
        "trailers": lambda: shipped("trailers", "collocation"),
        "car": lambda: shipped("car", "collocation"),
        "ball gear": lambda: shipped("ball-gear", "collocation"),
        "ball gear, sinusoid": lambda: shipped("ball-gear", "sinusoid"),
        "custom": lambda: shipped("custom", "collocation"),
        "custom, polynomial": lambda: shipped("custom", "polynomial"),
        "obstacle": lambda: shipped("obstacle", "collocation"),
        "waypoint": lambda: shipped("waypoint", "collocation"),
        "retimed, inputs limited": lambda: planner.retime(unlimited(0.8112), SPEED),
        "retimed, rates limited": lambda: planner.retime(unlimited(0.8286), RATES, rest=True),
        "retimed collocation": lambda: planner.retime(shipped("paper", "collocation"), SPEED),
    }


def cost(what: Callable[[], object]) -> float:
    """Processor time of a call, ms."""
    spent: list[float] = []
    what()
    while len(spent) < REPEATS or sum(spent) < LEAST:
        began = time.process_time()
        what()
        spent.append(time.process_time() - began)
    return 1e3 * median(spent)


def domain(plan: planner.Plan) -> object:
    """The domain report, computed anew."""
    plan.__dict__.pop("domain", None)
    return plan.domain


def row(name: str, plan: planner.Plan) -> dict[str, object]:
    """What the page says of a plan."""
    check, proof = planner.verify(plan), planner.certify(plan)
    assert check.ok, f"{name} is not verified"
    asked = [claim.status for claim in proof.claims if claim.required]
    chart_law = not plan.trajectory.in_coordinates
    return {
        "plan": name,
        "pieces": len(plan.t) - 1,
        "verify, ms": f"{cost(lambda: planner.verify(plan)):.3g}",
        "domain, ms": f"{cost(lambda: domain(plan)):.3g}" if chart_law else "–",
        "certify, ms": f"{cost(lambda: planner.certify(plan)):.3g}",
        "cells": proof.cells,
        "claims proven": f"{asked.count('proven')} of {len(asked)}",
        "integration error": f"{check.integration_error:.1g}",
    }


HEAD = """# What judging a plan costs

Processor time, ms, median. `verify` integrates the motion and reads every limit, `certify` bounds
both over whole intervals (cells), and `domain` is what laws in the chart pay before. The
integration error is the judge's own estimate.

{table}

What it was shown, and what it said: [attacks.md](attacks.md), [verdict.md](verdict.md);
beside the judge: [whole.md](whole.md).
Random plans and damaged files beside an integrator of the tests' own: [outside.md](outside.md).

{provenance}
"""


def main() -> None:
    """Measure and write the page."""
    rows = []
    for name, make in cases().items():
        rows.append(row(name, make()))
        print(*rows[-1].values(), sep="  ", file=sys.stderr, flush=True)
    lines = [[*rows[0]], ["---"] * len(rows[0]), *([str(v) for v in r.values()] for r in rows)]
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    command = provenance("python tests/benchmarks/judging.py")
    PAGE.write_text(HEAD.format(table=table, provenance=command), encoding="utf-8")


if __name__ == "__main__":
    main()
