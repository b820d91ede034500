"""What judging a plan costs, beside an earlier version of this package in the same run.

    python tests/benchmarks/judging.py [--plans FOLDER] [--python INTERPRETER] [--out FOLDER]

Plans of every method and of every kind of system are made once and saved in FOLDER. Both versions
read the same files and judge them in turn, so that what else the computer does falls on both: the
median processor time of `planner.verify` and of `plan.domain`, which chart laws need before.
INTERPRETER is the Python in whose environment the other version is installed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import planner
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]

JUDGE = """
import json, sys, time
from pathlib import Path
import planner

def cost(what, least):
    what(); spent = []
    while sum(spent) < least or len(spent) < 3:
        began = time.process_time(); what(); spent.append(time.process_time() - began)
    return 1e3 * sorted(spent)[len(spent) // 2]

def fresh(plan):
    plan.__dict__.pop("domain", None)
    return plan.domain

for line in sys.stdin:
    plan = planner.load_plan(Path(line.strip()))
    check = planner.verify(plan)
    found = {
        "verify": cost(lambda: planner.verify(plan), 0.15),
        "domain": 0.0 if plan.trajectory.in_coordinates else cost(lambda: fresh(plan), 0.1),
        "ok": check.ok, "margins": dict(check.margins), "end": check.terminal_error.tolist(),
        "error": getattr(check, "integration_error", None),
    }
    print(json.dumps(found), flush=True)
"""

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
        "custom": lambda: shipped("custom", "collocation"),
        "custom, polynomial": lambda: shipped("custom", "polynomial"),
        "obstacle": lambda: shipped("obstacle", "collocation"),
        "waypoint": lambda: shipped("waypoint", "collocation"),
        "retimed, inputs limited": lambda: planner.retime(unlimited(0.8112), SPEED),
        "retimed, rates limited": lambda: planner.retime(unlimited(0.8286), RATES, rest=True),
        "retimed collocation": lambda: planner.retime(shipped("paper", "collocation"), SPEED),
    }


def made(folder: Path) -> dict[str, Path]:
    """The plans' files, made where they are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    out = {}
    for name, make in cases().items():
        path = folder / (name.replace(" ", "-").replace(",", "").replace("/", "-") + ".json")
        if not path.exists():
            print(f"planning {name}", file=sys.stderr)
            replace(make(), certificate=None).save(path)
        out[name] = path
    return out


class Judge:
    """A version of this package that judges files, in a process of its own."""

    def __init__(self, python: str) -> None:
        self._process = subprocess.Popen(
            [python, "-c", JUDGE],
            cwd=tempfile.gettempdir(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __call__(self, path: Path) -> dict[str, Any]:
        assert self._process.stdin
        assert self._process.stdout
        print(path.resolve(), file=self._process.stdin, flush=True)
        return dict(json.loads(self._process.stdout.readline()))


def main() -> None:
    """Measure, print a table, and write it where asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plans", type=Path, help="keep the plans here")
    parser.add_argument("--python", help="interpreter of the version to compare with")
    parser.add_argument("--only", default="", help="rows whose name contains this")
    parser.add_argument("--rounds", type=int, default=3, help="turns of both versions")
    parser.add_argument("--out", type=Path, help="folder of the report")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as own:
        files = made(args.plans or Path(own))
        text = report({k: v for k, v in files.items() if args.only in k}, args.python, args.rounds)
    print(text)
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "README.md").write_text(text, encoding="utf-8")


def report(files: dict[str, Path], other: str | None, rounds: int) -> str:
    """The table as Markdown."""
    judges = {"now": Judge(sys.executable)} | ({"before": Judge(other)} if other else {})
    lines = [
        "# What judging a plan costs",
        "",
        "Processor time, ms, median; both versions judged the same files in turn, in one run, one",
        "core each. `domain` is what chart laws pay before `verify`. `integration error` is the",
        "judge's own estimate, `difference` that of both versions' ends of the motion.",
        "",
        "| plan | pieces | verify before → now | domain before → now | ratio of both together |"
        " integration error | difference |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, path in files.items():
        runs = [{k: judge(path) for k, judge in judges.items()} for _ in range(rounds)]
        spent = {
            k: {w: median(r[k][w] for r in runs) for w in ("verify", "domain")} for k in judges
        }
        last = runs[-1]
        assert all(run["ok"] for run in last.values()), f"{name} is not verified"
        now, before = spent["now"], spent.get("before", {"verify": 0.0, "domain": 0.0})
        ratio = sum(before.values()) / sum(now.values())
        ends = [run["end"] for run in last.values()]
        gap = max(abs(a - b) for a, b in zip(ends[0], ends[-1], strict=True))
        domain = f"{before['domain']:.3g} → {now['domain']:.3g}" if now["domain"] else "–"
        error = last["now"]["error"]
        pieces = len(planner.load_plan(path).t) - 1
        lines.append(
            f"| {name} | {pieces} | {before['verify']:.3g} → {now['verify']:.3g} | {domain} |"
            f" {ratio:.1f} | {'–' if error is None else f'{error:.1g}'} | {gap:.1g} |"
        )
        print(lines[-1], file=sys.stderr, flush=True)
    lines += ["", "What it was shown, and what it said: [attacks.md](attacks.md).", ""]
    lines.append(provenance("python tests/benchmarks/judging.py --python INTERPRETER --out FOLDER"))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
