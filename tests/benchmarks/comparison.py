"""The comparison of README: every method on the paper's problem, with compensation and feedback.

python tests/benchmarks/comparison.py      # writes results/compare
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import planner
from planner.cli.app import main as command
from planner.comparison.comparison import Comparison

ROOT = Path(__file__).parents[2]
PROBLEM = "problems/paper.toml"
METHODS = (
    "polynomial",
    "polynomial:travel=middle",
    "polynomial:points=auto",
    "sinusoid",
    "collocation",
    "collocation:end=machine",
    "polynomial compensated:points=auto",
    "sinusoid compensated",
    "collocation compensated + feedback",
)
PICTURES = {
    "effort": "Effort against error",
    "errors": "Shares of machines by error",
    "inputs": "Inputs and their limits",
}


def chained(result: Comparison) -> Figure:
    """Chained coordinates of the plans themselves: compensated ones follow the same curves."""
    plans = {
        label: plan
        for label, plan in result.plans.items()
        if plan is not None and not plan.is_compensated
    }
    return planner.report.plot_z(plans)[0]


def page(made: Path, result: Comparison) -> str:
    """The table as the command wrote it, the choice by the end, pictures and differences."""
    by_end = replace(result, by="end").headline_lines[:2]
    pictures = {**PICTURES, "z": "Chained coordinates"}
    words = (Path(__file__).parent / "comparison.md").read_text(encoding="utf-8")
    return words.format(
        table=(made / "table.md").read_text(encoding="utf-8").rstrip(),
        by_end="\n".join(f"> {line}" for line in by_end),
        differences="#" + (made / "differences.md").read_text(encoding="utf-8").rstrip(),
        **{name: f"![{title}]({name}.png)" for name, title in pictures.items()},
    )


def main() -> int:
    """Compare, and write the page beside its pictures."""
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "compare"
        asked = ["--methods", ",".join(METHODS), "--samples", "1000", "--seed", "0"]
        status = command(["compare", PROBLEM, *asked, "--out", str(made)])
        if status:
            return status
        result = planner.load_comparison(made)
        out = ROOT / "results/compare"
        (out / "README.md").write_text(page(made, result), encoding="utf-8")
        for name in PICTURES:
            shutil.copy(made / "figures" / f"{name}.png", out)
        chained(result).savefig(out / "z.png", dpi=120)
    return 0


if __name__ == "__main__":
    sys.exit(main())
