"""Plans that allow for the machine: the public function and the table `[compensation]`."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import osqp
import pytest
from registered import restored

import planner
from planner import Check, Plan, Violation, compensation
from planner.machine.feedforward import legs
from planner.machine.feedforward.advice import compensation_changes, settings_to_try
from planner.machine.feedforward.follow import follow
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.tables.problem_file import CompensationTable
from planner.support.user_tables import parse

ROOT = Path(__file__).parents[1]
UNTUNED = 31
"""A seed that nothing was chosen with."""
COARSE = {"machine.step_s": 0.01, "machine.control_period_s": 0.02}


@pytest.fixture(scope="module")
def plain(paper: planner.Problem) -> Plan:
    return planner.solve(paper, "collocation")


@pytest.fixture(scope="module")
def better(plain: Plan) -> Plan:
    return planner.compensate(plain)


def percentiles(plan: Plan) -> tuple[float, float]:
    """95 % of E and of the error at the end, degrees, over 300 machines."""
    machine = planner.Machine.prototype(step_s=0.01)
    run = planner.replay(plan, machine, samples=300, seed=UNTUNED, record_s=None)
    return run.percentile(95), float(np.percentile(run.terminal_E_deg, 95))


def test_it_is_a_plan_that_knows_what_it_was_made_from(plain: Plan, better: Plan) -> None:
    assert better.verified
    assert better.certificate is not None
    assert "violated" not in {claim.status for claim in better.certificate.claims}
    assert better.compensates == plain
    assert better.problem == plain.problem
    assert 0 < better.lead_s <= 6
    assert better.duration == pytest.approx(better.lead_s + plain.duration + better.tail_s)
    assert "compensated" in repr(better)
    assert "nominal machine" in repr(better)
    u = better.u(np.linspace(0.0, better.duration, 20_001))
    assert np.max(np.abs(u)) <= 0.5 * (1 + 1e-9)
    near = plain.problem.changed({"goal.theta_deg": [30, 31, 30]})
    assert planner.solve(near, "collocation", warm=better).compensates is None


def test_its_motion_is_the_one_of_the_nominal_machine(better: Plan) -> None:
    run = planner.replay(better, planner.Machine.prototype().nominal(), record_s=0.01)
    during = run.t <= better.duration
    assert np.max(np.abs(run.q[0, during] - better.q(run.t[during]))) < 1e-4
    check = planner.verify(better)
    assert check.ok
    assert np.max(np.abs(check.terminal_error_deg)) < 0.02
    assert check.margins["joint theta3"] > 0
    assert min(margin for label, margin in check.margins.items() if "z2" in label) > 0


def test_without_sensors_most_of_the_error_is_gone(plain: Plan, better: Plan) -> None:
    assert percentiles(plain) > (6.5, 6.0)
    assert percentiles(better) < (2.9, 2.8)


def test_errors_are_measured_against_the_plan_it_compensates(plain: Plan, better: Plan) -> None:
    run = planner.replay(better, planner.Machine.prototype().nominal(), record_s=0.001)
    own = run.t - better.lead_s
    on = own >= -1e-9
    errors = np.rad2deg(np.abs(run.q[0, on] - plain.trajectory.q(own[on])))[:, 1:]
    assert run.index_E_deg[0] == pytest.approx(np.max(errors), abs=1e-6)
    assert run.index_E_deg[0] < 0.6  # and not the 24 degrees by which joint 1 prepares
    assert run.terminal_error[0, 1:] == pytest.approx(run.q[0, -1, 1:] - plain.q(10.0)[1:])


def test_without_preparation_no_time_is_taken(plain: Plan) -> None:
    plan = planner.compensate(plain, preparation=False)
    assert plan.lead_s == 0
    assert plan.duration == pytest.approx(plain.duration + plan.tail_s)
    path, end = percentiles(plan)
    assert end < 3.0  # 2.81; plain 6.8
    assert path < 4.1  # 3.82; plain 7.4


def test_with_inertia_too(plain: Plan) -> None:
    machine = planner.Machine.prototype(fidelity="dynamic", step_s=0.01, control_period_s=0.02)
    plan = planner.compensate(plain, machine)
    run, before = (
        planner.replay(each, machine, samples=20, seed=UNTUNED, record_s=None)
        for each in (plan, plain)
    )
    assert np.median(run.terminal_E_deg) < 1.6 < 4.0 < np.median(before.terminal_E_deg)


def test_a_problem_is_planned_first(paper: planner.Problem, better: Plan) -> None:
    plan = planner.compensate(paper)
    assert plan.method == "collocation"
    assert np.array_equal(plan.t, better.t)
    quick = planner.Machine.prototype(step_s=0.01)
    other = planner.compensate(paper.changed({"goal.duration": 12}), quick, method="polynomial")
    assert other.method == "polynomial"
    assert other.verified


def test_compensating_twice_is_compensating_anew(better: Plan, plain: Plan) -> None:
    again = planner.compensate(
        better, planner.Machine.prototype(backlash_deg=1.0, coulomb_friction_nm=0.08)
    )
    assert again.compensates == plain
    assert again.lead_s < better.lead_s


def test_a_file_gives_it_back_and_is_judged_again(better: Plan, tmp_path: Path) -> None:
    path = better.save(tmp_path / "plan.json")
    read = planner.load_plan(path)
    assert read.verified
    assert (read.lead_s, read.tail_s) == (better.lead_s, better.tail_s)
    assert read.compensation is not None
    assert planner.Machine.from_table(read.compensation.machine) == planner.Machine.prototype()
    assert planner.verify(read.compensation.plan).ok
    assert np.array_equal(read.q(better.t), better.q(better.t))
    data = json.loads(path.read_text(encoding="utf-8"))
    for piece in data["trajectory"]["u"]["bernstein"]:
        piece[700][0] += 0.3  # motor 1 is told something else for a moment
    path.write_text(json.dumps(data), encoding="utf-8")
    changed = planner.load_plan(path)
    assert not changed.verified
    assert "nominal machine's motion" in changed.violation or "goal" in changed.violation


def test_a_motion_that_the_machine_does_not_make_is_seen(better: Plan) -> None:
    trajectory = better.trajectory
    curve = type(trajectory.q_curve)(trajectory.q_curve.c + 1e-3, trajectory.q_curve.x)
    lie = replace(better, trajectory=replace(trajectory, q_curve=curve))
    labels = [v.label for v in planner.verify(lie).violations]
    assert "plan's q(t) against the nominal machine's motion" in labels


def test_what_breaks_a_requirement_on_the_machine_is_refused() -> None:
    problem = planner.load_problem(ROOT / "problems/waypoint.toml")
    with pytest.raises(planner.VerificationError, match="on the nominal machine") as caught:
        planner.compensate(problem, correction=False)
    assert "goal theta2" in [v.label for v in caught.value.violations]
    first, *_, last = caught.value.ways
    assert first == "compensation.correction = true"
    assert "t = " in str(caught.value.advice)
    assert "compensation.on = false" in last


def test_what_it_advises_is_understood(paper: planner.Problem) -> None:
    """Where the preparation meets a limit it named an option that was gone."""
    turning = paper.changed({"goal.theta_deg": [25, -20, 10], "limits.z2_margin": None})
    turning = turning.changed({"compensation.preparation": "forward"})
    quick = turning.compensation.model_copy(update={"correction": False})
    plan = follow(planner.solve(turning), planner.Machine.prototype(step_s=0.01), quick)
    assert plan.lead_s > 0
    times = [0.5 * plan.lead_s, plan.clock.holds[0][0]]
    found = [Violation(Part("clearance of link 3", "m"), -0.1, 0.0, time_s) for time_s in times]
    asked = plan.problem.compensation
    advice = "; ".join(compensation_changes(plan, found, asked))
    assert "take_up" not in advice  # which was tried
    assert "goal.travel" not in advice  # which is free
    assert settings_to_try(plan, found) == [{"compensation.preparation": False}]
    assert settings_to_try(plan, found[1:]) == []
    goal = next(each for each in plan.problem.demands if each.at_goal)
    missed = [Violation(goal.parts[0], 0.002, 0.0, plan.duration, goal)]
    assert compensation_changes(plan, missed, asked)[0] == "more time (goal.duration)"
    assert advice.endswith("more time (goal.duration)")
    limits = (InputProduct(0.01),)  # which the compensation does not know
    limited = replace(plan, problem=replace(plan.problem, registered_limits=limits))
    above = Violation(limits[0].parts[0], 0.3, 0.01, demand=limits[0])
    assert compensation_changes(limited, [above], asked) == [
        "wider limits.test_product: product at least 0.3003",
        "smaller limits.input_rad_s, which the added inputs keep",
    ]
    assert compensation_changes(limited, [above, *missed], asked)[-1] == "more time (goal.duration)"
    without = parse(CompensationTable, {"take_up": False, "correction": False}, "options")
    left_out = "; ".join(compensation_changes(plan, (), without))
    assert "compensation.take_up = true; compensation.correction = true" in left_out
    biased = planner.Machine.prototype(input_bias_rad_s={"value": 0, "spread": 0.002}).to_dict()
    assert plan.compensation is not None
    slow = replace(plan, compensation=replace(plan.compensation, machine=biased))
    assert "a shorter goal.duration: the motors" in "; ".join(
        compensation_changes(slow, found, slow.problem.compensation)
    )


def test_a_preparation_that_meets_a_post_says_so_and_what_helps(
    paper: planner.Problem, better: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A post where joint 1 swings the tip before the plan starts, and would be kept off."""
    plain = planner.solve(paper.changed({"goal.theta_deg": [10] * 3, **COARSE}))
    swung = plain.q(0.0)[1:] + np.deg2rad([34, 0, 0])
    tip = plain.problem.system.arm_points(swung)[-1].tolist()  # type: ignore[attr-defined]
    beside = plain.problem.changed({"obstacles": [{"centre_m": tip, "radius_m": 0.05}]})
    near = replace(plain, problem=beside, verified=False)
    monkeypatch.setattr(legs, "_reachable", lambda problem, q, start: np.ones(len(q), dtype=bool))
    with pytest.raises(planner.VerificationError, match="in the preparation, the first") as caught:
        planner.compensate(near, take_up=False)
    without, obstacle, compensation = caught.value.ways
    assert re.match(r"compensation\.preparation = false .*[\d.]+ deg, .*[\d.]+ deg", without)
    assert "obstacle 1" in obstacle
    assert "compensation.on = false" in compensation
    early = [Violation(Part("clearance of link 3", "m"), -0.1, 0.0, 1.0)]
    assert settings_to_try(better, early)[0] == {"machine.start_state": "forward"}  # it is homed


def test_a_post_that_leaves_a_correction_no_room_leads_to_no_wild_motion(
    paper: planner.Problem,
) -> None:
    """The programmes of the search have no solution; OSQP then returns 2143289344."""
    post = {"centre_m": [1.591, -0.073], "radius_m": 0.1}  # 1 cm below the arm before it moves
    plan = planner.solve(paper.changed({"obstacles": [post], **COARSE}))
    made = planner.compensate(plan)
    assert made.verified
    assert made.notes["compensation"]["E_deg"] < made.notes["compensation"]["plain_E_deg"] / 3


def test_the_fastest_plan_is_slowed_where_its_compensation_is_refused(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its inputs are at their limits all the time, and leave the correction no room."""
    free = paper.changed({"goal.duration": "free", **COARSE})
    fastest = planner.solve(free, "convex")
    usual, checks = compensation.judge, list[Check]()

    def first_refused(plan: Plan) -> tuple[Plan, Check]:
        plan, check = usual(plan)
        checks.append(check)
        return plan, replace(check, ok=len(checks) > 1)

    monkeypatch.setattr(compensation, "judge", first_refused)
    made = planner.compensate(fastest)
    assert made.verified
    assert len(checks) == 2
    assert made.compensates is not None
    assert made.compensates.duration == pytest.approx(1.02 * fastest.duration)
    assert np.allclose(made.compensates.q(1.02 * 3.0), fastest.q(3.0))
    assert made.notes["slowed_for_compensation"] == 1.02


def test_what_is_free_is_not_advised(paper: planner.Problem) -> None:
    short = {"goal.duration": "free", "goal.duration_max": 1.0, "compensation.on": True}
    with pytest.raises(planner.VerificationError, match="duration of the whole run") as caught:
        planner.solve(paper.changed(short), "convex")
    wanted = r"goal\.duration_max = [\d.]+ and what compensation adds, or larger limits\."
    assert re.match(wanted, str(caught.value.advice))
    assert "travel" not in str(caught.value.advice)


def test_a_plan_by_way_of_points_passes_them_on_the_machine_too() -> None:
    plan = planner.compensate(planner.load_problem(ROOT / "problems/waypoint.toml", COARSE))
    check = planner.verify(plan)
    assert check.ok
    assert sum("waypoint" in label for label in check.margins) == 2


def test_only_arms_with_friction_disks(plain: Plan) -> None:
    car = planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"), "polynomial")
    with pytest.raises(planner.InputError, match="kind = 'manipulator'"):
        planner.compensate(car)
    with pytest.raises(planner.InputError, match="preparation"):
        planner.compensate(plain, preparation="backward")
    with pytest.raises(planner.InputError, match="is not a Plan"):
        planner.compensate(3)  # type: ignore[arg-type]


def test_what_needs_the_kinematics_says_so(better: Plan) -> None:
    with pytest.raises(planner.InputError, match=r"plan\.compensates"):
        planner.retime(better)
    assert better.compensates is not None
    own = planner.sensitivity(better.compensates)
    assert planner.sensitivity(better).total_deg() == own.total_deg()


@pytest.mark.parametrize(
    "method", [pytest.param("polynomial", marks=pytest.mark.campaign), "collocation", "convex"]
)
def test_a_problem_can_ask_every_method_for_it(paper: planner.Problem, method: str) -> None:
    wide = {"limits": {"input_rad_s": 5, "joint_deg": 89}} if method == "polynomial" else {}
    asked = {"compensation": {"on": True, "preparation": False}, "machine.step_s": 0.01, **wide}
    plan = planner.solve(paper.changed(asked), method)
    assert plan.verified
    assert plan.compensates is not None
    assert plan.compensates.method == plan.method == method
    assert np.max(np.abs(planner.verify(plan).terminal_error_deg)) < 0.05  # what is promised


def test_the_table_is_checked(paper: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match=r"compensation.*preparation"):
        paper.changed({"compensation.preparation": "backward"})
    with pytest.raises(planner.InputError, match="correction"):
        paper.changed({"compensation.corection": True})
    assert not paper.compensation.on


def test_sweeps_and_check_know_it(paper: planner.Problem, tmp_path: Path) -> None:
    asked = paper.changed({"compensation.on": True, "machine.step_s": 0.01})
    (outcome,) = planner.check(asked, ["collocation"]).outcomes
    assert outcome["verified"]
    assert outcome["duration_s"] > 13
    tables = {
        "problem": paper.changed({"machine.step_s": 0.01}),
        "methods": ["collocation"],
        "grid": {"compensation.on": [False, True]},
        "replay": {"samples": 40, "seed": UNTUNED},
    }
    planner.run_sweep(tables, tmp_path / "db.sqlite", workers=0)
    errors = planner.load_sweep(tmp_path / "db.sqlite")["E_median_deg"].tolist()
    assert errors[0] > 4.5 > 2 > errors[1]


@dataclass(frozen=True)
class InputProduct(Requirement):
    """|u₁ u₂| ≤ most: a limit of a package."""

    most: float

    key, reads, speed_power = "test_product", frozenset({"u"}), 2
    table = float, "Largest |u1 u2|.", 0.2

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("product", "", -self.most, self.most, self.most),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.u[0] * point.u[1]]


@dataclass(frozen=True)
class SecondInput(InputProduct):
    """|u₂| ≤ most."""

    key, speed_power = "second_input", 1
    rows = Requirement.rows


def test_a_limit_of_inputs_that_compensation_does_not_keep_gives_a_warning(
    paper: planner.Problem,
) -> None:
    with restored():
        planner.register_requirement(InputProduct)
        limited = paper.changed({"limits.test_product": 0.2})
        with pytest.warns(planner.InputWarning, match=r"ignore limits\.test_product"):
            limited.changed({"compensation.on": True})
        planner.register_requirement(SecondInput)
        with pytest.warns(planner.InputWarning, match=r"ignore limits\.second_input"):
            paper.changed({"limits.second_input": 0.5, "compensation.on": True})


def test_a_solver_that_raises_corrects_nothing(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the tracker's: that of the correction, whose commands stay what they were."""

    def fail(*_: object, **__: object) -> None:
        raise osqp.OSQPException(1)

    slow = paper.changed({"goal.duration": 20.0, "compensation.on": True})
    monkeypatch.setattr("osqp.OSQP.solve", fail)
    plan = planner.solve(slow)
    assert plan.verified
    assert plan.compensation is not None
