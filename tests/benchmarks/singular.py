"""What the limit on z2 does near the singularity of the chained form.

python tests/benchmarks/singular.py [--samples 1000]      # writes results/singular
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import planner
from planner import NoPlanError, Plan, Problem, Replay
from planner.report.figures.style import COLOURS, LIMIT_COLOUR, OUTSIDE_COLOUR, colour_of, times
from planner.report.result_folder import folder
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table

ROOT = Path(__file__).parents[2]
NAMES = ("z2-singular", "z2-singular-free")
UNLIMITED: Mapping[str, Any] = {"limits.z2_margin": None}
TIGHTER: Mapping[str, Mapping[str, Any]] = {
    "joints up to 80°": {"limits.joint_deg": 80},
    "inputs up to 0.25 rad/s": {"limits.input_rad_s": [0.25, 0.25]},
}


@dataclass(frozen=True)
class Case:
    """A problem planned by one method, on the machines; without a plan, the refusal."""

    problem: Problem
    plan: Plan | None
    """The plan or, of a refusal, what could be computed."""
    refusal: NoPlanError | None
    run: Replay | None = None
    compensated: Replay | None = None

    def row(self, name: str, method: str) -> dict[str, Any]:
        """The table's row."""
        margin = self.problem.limits.z2_margin
        row: dict[str, Any] = {
            "problem": name,
            "method": method,
            "limit": "none" if margin is None else f"z2 ≤ −{margin:g}",
            "solved": "yes" if self.refusal is None else f"no: {self.refusal.status}",
        }
        if self.plan is not None and self.run is not None:
            t = times(self.plan)
            row["z2"] = float(np.min(np.abs(self.plan.trajectory.z(t)[:, 1])))
            row["theta1"] = float(np.rad2deg(np.max(np.abs(self.plan.q(t)[:, 1]))))
            row["effort"] = self.plan.effort
            row["E"] = percentiles(self.run)
            row["slips"] = share(self.run)
            assert self.compensated is not None
            row["compensated"] = percentiles(self.compensated)
        return row


def percentiles(run: Replay) -> str:
    """E of half and of 95 % of the machines, degrees."""
    return f"{run.percentile(50):.2f}, {run.percentile(95):.2f}"


def share(run: Replay) -> str:
    """Share of the machines on which a contact slips grossly."""
    return f"{100 * np.mean(run.slip_s > 0):.0f} %"


def solve(problem: Problem, method: str, samples: int = 0) -> Case:
    """Plan, and replay what is solved."""
    try:
        plan = planner.solve(problem, method)
    except NoPlanError as error:
        return Case(problem, error.plan, error)
    if not samples:
        return Case(problem, plan, None)
    compensated = planner.replay(planner.compensate(plan), samples=samples)
    return Case(problem, plan, None, planner.replay(plan, samples=samples), compensated)


def text(key: str, title: str) -> Column[dict[str, Any]]:
    """A column of text."""
    return Column(title, "", lambda row: row.get(key, ""), left=True)


def figure(key: str, title: str, unit: str, places: int) -> Column[dict[str, Any]]:
    """A column of numbers; refused plans have none."""
    return Column(
        title, unit, lambda row: row.get(key), lambda v: "" if v is None else f"{v:.{places}f}"
    )


COLUMNS = (
    text("problem", "problem"),
    text("method", "method"),
    text("limit", "limit"),
    text("solved", "solved"),
    figure("z2", "least distance of z2 from 0", "", 4),
    figure("theta1", "largest θ1", "deg", 1),
    figure("effort", "effort", "", 3),
    text("E", "E 50 %, 95 % (deg)"),
    text("slips", "slips on"),
    text("compensated", "E compensated (deg)"),
)


def refusals(limited: Problem) -> str:
    """The convex method with tighter limits, without and with the limit on z2."""
    rows = []
    for words, changes in TIGHTER.items():
        without = solve(limited.changed({**changes, **UNLIMITED}), "convex")
        within = solve(limited.changed(changes), "convex")
        rows.append({"more": words, "without": result(without), "with": result(within)})
    columns = (
        text("more", "limit"),
        text("without", "without a limit on z2"),
        text("with", "with z2 ≤ −0.045"),
    )
    return markdown_table(columns, rows)


def result(case: Case) -> str:
    """Effort of a plan, or the cause of its refusal."""
    if case.refusal is not None:
        broken = [str(violation) for violation in case.refusal.violations]
        return f"refused: {', '.join(broken) or case.refusal.sentence}"
    assert case.plan is not None
    return f"planned, effort {case.plan.effort:.3f}"


def picture(cases: Mapping[str, Case], motor: float, margin: float) -> Figure:
    """z2 in its band, and the speed of motor 1 with its limit."""
    drawn = Figure(figsize=(9, 3.9), layout="constrained")
    left, right = drawn.subplots(1, 2)
    colours = (colour_of("polynomial"), COLOURS[1], COLOURS[2])
    for (words, case), colour, width in zip(cases.items(), colours, (2, 2, 3.2), strict=True):
        assert case.plan is not None
        t = times(case.plan, 4000)
        left.plot(t, case.plan.trajectory.z(t)[:, 1], color=colour, lw=width)
        speed = np.abs(case.plan.u(t)[:, 0])
        speed[speed > 3 * motor] = np.nan
        right.plot(t, speed, color=colour, lw=width, label=words)
    low = -7 * margin
    left.set(ylim=(low, 0.04), title="Chained coordinate z2")
    left.axhspan(0, 0.04, color=OUTSIDE_COLOUR, lw=0)
    left.axhline(0, color=LIMIT_COLOUR, lw=1)
    left.axhline(-margin, color=LIMIT_COLOUR, lw=1, ls="--")
    left.text(19.6, 0.036, "no joint angles", ha="right", va="top", fontsize=9)
    left.text(13, -margin, f"limit: z2 ≤ −{margin:.2g}", ha="center", va="bottom", fontsize=9)
    right.set(ylim=(0, 1.5 * motor), title="Speed of motor 1 (rad/s)")
    right.axhline(motor, color=LIMIT_COLOUR, lw=1, ls="--")
    right.text(19.6, motor, "limit of the motor", ha="right", va="bottom", fontsize=9)
    for axis in (left, right):
        axis.set(xlim=(0, 20), xlabel="time (s)")
    drawn.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return drawn


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=ROOT / "results/singular")
    options = parser.parse_args(arguments)
    problems = {name: planner.load_problem(ROOT / f"problems/{name}.toml") for name in NAMES}
    cases = {
        (name, method, limited): solve(
            problem if limited else problem.changed(UNLIMITED), method, options.samples
        )
        for name, problem in problems.items()
        for method in ("polynomial", "convex", "collocation")
        for limited in (False, True)
    }
    first = problems[NAMES[0]]
    free = cases[NAMES[0], "convex", False]
    assert first.limits.z2_margin is not None
    assert free.plan is not None
    assert free.run is not None
    drawn = picture(
        {
            "paper's polynomial: refused": cases[NAMES[0], "polynomial", False],
            f"smoothest curve: slips on {share(free.run)} of the machines": free,
            "smoothest curve, z2 limited: never slips": cases[NAMES[0], "convex", True],
        },
        float(first.limits.input[0]),
        first.limits.z2_margin,
    )
    rows = [case.row(name, method) for (name, method, _), case in cases.items()]
    page = (
        (ROOT / "tests/benchmarks/singular.md")
        .read_text(encoding="utf-8")
        .format(
            samples=options.samples,
            edge=float(np.rad2deg(np.max(np.abs(free.plan.q(times(free.plan))[:, 1])))),
            slips=share(free.run),
            table=markdown_table(COLUMNS, rows),
            refusals=refusals(first),
            provenance=provenance("make singular"),
        )
    )
    with folder(options.out) as out:
        (out / "README.md").write_text(page, encoding="utf-8")
        drawn.savefig(out / "singular.png", dpi=130)
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
