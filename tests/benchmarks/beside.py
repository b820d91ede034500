"""Two versions side by side: processor seconds of methods, replays and whole commands.

    python tests/benchmarks/beside.py OLDER_CHECKOUT [--rounds 5]

The checkouts take turns, each in its own process; figures are the least of the rounds. Both need
their compiled replay (`make .venv/.run` in each). Writes results/benchmarks/before.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

MEASURE = """
import contextlib, json, statistics, sys, time, warnings
sys.path.insert(0, "tests/benchmarks")
import numpy
from stress_problems import SPREAD, arm
warnings.simplefilter("ignore")
import planner
problem = planner.load_problem("problems/paper.toml")
ways = {name: (name, {}) for name in ("collocation", "polynomial", "piecewise", "sinusoid")}
ways["polynomial, points = auto"] = "polynomial", {"points": "auto"}
ways["sinusoid_steps"] = "sinusoid_steps", {}

def seconds(job, times):
    out = []
    for _ in range(times):
        began = time.process_time()
        job()
        out.append(time.process_time() - began)
    return min(out)

def plan(name, options):
    method = planner.METHODS[name]
    return lambda: method.plan(problem, method.options(**options))

out = {f"plan: {words}": seconds(plan(*way), 5) for words, way in ways.items()}
motion = planner.solve(problem, "collocation")
machine = planner.Machine.prototype()
stiff = machine.without("shaft_stiffness_nm_per_rad")
dynamic = planner.Machine.prototype(fidelity="dynamic")
for words, one, count in (
    ("replay: 1000 machines", machine, 1000),
    ("replay: 100 machines without torsion", stiff, 100),
    ("replay: 100 machines with inertia", dynamic, 100),
):
    out[words] = seconds(lambda: planner.replay(motion, one, count, record_s=None), 2)

def pair(number, duration):
    rng = numpy.random.default_rng((77, 4, 40, number))
    places = numpy.round(rng.uniform(-40 * SPREAD, 40 * SPREAD, (2, 4)), 3).tolist()
    tables = arm("manipulator", 4, *places, 40.0)
    tables["goal"]["duration"] = duration
    method, posed = planner.METHODS["collocation"], planner.Problem.from_dict(tables)
    with contextlib.suppress(planner.NoPlanError):
        method.plan(posed, method.options())

for words, duration in (("the fastest plan", "free"), ("1 s is refused", 1.0)):
    times = [seconds(lambda: pair(number, duration), 1) for number in range(6)]
    out[f"four joints within 40 degrees, {words}"] = statistics.median(times)
print(json.dumps(out))
"""

COMMANDS = {
    "planner compare": ["compare", "problems/paper.toml", "--quiet"],
    "planner compare --out": ["compare", "problems/paper.toml", "--quiet", "--out", "out/beside"],
}


def run(checkout: Path, words: list[str]) -> tuple[str, float]:
    """The output of Python in a checkout, and its processor seconds."""
    env = {**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    before = os.times()
    done = subprocess.run(
        [sys.executable, *words], cwd=checkout, env=env, capture_output=True, text=True, check=True
    )
    after = os.times()
    used = after.children_user + after.children_system
    return done.stdout, used - before.children_user - before.children_system


def measure(checkout: Path) -> dict[str, float]:
    """Processor seconds of one round, by job."""
    out: dict[str, float] = json.loads(run(checkout, ["-c", MEASURE])[0].splitlines()[-1])
    for words, command in COMMANDS.items():
        out[words] = run(checkout, ["-m", "planner", *command])[1]
    return out


def commit(checkout: Path) -> str:
    """The checkout's commit."""
    words = ["git", "-C", str(checkout), "log", "-1", "--format=%h"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Measure in turns and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("older", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    rounds = [(measure(given.older.resolve()), measure(ROOT)) for _ in range(given.rounds)]
    rows = ["| job | before, CPU s | now, CPU s | ratio |", "| --- | ---: | ---: | ---: |"]
    for job in rounds[0][1]:
        before, now = (min(pair[k].get(job, float("nan")) for pair in rounds) for k in (0, 1))
        rows.append(f"| {job} | {before:.4g} | {now:.4g} | {now / before:.2f} |")
    text = f"""# Beside an earlier version

Commit {commit(given.older)} before, {commit(ROOT)} now; least of {given.rounds} rounds in turns.
Plans are those of problems/paper.toml, without verification; four joints: the median of six random
pairs.

{chr(10).join(rows)}

Made by

    python tests/benchmarks/beside.py OLDER_CHECKOUT --rounds {given.rounds}
"""
    (ROOT / "results/benchmarks/before.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
