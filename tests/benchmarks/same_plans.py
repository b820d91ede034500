"""Fingerprints of the plans of all problem files: a move of code must not change one bit.

    python tests/benchmarks/same_plans.py before.json             # on the version before
    python tests/benchmarks/same_plans.py --against before.json   # on this one

For each problem and method: a hash of q(t) and u(t) at 1001 times, or the kind of refusal. They
depend on the machine and its libraries, so they are compared where they were made, never kept.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import planner

ROOT = Path(__file__).parents[2]
METHODS = ("polynomial", "piecewise", "sinusoid", "collocation", "convex", "desensitised")


def fingerprint(problem: planner.Problem, method: str) -> str:
    """What a method makes of a problem, in one word."""
    try:
        plan = planner.solve(problem, method)
    except planner.PlannerError as error:
        return type(error).__name__
    t = np.linspace(0.0, plan.duration, 1001)
    whole = np.hstack([plan.q(t), plan.u(t)])
    return hashlib.sha256(np.ascontiguousarray(whole).tobytes()).hexdigest()[:16]


def main() -> int:
    """Write the fingerprints, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?")
    parser.add_argument("--against", type=Path)
    parser.add_argument("--methods", default=",".join(METHODS))
    given = parser.parse_args()
    found = {
        f"{path.stem} {method}": fingerprint(planner.load_problem(path), method)
        for path in sorted((ROOT / "problems").glob("*.toml"))
        for method in given.methods.split(",")
    }
    if given.out:
        given.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if given.against is None:
        return 0
    before = json.loads(given.against.read_text(encoding="utf-8"))
    changed = [key for key in before if key in found and found[key] != before[key]]
    print(f"{len(found)} plans and refusals, {len(changed)} changed", *changed, sep="\n  ")
    return bool(changed)


if __name__ == "__main__":
    sys.exit(main())
