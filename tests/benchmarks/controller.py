"""The tracker in C beside the tracker in Python: errors, sizes, steps and instructions.

    python tests/benchmarks/controller.py [--samples 200]      # writes results/controller

Instructions are counted by valgrind where it is installed, on this computer's processor.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import planner
from planner import Machine, Plan, Replay, Tracker
from planner.report.controller.controller import Recorder
from planner.report.result_folder import folder
from planner.support.package import provenance

sys.path.append(str(Path(__file__).parents[1]))

from compiled_tracker import CompiledTracker, compile_c, compiler

ROOT, HERE = Path(__file__).parents[2], Path(__file__).parent
SEED = 0
REALS = ("double", "float")

RUNNER = """
#include <stdio.h>
#include "tracker.h"
int main(void) {
    static tracker arm;
    tracker_start(&arm);
    for (;;) {
        tracker_real measured[TRACKER_COORDINATES];
        double number;
        for (int i = 0; i < TRACKER_COORDINATES; i++) {
            if (scanf("%lf", &number) != 1) return 0;
            measured[i] = (tracker_real)number;
        }
        tracker_read(&arm, measured);
    }
}
"""
"""Reads from standard input what the encoders read."""


@dataclass
class Measured:
    """One plan by one tracker; sizes in bytes, instructions of a period, 50 % and the most."""

    name: str
    way: str
    run: Replay
    steps: NDArray[np.int64] | None = None
    sizes: dict[str, int] | None = None
    instructions: tuple[int, int] | None = None


def plans() -> dict[str, Plan]:
    """What is followed."""
    paper = planner.load_problem(ROOT / "problems/paper.toml")
    rated = paper.changed({"limits.input_rate_rad_s2": [2.0, 2.0]})
    parking = planner.load_problem(ROOT / "problems/parking.toml")
    return {
        "the paper's": planner.solve(paper, "collocation"),
        "input rates limited": planner.solve(rated, "collocation"),
        "parking": planner.solve(parking, "collocation"),
        "four joints": planner.solve(
            planner.load_problem(ROOT / "problems/four-joint.toml"), "collocation"
        ),
    }


def measured(name: str, plan: Plan, machine: Machine, samples: int) -> list[Measured]:
    """The plan by Python, and in C with both types."""
    tracker = Tracker(plan.problem.feedback)

    def run(feedback: Tracker | Recorder) -> Replay:
        return planner.replay(plan, machine, samples, SEED, feedback=feedback, record_s=None)

    rows = [Measured(name, "Python", run(tracker))]
    for real in REALS:
        with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
            warnings.simplefilter("ignore", planner.InputWarning)
            made = planner.export(plan, Path(place) / "c", "c", real=real, machine=machine)
            compiled = CompiledTracker(made, tracker.design(plan, machine))
            shadow, controls = Recorder(compiled), compiled.controls
            row = Measured(name, f"C, {real}", run(shadow))
            row.steps = np.concatenate(
                [np.array(one.steps) for one in controls if one.steps], axis=1
            )
            row.sizes = sizes(made)
            hardest = int(np.argmax(row.steps.max(axis=0)))
            readings = [read for _, read, _ in shadow.log]
            if row.steps.shape[1] == readings[0].shape[1]:
                row.instructions = instructions(made, np.array(readings)[:, :, hardest])
            rows.append(row)
    return rows


def sizes(made: Path) -> dict[str, int]:
    """Bytes of the sections of tracker.o, and of one tracker."""
    compile_c(made, ["-c", "tracker.c"])
    told = subprocess.run(["size", "-A", "tracker.o"], cwd=made, capture_output=True, text=True)
    found = {"code": 0, "tables": 0, "static": 0}
    for section, size in re.findall(r"^(\.\S+)\s+(\d+)", told.stdout, re.M):
        for start, kind in ((".text", "code"), (".rodata", "tables"), (".bss", "static")):
            found[kind] += int(size) * section.startswith(start)
    return found


def instructions(made: Path, readings: NDArray[np.float64]) -> tuple[int, int] | None:
    """Of one period: the median and the most, on the readings (K, N); None without valgrind."""
    if shutil.which("valgrind") is None:
        return None
    (made / "runner.c").write_text(RUNNER)
    compile_c(made, ["runner.c", "tracker.c", "-o", "runner"])
    words = "--tool=callgrind --callgrind-out-file=count --dump-after=tracker_read"
    text = "\n".join(" ".join(map(repr, row)) for row in readings.tolist())
    subprocess.run(
        ["valgrind", *words.split(), "--toggle-collect=tracker_read", "./runner"],
        cwd=made, input=text, text=True, capture_output=True, check=True,
    )  # fmt: skip
    totals = [re.search(r"^totals: (\d+)", p.read_text(), re.M) for p in made.glob("count.*")]
    counts = sorted(int(total[1]) for total in totals if total is not None)
    return counts[len(counts) // 2], counts[-1]


def page(rows: Sequence[Measured], samples: int) -> str:
    """What was measured, as Markdown."""
    errors = [
        f"| {row.name} | {row.way} | {row.run.percentile(95):.4f} |"
        f" {np.percentile(row.run.terminal_E_deg, 95):.4f} | {int(row.run.fallbacks.sum())} |"
        for row in rows
    ]
    costs = []
    for row in rows:
        if row.sizes is None or row.steps is None:
            continue
        kb = [f"{row.sizes[key] / 1024:.1f}" for key in ("code", "tables", "static")]
        taken = row.steps[row.steps != 0]
        steps = [f"{np.mean(row.steps != 0):.0%}"]
        steps += [f"{np.percentile(taken, 95):.0f}", f"{taken.max()}"] if len(taken) else ["", ""]
        counts = ["", ""] if row.instructions is None else [f"{n:,}" for n in row.instructions]
        costs.append(f"| {row.name} | {' | '.join([row.way, *kb, *steps, *counts])} |")
    text = (HERE / "controller.md").read_text(encoding="utf-8")
    parts = {
        "SAMPLES": str(samples),
        "ERRORS": "\n".join(errors),
        "COSTS": "\n".join(costs),
        "MADE_BY": provenance("make controller"),
    }
    for name, value in parts.items():
        text = text.replace(f"<{name}>", value)
    return text


def main() -> int:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=200)
    parser.add_argument("--out", type=Path, default=ROOT / "results/controller")
    arguments = parser.parse_args()
    if compiler() is None:
        raise SystemExit("no C compiler: nothing to measure")
    machine = Machine.prototype()
    rows = [
        row
        for name, plan in plans().items()
        for row in measured(name, plan, machine, arguments.samples)
    ]
    text = page(rows, arguments.samples)
    print(text)
    with folder(arguments.out) as place:
        (place / "README.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
