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

from planner.files import write_text
from planner.sweep import run_sweep
from planner.sweep.table import read

ROOT = Path(__file__).parents[2]

SCOPE = (
    "Overhead: wall time a case beyond the case's own, one process, first result to last.\n"
    "Two processes can be twice as fast as one at most, on two cores that do nothing else."
)


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
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=24, help="real cases")
    parser.add_argument("--empty", type=int, default=1000, help="cases that cost nothing")
    parser.add_argument("--out", type=Path, help="folder for sweep.md")
    arguments = parser.parse_args()
    base = {"problem": str(ROOT / "problems/paper.toml"), "methods": ["polynomial"]}
    lines = [*overhead(base, arguments.empty), *efficiency(base, arguments.cases)]
    print("\n".join(lines))
    if arguments.out:
        listing = "\n".join(f"    {line}" for line in lines)
        again = "Made by:\n\n    python tests/benchmarks/sweep.py --out results/benchmarks\n"
        write_text(
            arguments.out / "sweep.md",
            f"# What a sweep costs beside its cases\n\n{listing}\n\n{SCOPE}\n\n{again}",
        )


def overhead(base: dict[str, Any], count: int) -> list[str]:
    """Lines on cases that are refused at once."""
    grid = {"goal.duration": {"from": 0.01, "to": 0.3, "count": count}}
    _, first, rest, own = timed({**base, "grid": grid}, 1)
    cost = (rest - sum(own[1:])) / (count - 1)
    return [
        f"start of a process to its first result  {first:8.2f} s",
        f"cases refused at once, own time         {1e3 * sum(own) / len(own):8.2f} ms a case",
        f"overhead                                {1e3 * cost:8.2f} ms a case",
    ]


def efficiency(base: dict[str, Any], cases: int) -> list[str]:
    """Lines on the same cases by one process and by two."""
    real = {"goal.travel": {"from": 0.80, "to": 0.828, "count": cases}}
    tables = {**base, "set": {"limits.input_rad_s": 1000.0}, "grid": real}
    lines, wholes, alone = [], [], []
    for workers in (1, 2):
        busy = os.getloadavg()[0]
        whole, first, _, own = timed(tables, workers)
        wholes.append(whole)
        alone.append(whole - (first - own[0]))
        lines.append(
            f"{workers} process{'es' if workers > 1 else '  '}: {cases} cases of"
            f" {sum(own) / len(own):.2f} s in {whole:.1f} s (load before {busy:.1f})"
        )
    ratio, later = wholes[0] / wholes[1], alone[0] / alone[1]
    lines.append(
        f"two processes against one: {ratio:.2f} times; {later:.2f} times without their start"
    )
    return lines


if __name__ == "__main__":
    main()
