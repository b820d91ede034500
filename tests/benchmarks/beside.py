"""Every place where people wait, beside an earlier version: the first table of results/benchmarks.

    python tests/benchmarks/beside.py [JOB ...] [--before COMMIT] [--rounds 2]

The earlier version is built from the repository's history into out/before. The jobs are those of
`jobs.py`, each in a process of its own, the versions in turns; a case's seconds are the least of
the rounds, and of the processor. Writes results/benchmarks/beside.json, of which `bench_report.py`
makes the table; of named jobs only their part.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jobs import JOBS, LAWS, METHODS
from rich.console import Console
from rich.progress import Progress

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "results" / "benchmarks" / "beside.json"
LONGEST = ("post_in_the_way", "four_joints", "four_joints_refused")
"""Jobs of minutes, which are run once."""


@dataclass(frozen=True)
class Row:
    """A line of the table: a figure of some cases of a job, and the most it may be of before."""

    words: str
    job: str
    cases: slice
    aim: float | None
    figure: Callable[[Sequence[float]], float] = np.median


ALL = slice(None)
ROWS = (
    Row("three joints beside a post, half of 12 pairs", "beside_post", ALL, 0.4),
    Row("the slowest of them", "beside_post", ALL, None, max),
    Row("a post in the way, half of 8 pairs", "post_in_the_way", ALL, 0.42),
    Row("the slowest of them", "post_in_the_way", ALL, 0.5, max),
    Row("the same post written twelve times", "same_post", ALL, 0.1),
    Row("four joints, the fastest plan, half of 6 pairs", "four_joints", ALL, 0.75),
    Row("the same in 1 s", "four_joints_refused", ALL, None),
    *(
        Row(f"{name}, the paper's problem in 20 s", "plans", slice(k, k + 1), None)
        for k, name in enumerate(METHODS)
    ),
    *(
        Row(f"{law}, the paper's problem in 6 s, with advice", "refusals", slice(k, k + 1), aim)
        for k, (law, aim) in enumerate(zip(LAWS, (0.62, 0.6, None, 0.41), strict=True))
    ),
    Row("replay of 1000 machines", "replays", slice(0, 1), 0.32),
    Row("replay of 100 machines with inertia", "replays", slice(1, 2), 0.57),
    Row("replay of 100 machines with feedback", "replays", slice(2, 3), 0.8),
    Row("fastest timing of a path", "timing", ALL, None),
    Row("planner --help", "commands", slice(0, 1), None),
    Row("planner compare", "commands", slice(1, 2), None),
    Row("planner compare --out (make compare)", "commands", slice(2, 3), 0.54),
)  # fmt: skip


def built(commit: str, folder: Path) -> Path:
    """An earlier version as pip would install it, its compiled replay included."""
    target = folder / commit / "installed"
    if list(target.glob("planner/machine/_kernel*")):
        return target
    words = ["git", "-C", str(ROOT), "archive", commit]
    try:
        archive = subprocess.run(words, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        sys.exit(f"{commit} is not in the history here: name another by --before, BEFORE= in make")
    with tarfile.open(fileobj=io.BytesIO(archive)) as packed:
        packed.extractall(folder / commit / "source", filter="data")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target"]
    subprocess.run([*pip, str(target), str(folder / commit / "source")], check=True)
    if not list(target.glob("planner/machine/_kernel*")):
        sys.exit("a C compiler is needed: without the compiled replay there is nothing to compare")
    return target


def timed(job: str, package: Path) -> dict[str, list[Any]]:
    """Seconds of the cases of a job with a version, and which of them it solves."""
    env = {**os.environ, "PYTHONPATH": str(package), "OPENBLAS_NUM_THREADS": "1"}
    words = [sys.executable, str(Path(__file__).with_name("jobs.py")), job]
    done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=True)
    found: dict[str, list[Any]] = json.loads(done.stdout.splitlines()[-1])
    return found


def turns(job: str, packages: Sequence[Path], rounds: int) -> list[dict[str, list[Any]]]:
    """For each version: the least seconds of each case, and what it solves."""
    runs: list[list[dict[str, list[Any]]]] = [[] for _ in packages]
    for _ in range(1 if job in LONGEST else rounds):
        for package, own in zip(packages, runs, strict=True):
            own.append(timed(job, package))
    return [
        {
            "seconds": np.min([run["seconds"] for run in own], axis=0).tolist(),
            "solved": own[0]["solved"],
        }
        for own in runs
    ]


def table(found: dict[str, Any]) -> Iterator[list[str]]:
    """The cells of each line: words, seconds of both, ratio, aim and whether it is met."""
    for row in ROWS:
        own = [row.figure(each["seconds"][row.cases]) for each in found["jobs"][row.job]]
        ratio = own[1] / own[0]
        met = (
            "" if row.aim is None else f"{row.aim:g}, " + ("met" if ratio <= row.aim else "missed")
        )
        cases = range(len(found["jobs"][row.job][1]["seconds"]))[row.cases]
        refused = not any(set(cases) & {*each["solved"]} for each in found["jobs"][row.job])
        yield [
            row.words + ", refused" * refused,
            *(f"{value:.3g}" for value in own),
            f"{ratio:.2f}",
            met,
        ]


def lost(found: dict[str, Any]) -> list[str]:
    """Jobs and numbers of the cases that only the earlier version solves."""
    return [
        f"{job} {case}"
        for job, (before, now) in found["jobs"].items()
        for case in sorted({*before["solved"]} - {*now["solved"]})
    ]


def main() -> None:
    """Measure in turns and write the record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    # `choices` has the empty list, which argparse looks for in them if no job is named.
    parser.add_argument("jobs", nargs="*", choices=[*JOBS, []], default=[])
    parser.add_argument("--before", default="a2c643bc", help="commit to compare with")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RECORD)
    given = parser.parse_args()
    packages = [built(given.before, ROOT / "out" / "before"), ROOT]
    found: dict[str, Any] = {"before": given.before, "jobs": {}}
    if given.jobs:
        found = json.loads(given.out.read_text(encoding="utf-8"))
    with Progress(console=Console(stderr=True), transient=True) as progress:
        for job in progress.track(given.jobs or JOBS, description="beside an earlier version"):
            found["jobs"][job] = turns(job, packages, given.rounds)
    given.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    for line in table(found):
        print("  ".join(line))


if __name__ == "__main__":
    main()
