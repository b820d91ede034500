"""Plans whose drive turns back: lost motion is taken up while their clock is held."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import Plan
from planner.machine.feedback.means import lost_motion
from planner.machine.feedforward import follow
from planner.machine.feedforward.correction import Correction
from planner.machine.feedforward.legs import (
    axis_rates,
    evenest_drive,
    legs_of,
    preparation,
    reversals,
    stopping_s,
    take_ups,
)
from planner.machine.feedforward.shaping import CommandShape, MotorCommands
from planner.machine.feedforward.variants import Runs, Variants
from planner.plan.plan import Compensation
from planner.problem.tables.problem_file import CompensationTable
from planner.report.panels import span

UNTUNED = 4711
"""A seed that nothing was chosen with."""
MACHINE = planner.Machine.prototype(step_s=0.005)


@pytest.fixture(scope="module")
def turning() -> Plan:
    problem = planner.Problem.manipulator(
        [8.4, 11.0, 14.1], [-27.9, -4.8, -20.8], duration=15, input_rad_s=0.5, joint_deg=80
    )
    return planner.solve(problem)


@pytest.fixture(scope="module")
def better(turning: Plan) -> Plan:
    return planner.compensate(turning, MACHINE)


def test_the_machines_stay_on_the_path_and_end_at_the_goal(turning: Plan, better: Plan) -> None:
    before, after = (
        planner.replay(plan, MACHINE, samples=200, seed=UNTUNED, record_s=None)
        for plan in (turning, better)
    )
    assert after.percentile(95) < 4.2 < 9 < before.percentile(95)
    assert np.percentile(after.terminal_E_deg, 95) < 4.2
    assert np.max(np.abs(planner.verify(better).terminal_error_deg)) < 0.05
    said = better.notes["compensation"]
    assert said["E_deg"] < 1.3 < 5 < said["plain_E_deg"]
    nominal = planner.replay(better, MACHINE.nominal())
    assert said["E_deg"] == pytest.approx(nominal.index_E_deg[0], abs=0.01)


def test_a_screen_is_told_when_the_plan_waits(better: Plan) -> None:
    shown = span(better)
    assert shown["begin"] == -better.lead_s < 0
    assert shown["holds"] == [[a - better.lead_s, b - better.lead_s] for a, b in better.clock.holds]
    assert shown["holds"]
    assert all(0 < begin < end < shown["end"] for begin, end in shown["holds"])


def test_the_goal_is_reached_where_motors_do_not_do_what_their_derivatives_say() -> None:
    """One step of all knots at once gains nothing here: it leaves the way by 4.7 degrees."""
    machine = planner.Machine.prototype(step_s=0.01)
    problem = planner.Problem.manipulator(
        [-5.7, 1.9, 29.8], [-12.5, 7.2, 14.7], duration=15, input_rad_s=0.5, joint_deg=80
    )
    better = planner.compensate(planner.solve(problem), machine)
    assert np.max(np.abs(planner.verify(better).terminal_error_deg)) < 0.05
    said = better.notes["compensation"]
    assert said["E_deg"] < 2.1 < 6 < said["plain_E_deg"]


@pytest.mark.campaign
def test_the_goal_costs_the_way_little() -> None:
    """Where joint 3 comes to rest either turn of the drive moves it one way: steps by derivatives
    alone brought the goal nearer by leaving the way, by 3.3 degrees for 1.5."""
    problem = planner.Problem.manipulator(
        [9.8, 39.1, -22.8], [-27.2, 9.0, -36.5], duration=15, input_rad_s=0.5, joint_deg=80
    )
    better = planner.compensate(planner.solve(problem))
    assert np.max(np.abs(planner.verify(better).terminal_error_deg)) < 0.05
    assert better.notes["compensation"]["E_deg"] < 2.2


def on_meshes(problem: planner.Problem, *meshes: int) -> list[Plan]:
    """One path on several meshes, compensated."""
    first = planner.solve(problem)
    out = []
    for intervals in meshes:
        task = problem.changed({"method.collocation.intervals": intervals})
        out.append(planner.compensate(planner.solve(task, "collocation", warm=first)))
    return out


def test_what_compensation_reaches_does_not_depend_on_the_mesh() -> None:
    problem = planner.Problem.manipulator(
        [9.8, 39.1, -22.8], [-27.2, 9.0, -36.5], duration=15, input_rad_s=0.5, joint_deg=80
    ).changed({"machine.step_s": 0.01})
    coarse, fine = (plan.notes["compensation"] for plan in on_meshes(problem, 14, 100))
    assert coarse["E_deg"] == pytest.approx(fine["E_deg"], rel=0.05)
    assert fine["E_deg"] < 0.2 * fine["plain_E_deg"]


@pytest.mark.campaign
def test_nine_plans_of_three_joints_are_compensated_alike_on_three_meshes() -> None:
    """The search before stopped anywhere from 1.7 to 3.0 degrees on the meshes of one path. Below
    0.4 degrees it stops early."""
    starts = [[8.4, 11.0, 14.1], [-5.7, 1.9, 29.8], [9.8, 39.1, -22.8]]
    goals = [[-27.9, -4.8, -20.8], [-12.5, 7.2, 14.7], [-27.2, 9.0, -36.5]]
    drawn = np.random.default_rng(5).uniform(-40, 40, (7, 2, 3)).round(1).tolist()
    drawn.pop(3)  # no plan takes 15 s
    for start, goal in [*zip(starts, goals, strict=True), *drawn]:
        plans = on_meshes(
            planner.Problem.manipulator(start, goal, duration=15, input_rad_s=0.5, joint_deg=80),
            *(14, 40, 100),
        )
        errors = [plan.notes["compensation"]["E_deg"] for plan in plans]
        plain = plans[0].notes["compensation"]["plain_E_deg"]
        assert max(errors) < max(0.4, 1.05 * min(errors))
        assert max(errors) < min(0.2 * plain, 1.3)


@pytest.mark.campaign
def test_four_joints_are_compensated_alike_on_two_meshes() -> None:
    """The meshes of 14 and 100 had motions 13 to 15 degrees off the path, and plain 9.1: the first
    step removed the miss of the goal at any cost. On 40 the goal is still missed."""
    plans = on_meshes(planner.load_problem("problems/four-joint.toml"), 14, 100)
    errors = [plan.notes["compensation"]["E_deg"] for plan in plans]
    assert max(errors) < min(1.05 * min(errors), 6.5)
    for plan in plans:
        assert np.max(np.abs(planner.verify(plan).terminal_error_deg)) < 0.05


def test_the_goal_is_not_paid_for_by_the_way_at_the_turn() -> None:
    """The axes' needs differ at the crossing's turn. The goal, missed by 1.5 degrees for it, was
    reached by a swing of joint 1 in the hold: it left its path by 4.9 degrees."""
    crossing = planner.load_problem("problems/crossing.toml", {"machine.step_s": 0.01})
    better = planner.compensate(planner.solve(crossing))
    assert np.max(np.abs(planner.verify(better).terminal_error_deg)) < 0.05
    assert better.notes["compensation"]["E_deg"] < 4.0


@pytest.mark.campaign
def test_where_no_turn_of_the_drive_suits_all_axes_none_is_taken_up() -> None:
    """With take-ups the end was missed by 2 degrees, and the plan refused."""
    problem = planner.Problem.manipulator(
        [25.3, -9.6, 38.3, 7.2], [8.4, 11.0, 14.1, -27.9], duration=35, input_rad_s=0.5,
        joint_deg=80,
    )  # fmt: skip
    better = planner.compensate(planner.solve(problem))
    said = better.notes["compensation"]
    assert said["E_deg"] < said["plain_E_deg"]


def test_commands_of_limited_rates_are_foretold_as_they_are_held_and_end_at_rest(
    paper: planner.Problem,
) -> None:
    """Of a travel that is given, so that the drive does not turn back after the plan."""
    machine = planner.Machine.prototype(step_s=0.01, control_period_s=0.02)
    plain = planner.solve(paper.changed({"limits.input_rate_rad_s2": 1.0}), intervals=20)
    asked = plain.problem.changed({"goal.travel": float(plain.q(plain.duration)[0])})
    shape = CommandShape(plain, plain.problem.system, machine, CompensationTable())  # type: ignore[arg-type]
    variants = Variants(plain, machine, shape)
    nothing = np.zeros((len(variants.knots), 2, 1))
    sent = shape.commands(nothing, variants.knots)
    foretold = variants.run(nothing, is_sent=True)
    commands = MotorCommands(shape.t, sent[:, :, 0], shape.clock, shape.is_linear)
    compensation = Compensation(plain, machine.to_dict(), shape.clock)
    _, prediction = follow.plan_with_commands(compensation, commands)
    assert np.max(np.abs(foretold.errors)) == pytest.approx(prediction.error_deg, abs=1e-3)
    better = planner.compensate(replace(plain, problem=asked, verified=False), machine)
    assert np.max(np.abs(planner.verify(better).terminal_error_deg)) < 0.05
    assert np.array_equal(better.u(better.duration), [0, 0])
    assert np.array_equal(plain.u(plain.duration), [0, 0])


def test_the_clock_is_held_where_the_drive_turns_back(turning: Plan, better: Plan) -> None:
    way, turns = reversals(turning)
    assert len(turns) == len(better.clock.holds) == 1
    (begin, end) = better.clock.holds[0]
    assert 1 < end - begin < 2.5
    assert better.clock(begin) == pytest.approx(turns[0], abs=2.0)
    middle = (begin + end) / 2
    assert np.array_equal(better.reference(middle), turning.q(float(better.clock(middle))))
    assert np.sign(better.u(middle)[0]) == -way
    kinematic = turning.q(better.clock(end))
    assert np.max(np.abs(better.q(end) - kinematic)[1:]) < np.deg2rad(0.6)


def test_a_file_keeps_the_clock(better: Plan, tmp_path: Path) -> None:
    path = better.save(tmp_path / "plan.json")
    read = planner.load_plan(path)
    assert read.verified
    assert read.clock == better.clock
    data = json.loads(path.read_text(encoding="utf-8"))
    data["compensation"]["clock"]["s"][-1] -= 0.5
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(planner.InputError, match=r"compensation\.clock"):
        planner.load_plan(path)
    del data["compensation"]["clock"]
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(planner.InputError, match=r"missing key 'compensation\.clock'"):
        planner.load_plan(path)


def test_the_drive_misses_what_axes_need_by_the_least() -> None:
    rates = np.array([[1.0, 2.0], [1.0, 1.0]])
    drive, miss = evenest_drive(rates, np.array([3.0, 3.0]))
    assert drive.tolist() == pytest.approx([2.0, 3.0])
    assert miss.tolist() == pytest.approx([1.0, 0.0])


def test_a_take_up_tells_what_each_axis_lacks(turning: Plan) -> None:
    """By the arm's own rates: what the drive turns the axis by, beside what it needs."""
    system, needs = turning.problem.system, np.array([0.10, 0.06])
    way, turns = reversals(turning)
    (leg,) = take_ups(turning, system, MACHINE, way, turns, needs, 0.01, 2.0)  # type: ignore[arg-type]
    turned = system.rates(turning.q(leg.place_s), np.array([leg.angles[-1, 0], 0.0]))[2:]
    np.testing.assert_allclose(leg.misses, np.abs(np.abs(turned) - needs), atol=1e-12)
    assert leg.misses[0] == pytest.approx(leg.misses[1])  # which is the least


def test_motors_come_back_from_where_they_stop(turning: Plan) -> None:
    """From 0.5 rad/s at 2 rad/s^2: 0.0625 rad too far in 0.25 s, and back from rest to rest."""
    limits = {"limits.input_rad_s": 0.5, "limits.input_rate_rad_s2": 2.0}
    plan = replace(turning, problem=turning.problem.changed(limits))
    back_s = 2 * np.sqrt(2 * (0.0625 / 2) / 2.0)
    assert stopping_s(plan, planner.Machine.ideal()) == pytest.approx(0.25 + back_s)
    assert stopping_s(turning, planner.Machine.ideal()) == 0


@pytest.mark.parametrize(
    ("gain", "size", "taken"),
    [(0.75, 1.0, 0.5), (0.1, 1.0, 1.0), (0.75, 0.4, 0.4), (0.9, 0.4, 0.2), (0.75, -1.0, None)],
)
def test_the_cheapest_step_that_leaves_little_of_a_miss_is_taken(
    turning: Plan, monkeypatch: pytest.MonkeyPatch, gain: float, size: float, taken: float | None
) -> None:
    """Here a step leaves 1 - its size of the miss; the smaller, the less it costs the motion."""

    def run(self: Variants, values: np.ndarray, *given: Any, **named: Any) -> Runs:
        steps = values[-1, 0, :, None]
        return Runs(100 * np.abs(steps), 1 - steps, np.ones_like(steps))

    monkeypatch.setattr(Variants, "run", run)
    shape = CommandShape(turning, turning.problem.system, MACHINE, CompensationTable())  # type: ignore[arg-type]
    correction = Correction(turning, MACHINE, shape)
    now = correction._variants.run(correction.values[:, :, None])[0]
    steps = np.full((len(correction.knots), 2, 1), size)
    found = correction._best_of(steps, now, gain)
    assert (found and found[1][-1, 0]) == taken


@pytest.mark.parametrize("power", [2, 8])
def test_a_correction_is_judged_by_a_power_mean_of_its_errors(turning: Plan, power: int) -> None:
    shape = CommandShape(turning, turning.problem.system, MACHINE, CompensationTable())  # type: ignore[arg-type]
    correction = Correction(turning, MACHINE, shape)
    runs = Runs(np.array([[3.0, -4.0]]), np.zeros((1, 2)), np.ones((1, 2)))
    wanted = ((3.0**power + 4.0**power) / 2) ** (1 / power)
    assert correction._measure(runs, correction.values, power, 1.0) == pytest.approx(wanted)


def test_each_take_up_has_the_plan_up_to_half_way_to_the_other_turns(
    turning: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[float, float]] = []
    q_of = turning.trajectory.q
    monkeypatch.setattr(
        type(turning.trajectory), "q", lambda _, t: asked.append((t[0], t[-1])) or q_of(t)
    )
    needs = np.full(2, 0.02)
    take_ups(turning, turning.problem.system, MACHINE, 1.0, [4.0, 8.0], needs, 0.01, 9.0)  # type: ignore[arg-type]
    assert asked == [(0.0, 6.0), (6.0, 15.0)]


def test_what_is_known_before_the_start_is_not_taken_up_again(turning: Plan) -> None:
    system, machine = turning.problem.system, planner.Machine.prototype()
    way, _ = reversals(turning)
    options = CompensationTable(take_up=False, back_off=False, correction=False)

    def drive(state: str) -> float:
        known = machine.with_(start_state=state)
        legs = legs_of(turning, system, known, options, 0.01)  # type: ignore[arg-type]
        return way * legs[0].angles[-1, 0] if legs else 0.0

    along, against = ("forward", "backward")[:: int(way)]
    assert drive("unwound") == drive("unknown") > 0
    assert drive(along) == 0.0
    assert drive(against) == pytest.approx(2 * drive("unwound"), rel=0.1)


def test_preparation_is_no_longer_than_it_is_worth(turning: Plan) -> None:
    system, machine = turning.problem.system, planner.Machine.prototype()
    slow = replace(turning, problem=turning.problem.changed({"limits.input_rad_s": 0.02}))
    lost = lost_motion(system, machine)
    quick, dear = (
        preparation(plan, system, machine, 1.0, lost, 0.01)  # type: ignore[arg-type]
        for plan in (turning, slow)
    )
    assert np.ptp(dear.angles[:, 1]) < 0.5 * np.ptp(quick.angles[:, 1])
    assert dear.uneven_rad > quick.uneven_rad


def test_preparation_keeps_off_a_post(paper: planner.Problem) -> None:
    """A disc that joint 1 would swing the arm into: it does not go as far."""
    system, machine = paper.system, planner.Machine.prototype()
    plain = planner.solve(paper)
    needs = lost_motion(system, machine)
    free = preparation(plain, system, machine, 1.0, needs, 0.01)  # type: ignore[arg-type]
    swing = np.max(np.abs(free.angles[:, 1]))
    arm = system.arm_points(plain.q(0.0)[1:] + np.array([swing, 0, 0]))[-1]  # type: ignore[attr-defined]
    post = paper.changed({"obstacles": [{"centre_m": (1.02 * arm).tolist(), "radius_m": 0.2}]})
    near = replace(plain, problem=post)
    kept = preparation(near, system, machine, 1.0, needs, 0.01)  # type: ignore[arg-type]
    assert 0 <= np.max(np.abs(kept.angles[:, 1])) < 0.9 * swing
    assert kept.uneven_rad > free.uneven_rad


def test_rates_of_axes_depend_on_joint_1_alone_while_joints_stand(turning: Plan) -> None:
    q = np.repeat(turning.q(5.0)[None], 2, axis=0)
    q[1, 0] += 1.0
    rates = axis_rates(turning.problem.system, q)  # type: ignore[arg-type]
    assert np.array_equal(rates[0], rates[1])


def test_no_better_than_the_plan_as_it_is_says_so(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = follow.predict

    def exact_when_plain(plan: Plan, *given: Any, **named: Any) -> follow.Prediction:
        found = usual(plan, *given, **named)
        return found if plan.compensates else replace(found, deviation=0 * found.deviation)

    monkeypatch.setattr(follow, "predict", exact_when_plain)
    with pytest.warns(
        planner.InputWarning, match=r"leaves the path by .* the uncompensated one by 0 deg"
    ):
        planner.compensate(planner.solve(paper), MACHINE)


def test_all_that_is_run_fits_in_its_duration(paper: planner.Problem) -> None:
    paper = paper.changed({"machine.step_s": 0.01})
    asked = paper.changed({"compensation.on": True, "goal.duration_max": 12})
    made = planner.solve(asked)
    assert made.verified
    assert 11.5 < made.duration <= 12
    assert made.compensates is not None
    assert made.compensates.duration < 10
    with pytest.raises(planner.NoPlanError, match=r"goal\.duration_max") as caught:
        planner.solve(asked.changed({"goal.duration": 5, "goal.duration_max": 5}))
    assert caught.value.advice is not None
    least = float(caught.value.advice.split("duration_max = ")[1].split(";")[0])
    assert 6.5 < least < 9
    given = asked.changed({"goal.duration": 5, "goal.duration_max": least})
    assert planner.solve(given).duration <= least  # what is advised does
    with pytest.raises(planner.InputError, match=r"goal\.duration_max"):
        paper.changed({"goal.duration_max": 5})


def test_the_tracker_follows_the_same_clock_and_ends_five_times_closer(
    turning: Plan, better: Plan
) -> None:
    """Lost motion is learnt before the start, and a loose path leaves room to allow for it."""
    machine = MACHINE.with_(encoder_resolution_deg=0.02, encoder_noise_deg=False)
    loose = planner.Tracker(path_error_deg=1.0)
    plain, run, opened = (
        planner.replay(plan, machine, 8, seed=UNTUNED, feedback=feedback, record_s=None)
        for plan, feedback in ((turning, loose), (better, loose), (better, False))
    )
    assert np.median(run.terminal_E_deg) < min(np.median(opened.terminal_E_deg) / 5, 0.4)
    assert np.percentile(run.terminal_E_deg, 95) < 0.7  # 0.93 where lost motion is not learnt
    assert run.percentile(50) < plain.percentile(50)
    assert better.lead_s - loose.design(better, machine).ref.timing.begin < 9.0
