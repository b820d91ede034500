"""One comparison of the paper's example that several tests look at."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import planner

ROOT = Path(__file__).parents[1]
SAMPLES = 9
CHANGES = {"limits.input_rad_s": [0.6, 0.6], "machine.step_s": 0.01}


@cache
def paper_comparison() -> planner.Comparison:
    """The paper's law, at an ordinary travel and its best, and collocation; few samples."""
    problem = planner.load_problem(ROOT / "problems/paper.toml", {"machine.step_s": 0.01})
    specs = ["polynomial:travel=middle", "polynomial", "collocation"]
    return planner.compare(problem, specs, samples=SAMPLES, seed=3)


@cache
def outside() -> planner.Plan:
    """The printed example of the paper's Fig. 5: z₂ < 0, and yet no real θ₁ between 6 and 9 s."""
    problem = planner.load_problem(ROOT / "problems/paper-fig5.toml")
    return planner.solve(problem, "polynomial", allow_singular=True)


@cache
def quick_comparison() -> planner.Comparison:
    """Two polynomials of the paper's example, one refused, and one that has no path at all."""
    problem = planner.load_problem(ROOT / "problems/paper.toml", CHANGES)
    specs = ["polynomial:travel=middle", "polynomial", "polynomial:points=[[5.0, 0.5]]"]
    return planner.compare(problem, specs, samples=5, seed=1)


@cache
def refused_comparison() -> planner.Comparison:
    """Two methods in too short a time: no plan, but the motion that takes the time it needs."""
    changes = {"goal.duration": 2.0, "machine.step_s": 0.01}
    problem = planner.load_problem(ROOT / "problems/paper.toml", changes)
    return planner.compare(problem, ["polynomial", "collocation"], samples=3, seed=1)


@cache
def leaving_comparison() -> planner.Comparison:
    """Parking by collocation, whose path leaves the chart and may."""
    problem = planner.load_problem(ROOT / "problems/parking.toml", {"machine.step_s": 0.01})
    spec = "collocation:starts=1:attempts=2"
    return planner.compare(problem, ["polynomial", spec], samples=3, seed=1)
