"""The paper's printed numbers and claims beside ours, each with a verdict.

Is there any travel and time at which the paper's singularity avoidance works on its example?
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planner.methods.laws.legs import Leg, Point, steer
from planner.paper.cases import POINT, TRAVEL, Cases, paper_problem
from planner.plan.measures import worst_margin
from planner.plan.trajectory import ChainedTrajectory, polynomial_roots
from planner.problem.feasibility import travel_window
from planner.problem.nonholonomy import paper_recursion
from planner.support.one_variable import sample_times
from planner.systems.chained_form import chained_form
from planner.systems.controllability import controllability
from planner.systems.manipulator import Manipulator

Verdict = Literal["agrees", "misprint", "does not hold", "calibrated", "not printed"]


@dataclass(frozen=True)
class Finding:
    """One printed number or claim.

    Attributes:
        where: Place in the paper.
        printed: What it says.
        ours: What we find.
        verdict: In a word.
    """

    where: str
    printed: str
    ours: str
    verdict: Verdict


def findings(cases: Cases) -> list[Finding]:
    """All of them, in the order of the paper."""
    return [*_controllability(), *_boundary(), *_law(cases), *_domain(cases), *_machine(cases)]


def _angles(*degrees: float) -> np.ndarray:
    return np.array([0.0, *np.deg2rad(degrees)])


def _controllability() -> list[Finding]:
    system = paper_problem().system
    assert isinstance(system, Manipulator)
    regular = controllability(system, _angles(20, 20, 20))
    singular = controllability(system, _angles(0, 20, 20))
    recursion = paper_recursion(system, _angles(20, 20, 20)).printed
    return [
        Finding(
            "(12)-(15)",
            "X_2 = d/dtheta_2 and Y_2 = (0, y_2) follow from the recursion",
            f"at 20 deg the printed X_2 is off by {recursion.x_error[0]:.3g}: the recursion belongs"
            " to a sine law",
            "does not hold",
        ),
        Finding(
            "(17)",
            "det vanishes nowhere",
            f"growth vector {regular.growth} at 20 deg, {singular.growth} at theta1 = 0: the"
            " machine is controllable at both, by longer brackets at the second",
            "does not hold",
        ),
    ]


def _boundary() -> list[Finding]:
    problem = paper_problem()
    form = chained_form(problem.system)
    start = form.z(problem.start)[1:]
    goal = form.z(np.nan_to_num(problem.goal))[1:]
    return [
        Finding(
            "4.3, z(0)", "(-0.0324, 0.7113, 0.0175)", f"{_triple(start)}; fixes K2 and K3", "agrees"
        ),
        Finding("4.3, z2(T)", "-0.532", f"{goal[0]:.4f}: a digit is lost", "misprint"),
        Finding("4.3, z3(T), z4(T)", "0.4622, 0.5236", f"{goal[1]:.4f}, {goal[2]:.4f}", "agrees"),
    ]


def _law(cases: Cases) -> list[Finding]:
    window = travel_window(paper_problem())
    assert window is not None
    low, high = cases.valid.notes["travel_ranges_in_domain"][0]
    return [
        Finding(
            "4.3, travel of phi2",
            "not given",
            f"one-way motions exist for {window.low:.5f} to {window.high:.5f} rad only; the plain"
            f" cubic stays in the domain for {low:.4f} to {high:.4f}",
            "not printed",
        ),
        Finding(
            "4.2, after (28)",
            "two constraint points make v2 quartic",
            "3 boundary values + 2 points = 5 coefficients",
            "agrees",
        ),
        Finding(
            "4.2, step 3",
            "z3(t) = z3(0) + z2(0) t + ...",
            "each integration brings a factor b0 that is not printed; (27) has it",
            "misprint",
        ),
    ]


def _domain(cases: Cases) -> list[Finding]:
    crossings = " and ".join(f"{t:.3f}" for t in cases.free.domain.z2_crossings_s)
    exits, needed = _times(cases.point.domain.exits_s), 1 - cases.point.domain.margin
    found = scan()
    return [
        Finding(
            "Fig. 4",
            "z2 crosses zero twice without a constraint point",
            f"at {crossings} s (travel {TRAVEL:.4f} rad, T = 10 s)",
            "agrees",
        ),
        Finding(
            "Fig. 5",
            f"with the point ({POINT[0]:g}, {POINT[1]:g}) z2 stays negative",
            f"largest z2 {cases.point.domain.z2_max:.4f}",
            "agrees",
        ),
        Finding(
            "Fig. 5",
            "and so avoids the singularities",
            f"from {exits} s there is no real theta1: cos^2(theta1) would have to reach"
            f" {needed:.2f}",
            "does not hold",
        ),
        Finding(
            "4.2, step 5",
            "constraint points lead around singularities",
            f"of {found.tried} pairs of travel and time at which the cubic crosses zero, the value"
            f" {POINT[1]:g} keeps z2 < 0 in {found.sign_kept} and the path inside the domain in"
            f" {found.inside}",
            "does not hold",
        ),
    ]


def _machine(cases: Cases) -> list[Finding]:
    error = np.median(cases.replay.largest_error_deg, axis=0)
    return [
        Finding(
            "Fig. 9",
            "5 deg error of theta3",
            f"median {error[2]:.1f} deg on our emulated prototype, which was calibrated to it"
            " (planner calibrate)",
            "calibrated",
        )
    ]


def _triple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:.4f}" for v in values) + ")"


def _times(values: tuple[float, ...]) -> str:
    return " to ".join(f"{v:.3f}" for v in values) if len(values) == 2 else str(values)


@dataclass(frozen=True)
class Scan:
    """What the scan over travels and point times finds.

    Attributes:
        tried: Pairs (travel, time) at which the free cubic crosses z₂ = 0.
        sign_kept: Those at which the point keeps z₂ < 0.
        inside: Those at which the path then lies inside the full domain.
    """

    tried: int
    sign_kept: int
    inside: int


def scan(travels: int = 61, times: int = 37) -> Scan:
    """Try the point's value at many times, over travels from 0.7 to 1.0 rad."""
    tried = kept = inside = 0
    for travel in np.linspace(0.70, 1.00, travels):
        if not polynomial_roots(_curve(float(travel), []).z_curve, 1):
            continue
        for time in np.linspace(0.5, 9.5, times):
            curve = _curve(float(travel), [Point(float(time), POINT[1])])
            tried += 1
            if polynomial_roots(curve.z_curve, 1):
                continue
            kept += 1
            margins = curve.margins(sample_times(curve.breaks, 200))
            inside += bool(np.all(worst_margin(margins) > 0))
    return Scan(tried, kept, inside)


def _curve(travel: float, points: list[Point]) -> ChainedTrajectory:
    problem = paper_problem(travel=travel)
    goal = problem.goal.copy()
    goal[0] = travel
    form = chained_form(problem.system)
    legs = [Leg(10.0, travel, 3 + len(points))]
    motion = steer(form.z(problem.start), form.z(goal), legs, points)
    return ChainedTrajectory(problem.system, motion.z, motion.v, problem.branch)
