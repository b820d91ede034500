"""Collocation on one fixed set of problems: what is found, how good it is, and what it costs.

    python tests/benchmarks/searching.py RECORDS [--sets n3,n4] [--before OTHER_RECORDS] [--table]

One JSON line a problem is appended to RECORDS; problems that are there already are left out, so an
interrupted run goes on. The script uses only public names, so that an older version measures itself
by it: run it with that version's interpreter. Given durations are shares of the shortest one that
the older version found: run it first, and name its records with --before. With --table both are
compared on standard output.

The pairs of start and goal are those of `stress.py` (seed 41, on which nothing was chosen).
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from stress import FAMILIES, LIMIT_DEG, arm, pairs

import planner
from planner.methods.registry import merged_options
from planner.solve import judged

ROOT, SEED = Path(__file__).parents[2], 41
SHARES = (1.02, 1.5, 4.0)
FREE = {2: 4, 3: 6, 4: 3}
"""Pairs a family with a free duration."""
GIVEN = {2: 10, 3: 20, 4: 8}
NARROW = {
    3: {"positive": 3, "crossing": 3, "zero": 3, "singular": 1},
    4: {"crossing": 2, "zero": 1},
}
"""Pairs with joint limits drawn from 40 to 80 degrees; angles shrink with them."""
LONG = ("one-way", "positive", "crossing", "zero")

Record = dict[str, Any]


def main() -> int:
    """Measure what is not in the records yet, or compare two of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("records", type=Path)
    parser.add_argument("--sets", default="", help="only sets whose names begin with one of these")
    parser.add_argument("--before", type=Path, help="the older version's records")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    before = read(given.before or given.records)
    if given.table:
        print(table(before, read(given.records)))
        return 0
    planner.solve(planner.load_problem(ROOT / "problems" / "paper.toml"), "collocation")  # imports
    wanted = tuple(given.sets.split(","))
    for name, key, data in cases():
        if not name.startswith(wanted) or key in read(given.records):
            continue
        problem = made(data, before if given.before else read(given.records))
        if problem is None:
            continue
        with given.records.open("a") as out:
            out.write(json.dumps({"set": name, "key": key, **measured(problem)}) + "\n")
    return 0


def read(path: Path) -> dict[str, Record]:
    """Records by key."""
    lines = path.read_text().splitlines() if path.exists() else []
    return {record["key"]: record for record in map(json.loads, lines)}


def cases() -> Iterator[tuple[str, str, Any]]:
    """Name of the set, key, and a table of changes or a file's path."""
    for path in sorted((ROOT / "problems").glob("*.toml")):
        yield "files", path.stem, path
    for joints, count in FREE.items():
        free = []
        for number in range(count):
            for family in FAMILIES:
                key = f"n{joints} {family} {number}"
                pair = list(pairs(family, joints, number + 1, SEED))[number]
                free.append((key, pair))
                yield f"n{joints} free", key, (joints, pair)
        shares = itertools.cycle(SHARES)
        for (key, pair), share in zip(free[: GIVEN[joints]], shares, strict=False):
            yield f"n{joints} given", f"{key} x{share:g}", (joints, pair, key, share)
    for joints, numbers in NARROW.items():
        rng = np.random.default_rng((SEED, joints))
        for family, count in numbers.items():
            for number, pair in enumerate(pairs(family, joints, count, SEED + 1)):
                limit = round(float(rng.uniform(40.0, 80.0)), 1)
                pair |= {
                    f"{end}.theta_deg": [
                        round(angle * limit / LIMIT_DEG, 3) for angle in pair[f"{end}.theta_deg"]
                    ]
                    for end in ("start", "goal")
                }
                pair["limits.joint_deg"] = limit
                yield f"n{joints} narrow", f"n{joints} narrow {family} {number}", (joints, pair)
    for family in LONG:
        yield "n5 free", f"n5 {family} 0", (5, next(pairs(family, 5, 1, SEED)))


def made(data: Any, known: dict[str, Record]) -> planner.Problem | None:
    """The problem; None where the duration it is given is a share of one not found."""
    if isinstance(data, Path):
        return planner.load_problem(data)
    joints, pair, *share = data
    changes = dict(pair)
    if share:
        shortest = known.get(share[0], {}).get("duration_s")
        if shortest is None:
            return None
        changes["goal.duration"] = shortest * share[1]
    return planner.Problem.from_dict(arm(joints)).changed(changes)


def measured(problem: planner.Problem) -> Record:
    """Plan and judge one problem."""
    method = planner.METHODS["collocation"]
    began = time.process_time()
    try:
        plan = method.plan(problem, merged_options(problem, method, {}))
        planned = time.process_time()
        plan, _ = judged(plan)
    except planner.NoPlanError as error:
        seconds = time.process_time() - began
        return {"solved": False, "status": error.status, "why": str(error)[:300], "cpu_s": seconds}
    except Exception as error:  # a bug is a result too
        return {"solved": False, "status": "bug", "why": repr(error)[:300], "cpu_s": -1.0}
    return {
        "solved": True,
        "duration_s": plan.duration,
        "objective": plan.objective,
        "start": plan.notes["start"],
        "stage": plan.notes.get("stage"),
        "intervals": plan.notes.get("intervals"),
        "cpu_s": planned - began,
        "judging_s": time.process_time() - planned,
    }


def table(before: dict[str, Record], now: dict[str, Record]) -> str:
    """Both versions side by side, one row a set."""
    rows = [
        "| set | solved before / now | ratio min / median / max | CPU s before / now | ratio |",
        "|---|---|---|---|---|",
    ]
    worst = []
    for name in dict.fromkeys(record["set"] for record in before.values()):
        both = [(old, now[key]) for key, old in before.items() if old["set"] == name and key in now]
        if not both:
            continue
        ratios = []
        for old, new in both:
            if not (old["solved"] and new["solved"]):
                worst.append(f"- {old['key']}: {_said(old)} -> {_said(new)}")
                continue
            ratio = new[_measure(old)] / old[_measure(old)]
            ratios.append(ratio)
            if not 0.9 < ratio < 1.02:
                worst.append(f"- {old['key']}: {_said(old)} -> {_said(new)} ({ratio:.3f})")
        solved = [sum(pair[k]["solved"] for pair in both) for k in (0, 1)]
        cpu = [sum(pair[k]["cpu_s"] for pair in both) for k in (0, 1)]
        spread = np.quantile(ratios, [0, 0.5, 1]) if ratios else [np.nan] * 3
        rows.append(
            f"| {name}, {len(both)} | {solved[0]} / {solved[1]}"
            f" | {' / '.join(f'{r:.4g}' for r in spread)}"
            f" | {cpu[0]:.1f} / {cpu[1]:.1f} | {cpu[1] / cpu[0]:.2f} |"
        )
    return "\n".join([*rows, "", *worst])


def _measure(record: Record) -> str:
    return (
        "duration_s" if "given" not in record["set"] and record["set"] != "files" else "objective"
    )


def _said(record: Record) -> str:
    if not record["solved"]:
        return f"{record['status']} ({record['cpu_s']:.1f} s)"
    value = f"{record[_measure(record)]:.5g}"
    return f"{value} by {record['start']} ({record['cpu_s']:.1f} s)"


if __name__ == "__main__":
    sys.exit(main())
