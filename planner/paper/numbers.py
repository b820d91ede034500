"""Comparison of the paper's printed numbers and claims with our results, each with a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from planner.machine.friction.contact_load import contact_load
from planner.machine.friction.contacts import chain_loads
from planner.machine.machine import Machine
from planner.machine.replay import replay
from planner.paper.cases import POINT, Z2_MARGIN, Cases, paper_problem
from planner.paper.detours import detours
from planner.paper.fit import COUNT_FROM_S
from planner.plan.plan import Plan
from planner.problem.feasibility import travel_window
from planner.problem.nonholonomy import paper_recursion
from planner.robustness.sensitivities import sensitivities
from planner.solve import solve
from planner.support.arrays import Array
from planner.support.files import read_toml
from planner.systems.chained_form import chained_form
from planner.systems.controllability import controllability
from planner.systems.manipulator import Manipulator

Verdict = Literal[
    "agrees",
    "misprint",
    "does not hold",
    "its point never; other points yes",
    "between the ends only",
    "measured",
    "calibrated",
    "not printed",
    "only near a point",
    "true of every plan alike",
]


TEXTS = read_toml(Path(__file__).with_name("reproduce.toml"), "a table of the page's texts")


@dataclass(frozen=True)
class PaperNumber:
    """A printed number or claim of the paper, compared with our result.

    Attributes:
        where: Place in the paper.
        printed: What the paper says.
        ours: Our result.
        verdict: One of `Verdict`.
    """

    where: str
    printed: str
    ours: str
    verdict: Verdict


def findings(cases: Cases) -> list[PaperNumber]:
    """Return all findings on the paper's numbers and claims, in the order of the paper."""
    return [
        _contacts(),
        *_controllability(),
        *_boundary(),
        *_law(cases),
        *(PaperNumber(*row) for row in TEXTS["claims"]),
        *_domain(cases),
        *_motion(cases),
        _machine(cases),
        *_causes(cases),
        _drive_torque(cases.valid),
        _sensitivity(cases),
    ]


def turned_ratio(degrees: Array, lateral: float, share: float = 0.0) -> Array:
    """Return the share of speed that three equally turned contacts transmit, cos³θ by eq. (6).

    Args:
        degrees: Angle by which all contacts are turned, any shape.
        lateral: Ratio of sideways friction to friction along the drive.
        share: Load of the last contact, relative to its capacity.
    """
    cosines, one = np.cos(np.deg2rad(np.asarray(degrees, dtype=float)))[None], np.ones((1, 1))
    load = np.full_like(cosines, share)
    _, parts, _ = chain_loads(cosines, np.ones((1, *cosines.shape[1:])), load, lateral * one, one)
    return np.asarray(parts[:, 0].prod(axis=0) * cosines[0] ** 3)


def _contacts() -> PaperNumber:
    small, steep = turned_ratio(np.array([10.0, 30.0]), 1.0)
    rollers = turned_ratio(np.array([10.0, 30.0]), 0.1, 0.1)
    return PaperNumber(
        "(6)",
        "a joint behind three contacts turns as cos^3(theta), with friction disks",
        "a turned contact slides sideways and loads the contact before it. Plain disks, which have"
        " the same friction sideways, give cos(3 theta) at any contact force, even without load:"
        f" {small:.3f} instead of {np.cos(np.deg2rad(10)) ** 3:.3f} at 10 deg, {abs(steep):.3f} at"
        " 30 deg. (6) needs contacts with little friction sideways, such as rollers: with a tenth"
        f" of the friction, loaded to a tenth of their capacity, {rollers[0]:.3f} at 10 deg,"
        f" {rollers[1]:.3f} at 30 deg instead of {np.cos(np.deg2rad(30)) ** 3:.3f}",
        "does not hold",
    )


def _angles(*degrees: float) -> np.ndarray:
    return np.array([0.0, *np.deg2rad(degrees)])


def _controllability() -> list[PaperNumber]:
    system = paper_problem().system
    assert isinstance(system, Manipulator)
    regular = controllability(system, _angles(20, 20, 20))
    singular = controllability(system, _angles(0, 20, 20))
    recursion = paper_recursion(system, _angles(20, 20, 20)).printed
    zeros = [
        paper_recursion(system, _angles(*angles)).printed.determinant
        for angles in ((0, 20, 20), (20, 0, 20))
    ]
    return [
        PaperNumber(
            "(12)-(15)",
            "X_2 = d/dtheta_2 and Y_2 = (0, y_2) follow from the recursion",
            f"at 20 deg the printed X_2 is wrong by {recursion.x_error[0]:.3g}: the recursion holds"
            " for a sine law",
            "does not hold",
        ),
        PaperNumber(
            "(17)",
            "det vanishes nowhere",
            f"the printed family's determinant is {recursion.determinant:.3g} at 20 deg, but"
            f" {zeros[0]:.3g} at theta1 = 0 and {zeros[1]:.3g} at theta2 = 0. Growth vector"
            f" {regular.growth} at 20 deg, {singular.growth} at theta1 = 0: the machine is"
            " controllable at both; the second needs brackets of higher order",
            "does not hold",
        ),
    ]


def _boundary() -> list[PaperNumber]:
    problem = paper_problem()
    form = chained_form(problem.system)
    start = ", ".join(f"{z:.4f}" for z in form.z(problem.start)[1:])
    z2, z3, z4 = (f"{z:.4f}" for z in form.z(np.nan_to_num(problem.goal))[1:])
    return [
        PaperNumber(
            "4.3, z(0)", "(-0.0324, 0.7113, 0.0175)", f"({start}); fixes K2 and K3", "agrees"
        ),
        PaperNumber("4.3, z2(T)", "-0.532", f"{z2}: a digit is missing", "misprint"),
        PaperNumber("4.3, z3(T), z4(T)", "0.4622, 0.5236", f"{z3}, {z4}", "agrees"),
    ]


def _law(cases: Cases) -> list[PaperNumber]:
    window = travel_window(paper_problem())
    assert window is not None
    low, high = cases.valid.notes["travel_ranges_in_domain"][0]
    return [
        PaperNumber(
            "4.3, travel of phi2",
            "not given",
            f"one-way motions exist only for {window.low:.5f} to {window.high:.5f} rad; the plain"
            f" cubic stays in the domain for {low:.4f} to {high:.4f}",
            "not printed",
        ),
    ]


def _domain(cases: Cases) -> list[PaperNumber]:
    crossings = " and ".join(f"{t:.3f}" for t in cases.free.domain.z2_crossings_s)
    exits = " to ".join(f"{t:.3f}" for t in cases.point.domain.exits_s)
    return [
        PaperNumber(
            "Fig. 4",
            "z2 crosses zero twice without a constraint point",
            f"at {crossings} s (at pi/4, an inferred travel, and T = 10 s)",
            "agrees",
        ),
        PaperNumber(
            "Fig. 5",
            f"with the point ({POINT[0]:g}, {POINT[1]:g}) z2 stays negative",
            f"at pi/4, an inferred travel: largest z2 {cases.point.domain.z2_max:.4f}",
            "agrees",
        ),
        PaperNumber(
            "Fig. 5",
            "and so avoids the singularities",
            f"at pi/4, an inferred travel: from {exits} s there is no real theta1: cos^2(theta1)"
            f" would have to reach {1 - cases.point.domain.margin:.2f}",
            "does not hold",
        ),
        PaperNumber(
            "4.2, step 5",
            "constraint points lead around singularities",
            detours(),
            "its point never; other points yes",
        ),
        PaperNumber(
            "4.2",
            "the singularity in state space can be considered as obstacle",
            f"by a plan that keeps z2 <= {-Z2_MARGIN:g}: at pi/4, an inferred travel, the least"
            f" effort is {cases.kept.objective:.4f} rad^2/s instead of"
            f" {cases.crossing.objective:.4f} with z2 up to"
            f" {cases.crossing.domain.z2_max:+.3f}; the disk turns back in both"
            " (problems/z2-limit.toml). With the travel free the limit does not act",
            "agrees",
        ),
    ]


def _motion(cases: Cases) -> list[PaperNumber]:
    """Return findings on Figs. 6, 7 and 10, and on the two control schemes of section 4.2."""
    run, end = cases.replay, cases.valid.duration
    first, last = (", ".join(f"{u:.2f}" for u in cases.valid.u(t)) for t in (0.0, end))
    kept = (run.t >= COUNT_FROM_S) & (run.t <= end)
    gap = np.median(
        np.max(np.abs(run.motor_rates - cases.valid.trajectory.u(run.t))[:, kept], axis=1), axis=0
    )
    largest = float(np.median(run.largest_error_deg, axis=0).max())
    numbers = run.numbers.tolist()
    closed = replay(cases.valid, run.machine, numbers, run.seed, feedback=True, record_s=None)
    return [
        PaperNumber(
            "Figs 6 to 8",
            "the motion is quite smooth and continuous",
            f"the inputs are smooth between the ends; they jump from rest to ({first}) rad/s and"
            f" from ({last}) rad/s to rest",
            "between the ends only",
        ),
        PaperNumber(
            "Fig. 10",
            "the motors' speeds match well with Fig. 7 and are precisely controlled",
            f"on our emulated prototype motor 1 is at most {gap[0]:.4f} rad/s and motor 2"
            f" {gap[1]:.4f} rad/s off (median), {COUNT_FROM_S:g} s after the jump of the command"
            f" and later; the joints are {largest:.0f} deg off all the same, since play and torsion"
            " lie behind the motors",
            "agrees",
        ),
        PaperNumber(
            "4.2",
            "feedback to a configuration other than zero is extremely difficult in practice",
            "as feedback laws of chained forms; tracking a plan by the joint encoders ends"
            f" {np.median(closed.terminal_E_deg):.2f} deg off (E {closed.percentile(50):.2f} deg,"
            " median of the emulated prototype), and the plan decides singularities and obstacles",
            "does not hold",
        ),
    ]


CAUSES = {
    "backlash": ("backlash_deg", "gearhead_backlash_deg"),
    "torsion of the shafts": ("shaft_stiffness_nm_per_rad",),
    "resolution": ("encoder_resolution_deg", "velocity_resolution_rad_s"),
}
"""Causes that section 4.3 names, and the effects of the machine that stand for them."""


def _causes(cases: Cases) -> list[PaperNumber]:
    run, words = cases.replay, []
    for cause, effects in CAUSES.items():
        without = run.machine.with_(**dict.fromkeys(effects, False))
        alone = replay(cases.valid, without, run.numbers.tolist(), run.seed, record_s=None)
        words.append(f"without {cause} {np.median(alone.largest_error_deg, axis=0)[2]:.1f} deg")
    return [
        PaperNumber(
            "4.3, causes of the error",
            "backlash, low stiffness of the long shaft, low resolution",
            f"theta3 is {np.median(run.largest_error_deg, axis=0)[2]:.1f} deg off on our emulated"
            f" prototype (median); {', '.join(words)}",
            "measured",
        )
    ]


def _machine(cases: Cases) -> PaperNumber:
    error = np.median(cases.replay.largest_error_deg, axis=0)
    return PaperNumber(
        "Fig. 9",
        "5 deg error of theta3",
        f"median {error[2]:.1f} deg on our emulated prototype, which was calibrated to it (planner"
        f" calibrate); theta2, not reported in the paper: {error[1]:.1f} deg",
        "calibrated",
    )


def _sensitivity(cases: Cases) -> PaperNumber:
    calm = solve(cases.best.problem.changed(CALM_LIMITS), "desensitised")
    comparison = sensitivities({"valid": cases.valid, "best": cases.best, "calm": calm})
    law, best, calm_block = (f"{value:.3f}" for value in comparison.passive_block_deg.values())
    totals = [each.total_deg() for each in comparison.plans.values()]
    return PaperNumber(
        "5",
        "the path will be very different when input control changes slightly",
        f"errors of 1 % in both inputs and 0.5 deg at the start move the end by {totals[0]:.2f} deg"
        f" (one standard deviation); {comparison.plans['valid'].floor_deg():.3f} deg of it is the"
        " same for all open-loop plans between these ends. The part that depends on the path"
        f" (passive block) is {law} deg for the paper's law and {best} deg for the plan of least"
        f" effort, so the law is not the cause. A desensitised plan has {calm_block} deg, and a"
        f" total of {totals[2]:.2f} deg",
        "true of every plan alike",
    )


CALM_LIMITS = {"limits": {"input_rad_s": [0.6, 0.6]}}
"""Input limits of the desensitised plan; without limits the inputs would grow without bound."""


def _drive_torque(plan: Plan) -> PaperNumber:
    machine = Machine.prototype()
    loads = [contact_load(plan, machine.with_(lateral_friction=e)) for e in (0.0, 0.1, 0.3, 1.0)]
    torques = [f"{float(load.motor_nm[0]):.2f}" for load in loads]
    limit = float(machine.mean("torque_limit_nm")[0])
    slips = [float(load.share[0]) for load in loads]
    return PaperNumber(
        "4.3, causes of the error",
        "the friction disks lack drive torque",
        f"on our emulated prototype motor 1 needs {torques[0]} N m without sideways friction,"
        f" {torques[1]} N m if it is a tenth of the driving friction (the preset), {torques[2]} N m"
        f" if three tenths; its limit is {limit:.3g} N m. The load of the most loaded contact is"
        f" {slips[0]:.2f}, {slips[1]:.2f} and {slips[2]:.2f} of that at which it slips grossly;"
        f" with plain disks {slips[3]:.2f}: at 1 the joints behind it stop",
        "calibrated",
    )
