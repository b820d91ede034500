"""What a sweep costs beside its cases, and what a second process gains.

    python tests/benchmarks/sweep.py [--cases N]

Overhead: wall time a case beyond the case's own, over cases that are refused at once, with one
process, counted from the first result to the last (the start of a process is printed by itself).
Efficiency: time of the same planned and verified cases with one process over that with two; 2 is
the best there is. On a computer that does other things the clock says little; processor time then
bounds both: the overhead from above, and the gain by what is done twice.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from planner import run_sweep
from planner.support.files import write_text
from planner.support.package import provenance
from planner.sweep.results import read

ROOT = Path(__file__).parents[2]

SCOPE = (
    "Overhead: time a case beyond the case's own, one process, first result to last. Processor\n"
    "time counts all processes, and is what a computer that does other things as well can tell."
)


@dataclass(frozen=True)
class Run:
    """One sweep: seconds as a whole, until the first result, and after it; each case's own; and of
    all processors together."""

    whole: float
    first: float
    rest: float
    own: list[float]
    cpu: float


def timed(tables: dict[str, Any], workers: int) -> Run:
    """Run a sweep."""
    marks: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        db = Path(folder) / "x.sqlite"
        began, busy = perf_counter(), processors()
        run_sweep(tables, db, workers=workers, progress=lambda *_: marks.append(perf_counter()))
        ended, spent = perf_counter(), processors() - busy
        own = sorted((r["finished_at"], r["case_time_s"]) for r in read(db)[1])
    seconds = [case for _, case in own]
    return Run(ended - began, marks[1] - began, marks[-1] - marks[1], seconds, spent)


def processors() -> float:
    """Processor time so far, of this process and of those it has started and seen end, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=96, help="real cases")
    parser.add_argument("--empty", type=int, default=1000, help="cases that cost nothing")
    parser.add_argument("--out", type=Path, help="folder for sweep.md")
    arguments = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else every process compiles what it imports
    base = {"problem": str(ROOT / "problems/paper.toml"), "methods": ["polynomial"]}
    lines = [*overhead(base, arguments.empty), *efficiency(base, arguments.cases)]
    print("\n".join(lines))
    if arguments.out:
        listing = "\n".join(f"    {line}" for line in lines)
        again = provenance("python tests/benchmarks/sweep.py --out results/benchmarks")
        write_text(
            arguments.out / "sweep.md",
            f"# What a sweep costs beside its cases\n\n{listing}\n\n{SCOPE}\n\n{again}\n",
        )


def overhead(base: dict[str, Any], count: int) -> list[str]:
    """Lines on cases that are refused at once."""
    grid = {"goal.duration": {"from": 0.01, "to": 0.3, "count": count}}
    one = timed({**base, "grid": {"goal.duration": [0.01]}}, 1)
    run = timed({**base, "grid": grid}, 1)
    clock = (run.rest - sum(run.own[1:])) / (count - 1)
    busy = (run.cpu - one.cpu) / (count - 1)
    return [
        f"start of a process to its first result  {run.first:8.2f} s",
        f"cases refused at once, own time         {1e3 * sum(run.own) / count:8.2f} ms a case",
        f"overhead by the clock                   {1e3 * clock:8.2f} ms a case",
        f"processor time, the case's own included {1e3 * busy:8.2f} ms a case",
    ]


def efficiency(base: dict[str, Any], cases: int) -> list[str]:
    """Lines on the same cases by one process and by two."""
    real = {"goal.travel": {"from": 0.80, "to": 0.828, "count": cases}}
    tables = {**base, "set": {"limits.input_rad_s": 1000.0}, "grid": real}
    lines, runs = [], []
    for workers in (1, 2):
        load = os.getloadavg()[0]
        run = timed(tables, workers)
        runs.append(run)
        lines.append(
            f"{workers} process{'es' if workers > 1 else '  '}: {cases} cases of"
            f" {sum(run.own) / cases:.2f} s in {run.whole:.1f} s, processors {run.cpu:.1f} s"
            f" (load before {load:.1f})"
        )
    one, two = runs
    later = (one.whole - one.first + one.own[0]) / (two.whole - two.first + two.own[0])
    return [
        *lines,
        f"two processes against one: {one.whole / two.whole:.2f} times by the clock;"
        f" {later:.2f} times without their start; {2 * one.cpu / two.cpu:.2f} times by processor"
        " time, if two processors do nothing else",
    ]


if __name__ == "__main__":
    main()
