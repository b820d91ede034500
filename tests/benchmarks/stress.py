"""A campaign over random pairs of start and goal: does collocation always answer, and how well?

    python tests/benchmarks/stress.py [--cases N] [--joints 2:300,3,4] [--seed S] [--out FOLDER]

Five families for each number of joints, N pairs each (5:20 means five joints, 20 pairs), with the
duration free, joint limits of 80 degrees and inputs up to 0.5 rad/s:

- one-way: the goal is where a random motion leads whose drive never turns back;
- positive: start and goal anywhere in 1 ... 75 degrees;
- crossing: anywhere in -75 ... 75 degrees;
- zero: likewise, and the travel must be zero;
- singular: start and goal within 0.5 degrees of zero in every joint.

Each finished case is kept at once in a database, so that a campaign that ends early, however it
ends, is continued by the same command. A second pass plans a sample of the pairs again from 50
random starts and compares the durations; beyond four joints most of these lead nowhere, and all
take long. Writes README.md to the folder.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from scipy.integrate import solve_ivp
from stress_report import page

import planner
from planner.support.files import write_text
from planner.sweep.results import read
from planner.sweep.run import run_sweep

ROOT = Path(__file__).parents[2]
FAMILIES = ("one-way", "positive", "crossing", "zero", "singular")
METHOD, RANDOM = "collocation", "collocation:start=wander:starts=50:attempts=50"
RATIO, K2, K_G = 0.8178, 0.870125, 0.668811
LIMIT_DEG, SPREAD_DEG, NEAR_DEG, INPUT = 80.0, 75.0, 0.5, 0.5

JOINTS, SAMPLE = "2:300,3:150,4:50,5:20,6:10", "2:10,3:10,4:10"

Pair = dict[str, Any]
Record = dict[str, Any]


def main() -> int:
    """Run what is not in the database yet, and write the table of all that is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=100, help="pairs a family and joint number")
    parser.add_argument("--joints", default=JOINTS, help="numbers of joints")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sample", default=SAMPLE, help="pairs planned from 50 random starts")
    parser.add_argument("--workers", type=int, help="processes, as many as cores if left out")
    parser.add_argument("--db", type=Path, default=ROOT / "out" / "stress.sqlite")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "stress")
    given = parser.parse_args()
    given.db.parent.mkdir(parents=True, exist_ok=True)
    found = []
    for joints, cases in counted(given.joints, given.cases):
        labelled = [
            (family, pair)
            for family in FAMILIES
            for pair in pairs(family, joints, cases, given.seed)
        ]
        planned = run(joints, [pair for _, pair in labelled], METHOD, given)
        size = dict(counted(given.sample, 0)).get(joints, 0)
        sampled = [k for k in range(len(labelled)) if k % cases < size]
        again = run(joints, [labelled[k][1] for k in sampled], RANDOM, given) if sampled else []
        best = dict(zip(sampled, again, strict=True))
        found += [
            {**planned[k], "joints": joints, "family": family, "random": best.get(k)}
            for k, (family, _) in enumerate(labelled)
        ]
    given.out.mkdir(parents=True, exist_ok=True)
    write_text(given.out / "README.md", page(found, given.seed, _options(given)))
    failed = [row for row in found if not row["solved"]]
    print(f"{len(found)} cases, {len(failed)} without a plan; {given.out / 'README.md'}")
    return 0


def _options(given: argparse.Namespace) -> str:
    counts = f"--joints {given.joints} --cases {given.cases} --seed {given.seed}"
    return f"{counts} --sample {given.sample}"


def counted(text: str, cases: int) -> Iterator[tuple[int, int]]:
    """Numbers of joints and of pairs a family, from `2,3,5:20`."""
    for word in text.split(","):
        joints, _, own = word.partition(":")
        yield int(joints), int(own or cases)


def run(joints: int, rows: list[Pair], method: str, given: argparse.Namespace) -> list[Record]:
    """The records of these pairs, in their order; only what the database lacks is run."""
    base = planner.Problem.from_dict(arm(joints))
    sweep = {"problem": base, "methods": [method], "cases": rows, "plans": method == METHOD}
    columns = TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True)) as bar:
        step = bar.add_task(f"{joints} joints, {method}", total=1.0)
        run_sweep(
            sweep,
            given.db,
            workers=given.workers,
            retry=["bug"],
            progress=lambda text, share: bar.update(step, completed=share),
        )
    return list(read(given.db)[1])


def arm(joints: int) -> dict[str, Any]:
    """The prototype's proportions for any number of joints: k_i falls by the same ratio."""
    rest = [0.0] * joints
    return {
        "system": {
            "kind": "manipulator",
            "joints": joints,
            "K": [K2 * RATIO**k for k in range(joints - 1)],
            "k_g": K_G,
        },
        "start": {"theta_deg": rest},
        "goal": {"theta_deg": rest, "travel": "free", "duration": "free"},
        "limits": {"input_rad_s": [INPUT, INPUT], "joint_deg": LIMIT_DEG},
    }


def pairs(family: str, joints: int, count: int, seed: int) -> Iterator[Pair]:
    """The first `count` pairs of a family; more of them begin with the same ones."""
    rng = np.random.default_rng((seed, joints, FAMILIES.index(family)))
    for _ in range(count):
        if family == "one-way":
            start, goal = one_way(joints, rng)
        else:
            low, high = {"positive": (1.0, SPREAD_DEG), "singular": (-NEAR_DEG, NEAR_DEG)}.get(
                family, (-SPREAD_DEG, SPREAD_DEG)
            )
            start, goal = rng.uniform(low, high, (2, joints))
        yield {
            "start.theta_deg": np.round(start, 3).tolist(),
            "goal.theta_deg": np.round(goal, 3).tolist(),
            "goal.travel": 0.0 if family == "zero" else "free",
        }


def one_way(joints: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """Start and end, in degrees, of a random motion with u1 > 0 within 75 degrees."""
    system = planner.Problem.from_dict(arm(joints)).system
    while True:
        start = np.append(0.0, np.deg2rad(rng.uniform(-SPREAD_DEG, SPREAD_DEG / 2, joints)))
        ends = np.deg2rad(rng.uniform(-SPREAD_DEG, SPREAD_DEG, 4))
        long = rng.uniform(0.3, 3.0)

        def rates(s: float, q: Any, first: Any = start, knots: Any = ends, far: Any = long) -> Any:
            slope = np.diff(np.append(first[1], knots))[min(int(4 * s), 3)] * 4
            return system.rates(q, np.array([far, slope]))

        path = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-10, atol=1e-10, max_step=0.05).y
        if np.all(np.abs(path[1:]) <= np.deg2rad(SPREAD_DEG)):
            return np.rad2deg(start[1:]), np.rad2deg(path[1:, -1])


if __name__ == "__main__":
    sys.exit(main())
