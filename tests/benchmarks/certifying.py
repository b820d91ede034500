"""The certificate against that of another checkout: CPU time, cells, statuses and margins.

    python tests/benchmarks/certifying.py OTHER/CHECKOUT [--out results/certificate/README.md]

The other checkout, with its own `.venv`, makes the plans; then both certify each of them in turn,
in two processes that live side by side, so that a busy machine slows both alike.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPEATS = 7
WEAKER = 1e-8
"""Margin given up, relative to it or one, that the table counts as weaker."""

CASES = {
    "paper, collocation": ("paper", "collocation", {}, False),
    "four joints, collocation": ("four-joint", "collocation", {}, False),
    "ball gear, collocation": ("ball-gear", "collocation", {}, False),
    "car, collocation": ("car", "collocation", {}, False),
    "trailers, collocation": ("trailers", "collocation", {}, False),
    "custom, collocation": ("custom", "collocation", {}, False),
    "obstacle, collocation": ("obstacle", "collocation", {}, False),
    "ball gear, polynomial": ("ball-gear", "polynomial", {}, False),
    "ball gear, sinusoid": ("ball-gear", "sinusoid", {}, False),
    "car, piecewise": ("car", "piecewise", {}, False),
    "paper, convex": ("paper", "convex", {"pieces": 30, "scan": 5}, False),
    "paper, collocation, retimed": ("paper", "collocation", {}, True),
    "ball gear, polynomial, retimed": ("ball-gear", "polynomial", {}, True),
}


def make(folder: str) -> None:
    """Save the plans to a folder."""
    import planner

    for name, (problem, method, options, retimed) in CASES.items():
        plan = planner.solve(
            planner.load_problem(Path(f"problems/{problem}.toml")), method, **options
        )
        (planner.retime(plan) if retimed else plan).save(Path(folder) / f"{name}.json")


def serve() -> None:
    """Certify the plan files that come as lines; answer with milliseconds and claims."""
    import planner
    import planner.plan.retimed

    plans = {}
    for line in sys.stdin:
        path = line.strip()
        if path not in plans:
            plans[path] = planner.load_plan(Path(path))
            planner.certify(plans[path])
        began = time.process_time()
        found = planner.certify(plans[path])
        spent = 1e3 * (time.process_time() - began)
        claims = {c.label: (c.status, c.guaranteed) for c in found.claims}
        print(json.dumps([spent, found.cells, claims]), flush=True)


def compare(other: Path, out: Path) -> None:
    """Measure and write the table."""
    from planner.support.package import provenance

    here, script = Path(__file__).parents[2], Path(__file__).resolve()
    with tempfile.TemporaryDirectory() as folder:
        python = [str(where / ".venv/bin/python") for where in (other, here)]
        subprocess.run([python[0], str(script), "--make", folder], cwd=other, check=True)
        both = [
            subprocess.Popen(
                [own, str(script), "--serve"],
                cwd=where,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for own, where in zip(python, (other, here), strict=True)
        ]
        rows, ratios = [], []
        for name in CASES:
            answers = []
            for _ in range(REPEATS):
                for process in both:
                    assert process.stdin is not None
                    assert process.stdout is not None
                    process.stdin.write(f"{folder}/{name}.json\n")
                    process.stdin.flush()
                    answers.append(json.loads(process.stdout.readline()))
            old, new = answers[-2:]
            times = [statistics.median(a[0] for a in answers[k::2]) for k in range(2)]
            ratios.append(times[0] / times[1])
            shared = old[2].keys() & new[2].keys()
            changed = sum(old[2][x][0] != new[2][x][0] for x in shared)
            given_up = [(old[2][x][1] - new[2][x][1]) / max(abs(old[2][x][1]), 1) for x in shared]
            weaker = sum(not loss <= WEAKER for loss in given_up)
            rows.append(
                f"| {name} | {times[0]:.1f} → {times[1]:.1f} ({ratios[-1]:.1f}×) "
                f"| {old[1]} → {new[1]} | {changed} | {weaker} | {len(shared)} |"
            )
        for process in both:
            process.communicate()
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(
        "# The certificate, before and after\n\n"
        f"Median CPU time of {REPEATS} runs, in turn, on one machine; "
        f"median ratio {statistics.median(ratios):.1f}.\n"
        "Weaker: guaranteed margins that are smaller by more than 1e-8 of them or one.\n\n"
        "| plan | ms | cells | statuses changed | weaker | claims |\n|---|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
        + provenance("python tests/benchmarks/certifying.py OTHER")
        + "\n"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("other", nargs="?", type=Path)
    parser.add_argument("--out", type=Path, default=Path("results/certificate/README.md"))
    parser.add_argument("--make")
    parser.add_argument("--serve", action="store_true")
    given = parser.parse_args()
    if given.make:
        make(given.make)
    elif given.serve:
        serve()
    else:
        compare(given.other.resolve(), given.out.resolve())
