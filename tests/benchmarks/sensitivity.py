"""Benefit of plans that are less sensitive to errors: to first order, and on the emulated machine.

python tests/benchmarks/sensitivity.py [--samples 1000]      # writes results/sensitivity
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import planner
from planner import NoPlanError, Plan, Problem
from planner.cli.app import main as command
from planner.plan.measures import effort, turns
from planner.report import plot_sensitivity
from planner.report.result_folder import folder, refuse_unwritable_folder
from planner.support.arrays import Array
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
SEED = 2026
"""No constant was chosen with this seed."""

POINTS, MACHINES = 12, 200
"""Of the trade-off curve; see `planner.trade_off` for why so few machines suffice."""

LIMIT = "limits.input_rad_s=[0.6, 0.6]"
WAYS: dict[str, tuple[str, dict[str, Any]]] = {
    "least effort (collocation)": ("collocation", {}),
    "desensitised": ("desensitised", {}),
    "desensitised, `reversal = true`": ("desensitised", {"reversal": True}),
}
OTHERS = ("crossing", "parking", "four-joint", "paper-fig4")


@dataclass(frozen=True)
class Found:
    """A plan, and its errors on the machines without and with compensation.

    Attributes:
        plan: The plan.
        plain: Index E and error at the end, degrees, (2, S).
        compensated: The same of the compensated plan; None where there is none.
    """

    plan: Plan
    plain: Array
    compensated: Array | None

    def cells(self) -> list[str]:
        """Turns of the drive, sums of the response, errors without and with compensation."""
        found = planner.sensitivity(self.plan)
        sums = found.passive_block_deg(), found.total_deg(), found.floor_deg()
        out = [str(len(turns(self.plan.trajectory))), *(f"{value:.3f}" for value in sums)]
        for k in range(2):
            out += [pair(self.plain[k])]
            out += ["none" if self.compensated is None else pair(self.compensated[k])]
        return out


HEAD = ["turns", "passive block", "total", "floor"]
HEAD += ["E", "E compensated", "end", "end compensated"]


def replayed(plan: Plan, samples: int) -> Array:
    """Index E and error at the end on the problem's machines, degrees, (2, S)."""
    run = planner.replay(plan, samples=samples, seed=SEED, record_s=None)
    return np.stack([run.index_E_deg, run.terminal_E_deg])


def tried(problem: Problem, way: str, samples: int) -> Found:
    """A plan by one of the `WAYS`, replayed on the machines."""
    method, options = WAYS[way]
    plan = planner.solve(problem, method, **options)
    try:
        better = replayed(planner.compensate(plan), samples)
    except NoPlanError:
        better = None
    return Found(plan, replayed(plan, samples), better)


def pair(values: Array) -> str:
    """Median and 95th percentile."""
    middle, high = np.percentile(values, [50, 95])
    return f"{middle:.2f} / {high:.2f}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def loaded(name: str) -> Problem:
    """A problem of problems/."""
    return planner.load_problem(ROOT / f"problems/{name}.toml")


METHODS = "polynomial,polynomial:points=auto,sinusoid,collocation,desensitised"


def side_by_side(out: Path) -> str:
    """The methods' plans by the command: its picture to `out`, its table and sentence returned."""
    with tempfile.TemporaryDirectory() as place:
        words = ["sensitivity", str(ROOT / "problems/paper.toml"), "--set", LIMIT]
        if command([*words, "--methods", METHODS, "--out", place]):
            raise SystemExit("the plans side by side failed")
        (out / "methods.png").write_bytes((Path(place) / "sensitivities.png").read_bytes())
        return (Path(place) / "sensitivities.md").read_text(encoding="utf-8").strip()


def curve(out: Path) -> None:
    """The trade-off curve by the command, its picture and table to `out`."""
    with tempfile.TemporaryDirectory() as place:
        words = ["sensitivity", str(ROOT / "problems/paper.toml"), "--set", LIMIT]
        words += ["--pareto", "effort", "--points", str(POINTS), "-n", str(MACHINES)]
        if command([*words, "--out", place]):
            raise SystemExit("the trade-off curve failed")
        for name in ("trade-off.png", "trade-off.csv"):
            (out / name).write_bytes((Path(place) / name).read_bytes())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--out", type=Path, default=ROOT / "results/sensitivity")
    options = parser.parse_args(arguments)
    refuse_unwritable_folder(options.out)  # before minutes of work
    paper = loaded("paper").changed({"limits.input_rad_s": [0.6, 0.6]})
    found = {way: tried(paper, way, options.samples) for way in WAYS}
    others = []
    for name in OTHERS:
        for way in WAYS:
            try:
                cells = tried(loaded(name), way, options.samples).cells()
            except NoPlanError as error:
                cells = [error.status, *[""] * (len(HEAD) - 1)]
            others.append([f"{name}, {way}", *cells])
    text = (ROOT / "tests/benchmarks/sensitivity.md").read_text(encoding="utf-8")
    efforts = [effort(each.plan.trajectory) for each in found.values()]
    with folder(options.out) as out:
        for name, way in zip(("least-effort", "desensitised"), WAYS, strict=False):
            figure, _ = plot_sensitivity(planner.sensitivity(found[way].plan))
            figure.savefig(out / f"{name}.png", dpi=110)
        curve(out)
        text = text.format(
            samples=options.samples,
            seed=SEED,
            points=POINTS,
            machines=MACHINES,
            set=LIMIT,
            methods=METHODS,
            provenance=provenance("make sensitivity"),
            side_by_side=side_by_side(out),
            plans=table(
                ["plan", "effort", *HEAD],
                [
                    [way, f"{spent:.2f}", *each.cells()]
                    for (way, each), spent in zip(found.items(), efforts, strict=True)
                ],
            ),
            others=table(["problem, plan", *HEAD], others),
        )
        (out / "README.md").write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
