"""The page, picture and numbers of the benchmarks."""

from __future__ import annotations

import io
import json
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import beside
import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import peers_theirs
from bench_cases import PROBLEMS, cases
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from planner.support.files import write_bytes, write_text
from planner.support.package import provenance

FRESH = """
import time
began = time.perf_counter()
import planner
imported = time.perf_counter()
plan = planner.solve(planner.load_problem({path!r}), "collocation")
assert plan.verified
print(imported - began, time.perf_counter() - began, time.process_time())
"""
PLAIN = FormatStrFormatter("%g")
HEAD = """# Speed

{provenance}

on {machine}.
While it ran the computer had other work: load {load} on {cores} cores. Times are
the process's own processor time; still, read ratios, which are medians over rounds in which all
contestants took turns.

{beside}
## Beside scripts and frameworks

Times are of one solve from scratch: the solver's call for the scripts (tests/benchmarks/rivals.py)
and the frameworks (tests/benchmarks/frameworks.py), from problem to plan for `planner`, its check
between nodes included; "whole way" adds its independent verification and the proof. All use a
tolerance of 1e-9, and but for mpopt the straight line that `planner` starts from
(`start = "straight"`). The others use 40 intervals and constant inputs (Drake
linear ones, mpopt inputs of degree 3; Drake does not tell its iterations); `planner` chooses its
mesh (14 intervals, for six joints 20; linear inputs). "warm" is a
neighbouring problem from the plan at hand. "Build" is what happens once before: writing the
problem down, for `planner` only what is not kept from the problem before.

The error and the excess over limits, relative to these, are those of the motion which the inputs
really make, integrated by SciPy and looked at between the nodes too. A motion passes that misses
the goal by no more than 2e-5 rad and a limit by no more than 1e-6.
{left_out}"""


def fresh_process() -> dict[str, float]:
    """From import to a verified plan of the paper's problem in a process of its own, best of 5."""
    code = FRESH.format(path=str(PROBLEMS / "paper.toml"))
    runs, walls = [], []
    for _ in range(5):
        began = time.perf_counter()
        said = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        walls.append(time.perf_counter() - began)
        runs.append([float(word) for word in said.stdout.split()])
    best = min(runs, key=lambda run: run[1])
    return {"verified_s": best[1], "cpu_s": min(run[2] for run in runs), "process_s": min(walls)}


def machine() -> str:
    """Processor, cores and versions; nothing that names the computer."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":")[1].strip() if lines else model
    versions = ", ".join(f"{name} {version(name)}" for name in ("casadi", "numpy", "scipy", "osqp"))
    system = f"{platform.system()} {platform.machine()}"
    return (
        f"{model}, {os.cpu_count()} cores, {system}, Python {platform.python_version()}, {versions}"
    )


def write(out: Path, found: dict[str, Any]) -> None:
    """Write README.md, speed.png and numbers.json."""
    found = {"machine": machine(), "load": round(os.getloadavg()[1], 1), **found}
    picture = io.BytesIO()
    _picture(found, picture)
    write_text(out / "numbers.json", json.dumps(found, indent=1) + "\n")
    write_text(out / "README.md", _page(found))
    write_bytes(out / "speed.png", picture.getvalue())


def _page(found: dict[str, Any]) -> str:
    out = ", ".join(found["left_out"])
    head = HEAD.format(
        provenance=provenance("make bench"),
        machine=found["machine"],
        load=found["load"],
        cores=os.cpu_count(),
        beside=_beside(json.loads(beside.RECORD.read_text(encoding="utf-8"))),
        left_out=f"\nLeft out, for they were not installed: {out}.\n" if out else "",
    )
    parts = [head, "![times of all contestants and growth with the size](speed.png)\n"]
    for case in cases():
        parts.append(f"### {case.what[0].upper()}{case.what[1:]} ({case.name})\n")
        parts.append(_table(found["contests"][case.name]))
    parts.append(_targets(found))
    return "\n".join(parts)


def _beside(found: dict[str, Any]) -> str:
    """All places where people wait, beside an earlier version."""
    head = ["job", f"{found['before']}, CPU s", "now, CPU s", "ratio", "aim for the ratio"]
    lines = [head, ["---", *["---:"] * 3, "---"], *beside.table(found)]
    rows = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    lost = ", ".join(beside.lost(found))
    solved = f"Cases that only {found['before']} solves: {lost}" if lost else LOST_NONE
    return BESIDE.format(rows=rows, solved=solved, before=found["before"])


LOST_NONE = "No case that the earlier version solves is refused now"
BESIDE = """
## Beside an earlier version

Commit {before} and this one in turns, each job in a process of its own; the least of two rounds,
but one round for the jobs of minutes (tests/benchmarks/jobs.py). {solved}.

{rows}
"""


def _table(rows: dict[str, dict[str, Any]]) -> str:
    head = ["", "least ms", "median ms", "iterations", "objective"]
    head += ["error at goal, rad", "over limits", "passes", "build s"]
    lines = [head, ["---"] * len(head)]
    for name, row in rows.items():
        lines.append(
            [
                name,
                f"{1e3 * row['least_s']:.1f}",
                f"{1e3 * row['median_s']:.1f}",
                str(row["iterations"]),
                f"{row['objective']:.6f}",
                f"{row['goal_error_rad']:.1e}",
                f"{row['over_limits']:.1e}",
                "yes" if row["passes"] else "no",
                f"{row['build_s']:.2f}",
            ]
        )
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _targets(found: dict[str, Any]) -> str:
    """What was aimed at, and what was found."""
    head = ["", *(case.name for case in cases())]
    rows = [
        ("times faster than plain Radau + IPOPT", 5, "planner", "plain Radau + IPOPT", False),
        ("time over bare Fatrop", 1.3, "planner", "bare Fatrop", True),
        (
            "problem to verified, certified plan over bare Fatrop",
            3,
            "planner, whole way",
            "bare Fatrop",
            True,
        ),
        ("warm over cold", 0.5, "planner, warm", "planner", True),
    ]
    lines = [head, ["---"] * len(head)]
    for label, aim, ours, rival, over in rows:
        cells = []
        for case in cases():
            ratio = (
                found["contests"][case.name].get(ours, {}).get("times_faster_than", {}).get(rival)
            )
            if ratio is None:
                cells.append("not run")
                continue
            reached = 1 / ratio <= aim if over else ratio >= aim
            cells.append(f"{1 / ratio if over else ratio:.2f}" + ", missed" * (not reached))
        lines.append([f"{label} (aim: {aim:g})", *cells])
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    fresh = found["fresh"]
    memory = "; ".join(
        f"{name} {' '.join(map(str, values))}" for name, values in found["memory"].items()
    )
    paths = "; ".join(
        f"{name} {own['seconds']:.2g} s a path, {own['above']:.2f} % above a fine grid"
        for name, own in found["paths"].items()
    )
    if paths:
        count, grid = peers_theirs.PATHS, peers_theirs.GRID
        paths = f"- Fastest timing of {count} random paths with {grid} intervals: {paths}.\n"
    growing = [name for name, seen in found["memory"].items() if seen[-1] > 1.02 * seen[0]]
    grown = f"; {' and '.join(growing)} solves miss it" if growing else ""
    return f"""### Aims

{table}

- From import to a verified plan in a fresh process: {fresh["verified_s"]:.2f} s (aim: 1 s);
  {fresh["cpu_s"]:.2f} s of it on the processor, the start of Python included.
- Resident memory, MiB, after 30, 130, 230 and 330 varied problems: {memory} (aim: flat{grown}).
{paths}- Convex plan {1e3 * found["convex"]:.1f} ms.
- Time an iteration grows with the number of intervals to the power
  {found["intervals"]["exponent"]:.2f} (aim: 1), and from 3 to 8 joints with the number of states
  to the power {found["joints"]["exponent"]:.2f} (aim: less than 2).
"""


def _picture(found: dict[str, Any], path: io.BytesIO) -> None:
    """Above: each problem's times, ours in blue; below: how the time grows with the size."""
    contests = found["contests"]
    names = [*dict.fromkeys(name for rows in contests.values() for name in rows)][::-1]
    figure = plt.figure(figsize=(13, 6.4), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[3, 2])
    above.suptitle("Time to plan each problem (ms of processor time)")
    what = {case.name: case.what for case in cases()}
    for axis, (problem, rows) in zip(
        above.subplots(1, len(contests), sharey=True), contests.items(), strict=True
    ):
        times = [1e3 * rows[name]["least_s"] if name in rows else 0.0 for name in names]
        colours = ["#0072b2" if "planner" in name else "#bbbbbb" for name in names]
        bars = axis.barh(range(len(names)), times, color=colours)
        axis.bar_label(bars, [f"{each:.3g}" if each else "" for each in times], padding=3)
        axis.set_yticks(range(len(names)), names)
        axis.set_title(f"{what[problem]}\n({problem})", fontsize=9)
        axis.margins(x=0.2)
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_xticks([])
    below.suptitle("Time of one iteration (ms)")
    for axis, key, label in zip(
        below.subplots(1, 2), ("intervals", "joints"), ("intervals", "states"), strict=True
    ):
        rows = found[key]["rows"]
        sizes = [int(size) for size in rows]
        axis.loglog(sizes, [1e3 * row["per_iteration_s"] for row in rows.values()], "o-")
        axis.set_xlabel(label)
        axis.set_xticks(sizes, [str(size) for size in sizes])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.yaxis.set_minor_locator(LogLocator(subs=(2, 4, 7)))
        axis.yaxis.set_minor_formatter(PLAIN)
        axis.yaxis.set_major_formatter(PLAIN)
        axis.set_title(f"grows as {label} to the power {found[key]['exponent']:.2f}", fontsize=9)
    figure.savefig(path, dpi=120)
    plt.close(figure)
