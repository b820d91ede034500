"""A map of goals: which of them each method reaches from one start, and at what effort.

    python tests/benchmarks/goal_map.py                                # writes results/map
    python tests/benchmarks/goal_map.py my.toml --side 7 --out out/map

The goals differ in the last two joints; all else is the problem's. Runs on the sweep engine: a
database under out/ keeps finished cases, and the same command of the same code goes on where it was
ended.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from results_pages import cache_path
from rich.progress import Progress

import planner
from planner import Problem, run_sweep
from planner.problem.feasibility import travel_window
from planner.report.figures.style import LIMIT_COLOUR, OUTSIDE_COLOUR
from planner.support.files import toml
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table
from planner.sweep.results import read

ROOT = Path(__file__).parents[2]
METHODS = {
    "polynomial": "polynomial",
    "polynomial with points": "polynomial:points=auto",
    "sinusoid": "sinusoid",
    "convex": "convex",
    "collocation": "collocation",
}
OPEN = "time_limit"
"""Status of a case whose time is up: neither reached nor shown to be out of reach."""
FINE = 141  # goals a side, for the edge of the travel window
Record = dict[str, Any]


def goals(problem: Problem, angles: np.ndarray) -> list[list[float]]:
    """Goals with all pairs of these angles in the last two joints, degrees."""
    first = np.rad2deg(problem.goal[1:-2]).round(9).tolist()
    return [[*first, float(a), float(b)] for b in angles for a in angles]


def results(tables: dict[str, Any], db: Path, workers: int) -> list[Record]:
    """The cases, run as far as they were not."""
    with Progress() as bar:
        line = bar.add_task(tables["title"], total=1.0)
        told = lambda _, share: bar.update(line, completed=share)  # noqa: E731
        run = run_sweep(tables, db, workers=workers, progress=told)
    return read(db, run.sweep)[1]


def has_window(problem: Problem, angles: np.ndarray) -> np.ndarray:
    """Whether a motion without reversal is possible to each goal, as rows over the last joint."""
    found = []
    for goal in goals(problem, angles):
        window = travel_window(problem.changed({"goal.theta_deg": goal}))
        found.append(window is not None and bool(window.high > window.low))
    return np.array(found).reshape(len(angles), -1)


def rows(records: list[Record]) -> list[Record]:
    """One line a method."""
    efforts = {
        label: {
            tuple(r["goal.theta_deg"]): r["effort"]
            for r in records
            if r["method"] == label and r["solved"]
        }
        for label in METHODS.values()
    }
    best, found = efforts["collocation"], []
    for name, label in METHODS.items():
        own = [r for r in records if r["method"] == label]
        refused = [r for r in own if not r["solved"]]
        ratios = [x / best[goal] for goal, x in efforts[label].items() if goal in best]
        found.append(
            {
                "method": name,
                "reached": len(efforts[label]),
                "of": len(own),
                "open": sum(r["status"] == OPEN for r in refused),
                "alone": len(efforts[label].keys() - best.keys()),
                "effort": np.median(ratios or [np.nan]),
                "least": np.min(ratios or [np.nan]),
                "s": sum(r["case_time_s"] for r in own),
                "refused_s": sum(r["case_time_s"] for r in refused),
            }
        )
    return found


COLUMNS: list[Column[Record]] = [
    Column("method", "", lambda row: row["method"], left=True),
    Column("reached", "", lambda row: f"{row['reached']} of {row['of']}"),
    Column("open (time limit)", "", lambda row: row["open"]),
    Column("reached by it and not by collocation", "", lambda row: row["alone"]),
    Column("effort beside collocation's, median", "", lambda row: row["effort"]),
    Column("least", "", lambda row: row["least"]),
    Column("time", "s", lambda row: row["s"]),
    Column("of it in refusals", "s", lambda row: row["refused_s"]),
]


def picture(problem: Problem, records: list[Record], window: np.ndarray, span: float) -> Figure:
    """One panel a method: reached goals coloured by effort, and the edge of the window."""
    drawn = Figure(figsize=(9, 6.2), layout="constrained")
    axes = drawn.subplots(2, 3, sharex=True, sharey=True).ravel()
    solved = [r["effort"] for r in records if r["solved"]]
    norm = LogNorm(min(solved), max(solved))
    cell = 2 * span / (len({r["goal.theta_deg"][-1] for r in records}) - 1)
    fine = np.linspace(-span, span, len(window))
    tick = max(10 * int(0.9 * span / 10), 1)
    for ax, (name, label) in zip(axes, METHODS.items(), strict=False):
        own = [r for r in records if r["method"] == label]
        side = round(np.sqrt(len(own)))
        grid = np.full((side, side), np.nan)
        for r in own:
            i, j = (round((x + span) / cell) for x in r["goal.theta_deg"][-2:])
            grid[j, i] = r["effort"] if r["solved"] else np.nan
            if r["status"] == OPEN:
                ax.plot(*r["goal.theta_deg"][-2:], "x", color=LIMIT_COLOUR, ms=3)
        edge = span + cell / 2
        ax.set_facecolor(OUTSIDE_COLOUR)
        image = ax.imshow(
            grid, origin="lower", extent=(-edge, edge, -edge, edge), cmap="viridis_r", norm=norm
        )
        ax.contourf(fine, fine, window, levels=[0.5, 1.5], colors="none", hatches=["//"])
        ax.plot(*np.rad2deg(problem.start[-2:]), "o", color="black", ms=5, mfc="white")
        ax.set_title(f"{name}: {np.isfinite(grid).sum()} of {len(own)} goals", fontsize=10)
        ticks = [-tick, 0, tick]
        ax.set(xticks=ticks, yticks=ticks)
    names = [c.name for c in problem.system.coordinates[-2:]]
    for ax in axes[[2, 3, 4]]:
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(f"goal of {names[0]} (deg)")
    for ax in axes[[0, 3]]:
        ax.set_ylabel(f"goal of {names[1]} (deg)")
    legend = axes[5]
    legend.set_axis_off()
    drawn.colorbar(image, cax=legend.inset_axes([0.1, 0, 0.07, 1]), label="effort (rad²/s)")
    style = {"ls": "", "mec": "black", "mfc": "white"}
    marks: list[Any] = [
        legend.plot([], [], marker="o", **style, label="start")[0],
        Patch(fill=False, hatch="////", lw=0, label="no reversal\nneeded"),
        legend.plot([], [], "s", color=OUTSIDE_COLOUR, mec="grey", label="refused")[0],
        legend.plot([], [], "x", color=LIMIT_COLOUR, ms=4, label="open: time limit")[0],
    ]
    legend.legend(handles=marks, loc="center right", frameon=False, fontsize=9)
    return drawn


def conditions(problem: Problem) -> str:
    """Start, time, limits and the joints that all goals share."""
    kept = ", ".join(f"{key} = {toml(value)}" for key, value in problem.to_dict()["limits"].items())
    travel = "free" if problem.travel is None else problem.travel
    first = np.rad2deg(problem.goal[1:-2]).round(3).tolist()
    return (
        f"start {np.rad2deg(problem.start[1:]).round(3).tolist()} degrees, duration (s)"
        f" {problem.duration or 'free'}, travel {travel}, limits:"
        f" {kept or 'none'}; joints before the last two end at {first} degrees"
    )


def main() -> int:
    """Run what is missing, and write the table and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem", nargs="?", help="default: the paper's arm from (10, 10, 10)")
    parser.add_argument("--side", type=int, default=15, help="goals a side of the map")
    parser.add_argument("--span", type=float, default=70.0, help="largest angle of a goal, deg")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="folder; needed with a problem")
    given = parser.parse_args()
    if given.out is None:
        if given.problem is not None:
            parser.error("a problem of your own needs --out FOLDER")
        given.out = ROOT / "results" / "map"
    changes: dict[str, Any] = {}
    if given.problem is None:
        changes = {
            "start.theta_deg": [10, 10, 10],
            "goal.duration": 20.0,
            "limits.z2_margin": None,
        }
    path = Path(given.problem or ROOT / "problems" / "paper.toml").resolve()
    problem = planner.load_problem(path, changes)
    angles = np.linspace(-given.span, given.span, given.side)
    tables = {
        "title": f"goals of {problem.name}",
        "problem": problem.to_dict(),
        "methods": [*METHODS.values()],
        "grid": {"goal.theta_deg": goals(problem, angles)},
    }
    db = cache_path("map", ".sqlite")
    records = results(tables, db, given.workers)
    window = has_window(problem, np.linspace(-given.span, given.span, FINE))
    given.out.mkdir(parents=True, exist_ok=True)
    picture(problem, records, window, given.span).savefig(given.out / "map.png", dpi=120)
    page = (
        (ROOT / "tests/benchmarks/goal_map.md")
        .read_text(encoding="utf-8")
        .format(
            command=provenance(
                shlex.join(["python", "tests/benchmarks/goal_map.py", *sys.argv[1:]])
            ),
            table=markdown_table(COLUMNS, rows(records)),
            name=problem.name,
            conditions=conditions(problem),
            count=given.side**2,
            span=given.span,
        )
    )
    (given.out / "README.md").write_text(page, encoding="utf-8")
    print(f"wrote {given.out / 'README.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
