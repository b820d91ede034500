"""What each method can reach: random starts and goals, every method, one table and one picture.

    python tests/benchmarks/coverage.py [--pairs 100] [--pairs4 40]     # writes results/coverage

Runs on the sweep engine. A database under out/ keeps finished cases: the same command of the same
code goes on where it was ended, and more pairs add to those that are there.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from results_pages import cache_path
from rich.progress import Progress
from stress_problems import INPUT, WIDE, arm

from planner import run_sweep
from planner.report.figures.style import colours
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table
from planner.sweep.results import read

ROOT = Path(__file__).parents[2]
SEED = 7
SECONDS = {3: 30.0, 4: 120.0}
"""Duration given. Four joints need about four times as long for angles of any sign."""

METHODS = {
    "polynomial, travel in the middle": "polynomial:travel=middle",
    "polynomial, points": "polynomial:points=auto",
    "sinusoid": "sinusoid",
    "convex": "convex",
    "collocation": "collocation",
}


@dataclass(frozen=True)
class Family:
    """Where starts and goals are drawn from, degrees: every joint alike, independently."""

    name: str
    start: tuple[float, float]
    goal: tuple[float, float]


FAMILIES = (
    Family("start 5 to 15, goal 20 to 45", (5.0, 15.0), (20.0, 45.0)),
    Family("start and goal 5 to 60", (5.0, 60.0), (5.0, 60.0)),
    Family("start and goal -60 to 60", (-60.0, 60.0), (-60.0, 60.0)),
)
Record = dict[str, Any]


def pairs(family: int, joints: int, count: int) -> list[dict[str, Any]]:
    """The first pairs of a family: the same ones, however many are asked for."""
    rng = np.random.default_rng([SEED, family, joints])
    out = []
    for _ in range(count):
        ends = [rng.uniform(*FAMILIES[family].start, joints)]
        ends.append(rng.uniform(*FAMILIES[family].goal, joints))
        start, goal = (np.round(end, 2).tolist() for end in ends)
        out.append({"start.theta_deg": start, "goal.theta_deg": goal})
    return out


def sweep(family: int, joints: int, count: int) -> dict[str, Any]:
    """The sweep of one family."""
    rest = [10.0] * joints
    problem = arm("manipulator", joints, rest, rest, WIDE)
    problem["goal"]["duration"] = SECONDS[joints]
    return {
        "title": f"{joints} joints, {FAMILIES[family].name} degrees",
        "problem": problem,
        "methods": [*METHODS.values()],
        "cases": pairs(family, joints, count),
    }


def results(joints: int, count: int, db: Path, workers: int) -> list[list[Record]]:
    """The cases of each family, run as far as they were not."""
    out = []
    for family in range(len(FAMILIES)):
        tables = sweep(family, joints, count)
        with Progress() as bar:
            line = bar.add_task(tables["title"], total=1.0)

            def told(_: str, share: float, bar: Any = bar, line: Any = line) -> None:
                bar.update(line, completed=share)

            run = run_sweep(tables, db, workers=workers, progress=told)
        out.append(read(db, run.sweep)[1])
    return out


def of_method(records: list[Record], label: str) -> list[Record]:
    """Its cases, in the order of the pairs."""
    return [record for record in records if record["method"] == label]


def rows(joints: int, families: list[list[Record]]) -> list[Record]:
    """One line a family and method."""
    out = []
    for family, records in zip(FAMILIES, families, strict=True):
        best = of_method(records, METHODS["collocation"])
        for name, label in METHODS.items():
            own = of_method(records, label)
            both = [
                (a["effort"] / b["effort"], a["case_time_s"])
                for a, b in zip(own, best, strict=True)
                if a["solved"] and b["solved"]
            ]
            refused = [record["case_time_s"] for record in own if not record["solved"]]
            ratio, seconds = np.median(both, axis=0) if both else (np.nan, np.nan)
            out.append(
                {
                    "joints": joints,
                    "family": family.name,
                    "method": name,
                    "solved": sum(record["solved"] for record in own),
                    "pairs": len(own),
                    "effort": ratio,
                    "seconds": seconds,
                    "refused": np.median(refused or [np.nan]),
                }
            )
    return out


COLUMNS: list[Column[Record]] = [
    Column("joints", "", lambda row: row["joints"]),
    Column("angles", "deg", lambda row: row["family"], left=True),
    Column("method", "", lambda row: row["method"], left=True),
    Column("solved", "", lambda row: f"{row['solved']} of {row['pairs']}"),
    Column("effort beside collocation's, median", "", lambda row: row["effort"]),
    Column("time to plan, median", "s", lambda row: row["seconds"]),
    Column("time to a refusal, median", "s", lambda row: row["refused"]),
]


def picture(found: list[Record]) -> Figure:
    """Share of the pairs that each method solves, a panel a family and number of joints."""
    colour = colours(list(METHODS.values()))
    counts = sorted({row["joints"] for row in found})
    figure = Figure(figsize=(10, 1.0 + 2.1 * len(counts)), layout="constrained")
    axes = figure.subplots(len(counts), len(FAMILIES), sharex=True, sharey=True, squeeze=False)
    for i, joints in enumerate(counts):
        for j, family in enumerate(FAMILIES):
            ax = axes[i][j]
            own = [r for r in found if r["joints"] == joints and r["family"] == family.name]
            for k, row in enumerate(own):
                label = METHODS[row["method"]]
                share = 100 * row["solved"] / row["pairs"]
                ax.barh(k, share, color=colour[label], height=0.7)
                ax.text(share + 2, k, f"{row['solved']} of {row['pairs']}", va="center", fontsize=8)
            ax.set_yticks(range(len(own)), [row["method"] for row in own])
            ax.set_ylim(len(own) - 0.4, -0.6)
            ax.set_xlim(0, 128)
            ax.set_xticks([0, 50, 100])
            ax.spines[["top", "right"]].set_visible(False)
            if i == 0:
                ax.set_title(f"{family.name} degrees", fontsize=9)
            if j == 0:
                ax.set_ylabel(f"{joints} joints, {SECONDS[joints]:g} s")
            if i == len(counts) - 1:
                ax.set_xlabel("solved, % of the pairs")
    figure.suptitle("Which goals each method reaches: random pairs of joint angles")
    return figure


def main() -> int:
    """Run what is missing, and write the table and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=100, help="a family, three joints")
    parser.add_argument("--pairs4", type=int, default=40, help="a family, four joints")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "coverage")
    given = parser.parse_args()
    db = cache_path("coverage", ".sqlite")
    found: list[Record] = []
    for joints, count in ((3, given.pairs), (4, given.pairs4)):
        if count:
            found += rows(joints, results(joints, count, db, given.workers))
    given.out.mkdir(parents=True, exist_ok=True)
    picture(found).savefig(given.out / "coverage.png", dpi=130)
    command = provenance(shlex.join(["python", "tests/benchmarks/coverage.py", *sys.argv[1:]]))
    best = [row for row in found if row["method"] == "collocation"]
    page = HEAD.format(
        command=command,
        table=markdown_table(COLUMNS, found),
        refused=sum(row["pairs"] - row["solved"] for row in best),
    )
    (given.out / "README.md").write_text(page, encoding="utf-8")
    return 0


HEAD = f"""# Which goals each method reaches

Random pairs of start and goal, every joint uniform in the given range; inputs up to
{INPUT:g} rad/s, joints within {WIDE:g} degrees, {SECONDS[3]:g} s for three joints and
{SECONDS[4]:g} s for four, travel free. The arm has the prototype's proportions. "Solved" are plans
that are verified. "Travel in the middle" is the
textbook's choice; the method's default searches for the travel. Effort is relative to that of
collocation, if both have a plan. Times are
from a busy computer and hold the verification: compare them only with each other. Collocation
refuses {{refused}} pairs, and says of each which duration it needs.

{{command}}

![Share of the pairs that each method solves](coverage.png)

{{table}}
"""


if __name__ == "__main__":
    sys.exit(main())
