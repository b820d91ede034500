"""What a sweep costs beside its cases, and what a second process gains.

    python tests/benchmarks/sweep.py [--cases N]

Overhead: wall time a case beyond the case's own, over cases that are refused at once, with one
process, counted from the first result to the last (the start of a process is printed by itself).
Efficiency: wall time of the same planned and verified cases with one process over that with two,
with and without the start of the processes; 2 is the best there is, on two cores that do nothing
else.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from planner.sweep import run_sweep
from planner.sweep.table import read

ROOT = Path(__file__).parents[2]


def timed(tables: dict[str, Any], workers: int) -> tuple[float, float, float, list[float]]:
    """Seconds as a whole, until the first result, and after it; and each case's own."""
    marks: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        db = Path(folder) / "x.sqlite"
        began = perf_counter()
        run_sweep(tables, db, workers=workers, progress=lambda *_: marks.append(perf_counter()))
        ended = perf_counter()
        own = sorted((r["finished_at"], r["case_time_s"]) for r in read(db)[1])
    return ended - began, marks[1] - began, marks[-1] - marks[1], [seconds for _, seconds in own]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=24, help="real cases")
    parser.add_argument("--empty", type=int, default=1000, help="cases that cost nothing")
    arguments = parser.parse_args()
    base = {"problem": str(ROOT / "problems/paper.toml"), "methods": ["polynomial"]}

    grid = {"goal.duration": {"from": 0.01, "to": 0.3, "count": arguments.empty}}
    whole, first, rest, own = timed({**base, "grid": grid}, 1)
    overhead = (rest - sum(own[1:])) / (arguments.empty - 1)
    print(f"start of a process to its first result  {first:8.2f} s")
    print(f"cases refused at once, own time         {1e3 * sum(own) / len(own):8.2f} ms a case")
    print(f"overhead                                {1e3 * overhead:8.2f} ms a case")

    real = {"goal.travel": {"from": 0.80, "to": 0.828, "count": arguments.cases}}
    tables = {**base, "set": {"limits.input_rad_s": 1000.0}, "grid": real}
    wholes, alone = [], []
    for workers in (1, 2):
        busy = os.getloadavg()[0]
        whole, first, rest, own = timed(tables, workers)
        wholes.append(whole)
        alone.append(whole - (first - own[0]))
        print(
            f"{workers} process{'es' if workers > 1 else '  '}: {arguments.cases} cases of"
            f" {sum(own) / len(own):.2f} s in {whole:.1f} s (load before {busy:.1f})"
        )
    print(
        f"two processes against one: {wholes[0] / wholes[1]:.2f} times;"
        f" {alone[0] / alone[1]:.2f} times without their start"
    )


if __name__ == "__main__":
    main()
