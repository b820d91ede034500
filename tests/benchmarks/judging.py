"""What judging a plan costs: integration, domain of the chart, and proof.

    python tests/benchmarks/judging.py      # writes results/judging/README.md

Plans of every method and of every kind of system are made once; the times are those of
`planner.verify`, of `plan.domain`, which chart laws need before, and of `planner.certify`.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from statistics import median
from typing import Any

from stress_problems import WIDE, arm

import planner
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "results" / "judging" / "README.md"
REPEATS, LEAST = 3, 0.15
"""A time is the median of so many calls or more, of so many CPU s or more together."""

SPEED = {"input_rad_s": [0.5, 0.4]}
RATES = {"input_rad_s": [0.5, 0.4], "input_rate_rad_s2": [3.0, 2.0]}
Record = dict[str, Any]


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
        tables = arm("manipulator", joints, start, goal, WIDE)
        tables["goal"]["duration"] = duration
        return planner.solve(planner.Problem.from_dict(tables), "collocation")

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


def row(name: str, plan: planner.Plan) -> Record:
    """What the page says of a plan."""
    check, proof = planner.verify(plan), planner.certify(plan)
    assert check.ok, f"{name} is not verified"
    asked = [claim.status for claim in proof.claims if claim.required]
    chart_law = not plan.trajectory.in_coordinates
    return {
        "plan": name,
        "pieces": len(plan.t) - 1,
        "verify": cost(lambda: planner.verify(plan)),
        "domain": cost(lambda: domain(plan)) if chart_law else math.nan,
        "certify": cost(lambda: planner.certify(plan)),
        "cells": proof.cells,
        "proven": f"{asked.count('proven')} of {len(asked)}",
        "error": check.integration_error,
    }


COLUMNS: list[Column[Record]] = [
    Column("plan", "", itemgetter("plan"), left=True),
    Column("pieces", "", itemgetter("pieces")),
    *(Column(name, "ms", itemgetter(name)) for name in ("verify", "domain", "certify")),
    Column("cells", "", itemgetter("cells")),
    Column("claims proven", "", itemgetter("proven")),
    Column("integration error", "", itemgetter("error")),
]


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
    command = provenance("python tests/benchmarks/judging.py")
    page = HEAD.format(table=markdown_table(COLUMNS, rows), provenance=command)
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
