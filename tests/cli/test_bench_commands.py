"""From an arm on the bench to its machine, on the command line."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import planner
from planner import Identification

PAPER = Path(__file__).parents[2] / "problems/paper.toml"


def test_the_way_from_a_motion_to_a_machine(run: Callable, tmp_path: Path) -> None:
    motion, csv, table = tmp_path / "excitation.json", tmp_path / "1.csv", tmp_path / "mine.toml"
    made = run("motion", "excitation", PAPER, "--out", motion, "--json").json
    assert made["verified"]
    assert made["duration_s"] == pytest.approx(30)
    arm = planner.Machine.prototype(backlash_deg=4.0).nominal()
    planner.emulate_log(planner.load_plan(motion), arm).save(csv)

    words = ("--problem", PAPER, "--starts", "1")
    found = run("identify", csv, *words, "--out", table, "--figure", tmp_path / "a.png", "--json")
    assert found.status == 0
    w2 = next(each for each in found.json["parameters"] if each["key"] == "w2")
    twist = arm.mean("coulomb_friction_nm") / arm.mean("shaft_stiffness_nm_per_rad")
    assert w2["value"] == pytest.approx(2.0 + np.rad2deg(twist[0]), abs=0.03)
    assert (tmp_path / "a.png").stat().st_size > 10_000
    runs = [tmp_path / "short.csv", tmp_path / "other.csv"]
    for seed, path in enumerate(runs, start=1):  # each with its own noise
        log = planner.emulate_log(planner.load_plan(motion), arm, seed=seed)
        log.part(0, log.t[-1] / 5).save(path)
    text = run("identify", *runs, *words).out
    assert "w2" in text
    assert "not fitted, predicted by the preset machine: largest error" in text

    homed = ("--set", "machine.start_state=forward", "--set", "compensation.on=true")
    made = run("plan", PAPER, "--machine", table, *homed, "--out", tmp_path / "plan.json")
    assert made.status == 0
    plan, arm = planner.load_plan(tmp_path / "plan.json"), arm.with_(start_state="forward")
    used = planner.load_machine(table).with_(start_state="forward")
    assert planner.Machine.from_table(plan.problem.machine) == used
    assert planner.replay(plan, arm).terminal_E_deg[0] < 0.1

    planner.emulate_log(plan, arm).save(tmp_path / "2.csv")
    words = ("--problem", PAPER, "--plan", tmp_path / "plan.json", "--machine", table)
    seen = run("log", tmp_path / "2.csv", *words, "--out", tmp_path / "b.png", "--json").json
    expected = planner.replay(plan, arm).terminal_error_deg[0]
    assert seen["terminal_error_deg"] == pytest.approx(expected, abs=0.15)
    assert max(seen["largest_from_motion_deg"]) < 0.3  # encoder steps, and what identifying left
    told = run("log", tmp_path / "2.csv", *words).words
    assert "from the requested path" in told
    assert "from the compensated plan's motion" in told
    assert (tmp_path / "b.png").stat().st_size > 10_000


def test_a_machine_that_is_no_better_is_written_only_on_request(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Identification, "improves", False)
    motion, table = planner.excitation(planner.load_problem(PAPER)), tmp_path / "mine.toml"
    runs = [tmp_path / "1.csv", tmp_path / "2.csv"]
    for seed, path in enumerate(runs):
        planner.emulate_log(motion, "prototype", seed=seed).part(0, 6.0).save(path)
    words = ("identify", *runs, "--problem", PAPER, "--starts", "1", "--out", table)
    refused = run(*words)
    assert refused.status == 3
    assert "--anyway" in refused.err
    assert not table.exists()
    assert run(*words, "--anyway").status == 0
    assert table.exists()


def test_what_a_machine_is_worth_travels_with_it(run: Callable, tmp_path: Path) -> None:
    mine, out, worth = tmp_path / "mine.toml", tmp_path / "plan.json", {"half_width_deg": 1.3}
    worth |= {"tested": True, "improves": True}
    machine = planner.Machine.prototype(worth=worth).nominal()
    assert machine.worth.half_width_deg == 1.3
    mine.write_text(
        "[machine]\nworth = {tested = true, improves = true, half_width_deg = 1.3}\n", "utf-8"
    )
    assert planner.load_machine(mine).worth == machine.worth
    homed = ("--machine", mine, "--set", "machine.start_state=forward")
    words = ("plan", PAPER, *homed, "--set", "compensation.on=true", "--out", out)
    assert run(*words, "--json").json["worth"] == worth
    text = run(*words).words
    assert "+- 1.3 deg" in text
    assert "--machine" in text
    assert "machine.backlash_deg" not in text
    plan = planner.load_plan(out)
    assert plan.worth == machine.worth
    assert machine.worth.words in plan.reservations
    exported = run("export", out, "--out", tmp_path / "plan.csv", "--json").json
    assert exported["worth"] == worth
    plain = run("compare", PAPER, *homed, "--methods", "polynomial", "-n", "2", "--json").json
    assert plain["machine"]["worth"] == worth
    assert machine.worth.words in plain["headline"]
    assert plain["rows"][0]["replay"]["worth"] == worth
    mine.write_text("[machine]\nbacklash_deg = 2.0\n", "utf-8")  # as earlier versions wrote it
    assert planner.load_machine(mine).worth is None
    untested = planner.Machine.prototype(worth={"tested": False})
    assert planner.compensate(plan.compensates, untested.nominal()).worth == untested.worth


def test_homing_says_when_it_may_go_on(run: Callable, tmp_path: Path) -> None:
    result = run("motion", "homing", PAPER, "--out", tmp_path / "homing.json")
    assert "once every passive encoder is 1.5 deg above its least reading" in result.words


def test_a_motion_is_shown_before_it_is_written(run: Callable, tmp_path: Path) -> None:
    post = PAPER.with_name("obstacle.toml")
    shown = run("motion", "check", post, "--json").json
    assert shown["written"] is None
    space = shown["on_machines"]["space"]
    plan = planner.check_run(planner.load_problem(post))
    q = planner.replay(plan, samples=100).q[:, :, 1:]
    x = plan.problem.system.arm_points(q)[..., 0]
    assert space["theta1_deg"] == pytest.approx(np.rad2deg([q[..., 0].min(), q[..., 0].max()]))
    assert space["x_m"] == pytest.approx([x.min(), x.max()], abs=0.01)
    assert shown["on_machines"]["touching"] == 0
    assert "clearance of link 3 from obstacle 1" in run("motion", "check", post).words
    run("motion", "homing", PAPER, "--out", tmp_path / "homing.json")
    log = planner.emulate_log(planner.load_plan(tmp_path / "homing.json")).save(tmp_path / "h.csv")
    there = run("motion", "check", PAPER, "--pose-from", log, "--out", tmp_path / "c.json")
    assert there.status == 0
    pose = planner.read_log(log).pose_deg
    start = planner.load_plan(tmp_path / "c.json").q(0.0)[1:]
    assert np.rad2deg(start) == pytest.approx(pose, abs=1e-9)


def test_signs_turn_one_motor_after_the_other(run: Callable, tmp_path: Path) -> None:
    run("motion", "signs", PAPER, "--out", tmp_path / "signs.json")
    u = (plan := planner.load_plan(tmp_path / "signs.json")).u(np.linspace(0, plan.duration, 5001))
    assert np.all(np.min(np.abs(u), axis=1) == 0)
    turned = np.rad2deg(u.mean(axis=0) * plan.duration)
    assert turned == pytest.approx([2.0, 2.0], rel=1e-3)
    assert np.argmax(u[:, 1] > 0) < np.argmax(u[:, 0] > 0)


def test_a_first_run_is_slow(run: Callable, tmp_path: Path) -> None:
    plan = planner.excitation(planner.load_problem(PAPER))
    plan.save(tmp_path / "a.json")
    words = ("export", tmp_path / "a.json", "--slow", "10", "--out", tmp_path / "a.csv", "--json")
    assert run(*words).json["on_machines"]["space"]["theta1_deg"][0] < -50
    slow = planner.load_samples(tmp_path / "a.csv")
    assert slow.t[-1] == pytest.approx(10 * plan.duration)
    q = plan.q(np.clip(slow.t / 10, 0, plan.duration))
    assert slow.q[:, 1:] == pytest.approx(q[:, 1:], abs=1e-9)
    assert np.abs(slow.u).max(axis=0) == pytest.approx(plan.peak_u / 10, rel=0.02)
    table = planner.load_samples(planner.export(plan, tmp_path / "a.mat", slow=10))
    np.testing.assert_array_equal(table.table, slow.table)
    wrong = run(*words[:5], tmp_path / "c", "--format", "c")
    assert wrong.status == 2
    assert "has no option for slower motion" in wrong.err
    with pytest.raises(planner.InputError, match="a factor of at least 1"):
        planner.export(plan, tmp_path / "a.csv", slow=0.5)


def test_where_a_tracker_in_c_takes_the_arm_is_told(run: Callable, tmp_path: Path) -> None:
    """Its preparation swings joint 1 farther than the plan."""
    plan = planner.solve(planner.load_problem(PAPER), "collocation", rest=True)
    plan.save(tmp_path / "a.json")
    words = ("export", tmp_path / "a.json", "--json", "--out")
    space = [
        run(*words, tmp_path / name, *more).json["on_machines"]["space"]["theta1_deg"][1]
        for name, more in (("a.csv", ()), ("c", ("--format", "c")))
    ]
    closed = planner.replay(plan, samples=100, feedback=True, record_s=0.02)
    assert space[1] == pytest.approx(np.rad2deg(closed.q[:, :, 1].max()), abs=0.1)
    assert space[1] > space[0] + 20


def test_log_has_a_verdict(run: Callable, tmp_path: Path) -> None:
    plan = planner.solve(planner.load_problem(PAPER), "collocation")
    plan.save(tmp_path / "a.json")
    arm = planner.Machine.prototype().nominal()
    (tmp_path / "arm.toml").write_text("[machine]\ninitial_angle_error_deg = 0\n", "utf-8")
    words = ("--problem", PAPER, "--machine", tmp_path / "arm.toml")
    log = planner.emulate_log(plan, arm).save(tmp_path / "a.csv")
    assert (
        run("log", log, *words, "--plan", tmp_path / "a.json", "--json").json["leaves_band"] is None
    )
    seen = run("log", log, *words, "--json").json
    assert seen["leaves_band"] is seen["jitter"] is None
    late = planner.read_log(log)
    late = replace(late, t=late.t + 0.003 * np.random.default_rng(0).random(len(late.t)))
    shown = run("log", late.save(tmp_path / "late.csv"), *words[:2], "--json")
    assert shown.json["jitter"] in shown.err
    arm = arm.with_(coulomb_friction_nm=[1.0, 1.0], friction_capacity_nm=False)
    log = planner.emulate_log(plan, arm).save(tmp_path / "a.csv")
    left = run("log", log, *words, "--plan", tmp_path / "a.json", "--json").json["leaves_band"]
    assert left["t_s"] > 0
    assert "leaves the band" in run("log", log, *words, "--plan", tmp_path / "a.json").words


def test_the_goal_again(run: Callable, tmp_path: Path) -> None:
    first, log = tmp_path / "first.json", tmp_path / "run.csv"
    free = ("--set", "limits.z2_margin=0.001")
    assert run("plan", PAPER, *free, "--out", first).status == 0
    planner.emulate_log(planner.load_plan(first), "prototype", sample=3).save(log)
    missed = planner.read_log(log).pose_deg - 30
    words = ("plan", PAPER, *free, "--again", first)
    for wrong in (words, (*words, "--run", log, "--after", first), (*words[:-2], "--run", log)):
        assert run(*wrong).status == 2
    moved = planner.read_log(log)
    moved = replace(moved, theta=moved.theta - np.deg2rad(28)).save(tmp_path / "homed.csv")
    for start, pose in ((np.ones(3), ()), (2 + missed, ("--pose-from", moved))):
        made = run(*words, "--run", log, *pose, "--out", tmp_path / "again.json")
        assert made.status == 0
        ends = np.rad2deg(planner.load_plan(tmp_path / "again.json").q([0.0, 10.0])[:, 1:])
        assert ends == pytest.approx(np.array([start, 30 - missed]), abs=1e-5)


def in_the_loop_of_the_guide(first: str, folder: Path) -> list[str]:
    """Start the loop over goals of docs/howto/bench after a first line; return what it prints."""
    page = (PAPER.parents[1] / "docs/howto/bench.md").read_text("utf-8")
    loop = re.search(r"^```sh\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1]
    words = ["bash", "-c", f"{first}\n{loop}"]
    return subprocess.run(words, cwd=folder, check=True, stdout=-1, text=True).stdout.splitlines()


def test_the_loop_over_goals_names_each_plan_before(tmp_path: Path) -> None:
    lines = in_the_loop_of_the_guide("planner() { echo $*; }", tmp_path)
    befores = ["homing.json --pose-from homed.csv", "goal1.json", "goal2.json"]
    for k, (line, before) in enumerate(zip(lines, befores, strict=True), start=1):
        assert f" --after {before} --set " in line
        assert line.endswith(f" --out goal{k}.json")


@pytest.mark.campaign
def test_goals_are_planned_in_a_loop_of_the_shell(run: Callable, tmp_path: Path) -> None:
    """As docs/howto/bench tells it, and how far off the arm is that repeats the plans."""
    assert run("new", tmp_path / "arm.toml").status == 0
    problem = planner.load_problem(tmp_path / "arm.toml")
    known = planner.Machine.prototype(step_s=0.005).nominal()
    table = planner.support.files.toml(known.to_dict())
    (tmp_path / "my-machine.toml").write_text(f"machine = {table}\n", "utf-8")
    homing = planner.homing(problem)
    homing.save(tmp_path / "homing.json")
    planner.emulate_log(homing, known).save(tmp_path / "homed.csv")
    in_the_loop_of_the_guide(f"PATH={Path(sys.executable).parent}:$PATH", tmp_path)
    plans = [planner.load_plan(tmp_path / f"goal{k}.json") for k in (1, 2, 3)]
    runs, known = list[planner.Replay](), known.with_(start_state="forward")
    for plan in (*plans, *3 * plans[1:]):
        runs.append(planner.replay(plan, known, after=runs[-1] if runs else None))
    off = [each.terminal_E_deg[0] for each in runs]
    assert max(off[:3]) < 0.02
    each_pass = np.diff([off[2], *off[4::2]])
    assert np.all((each_pass > 0.1) & (each_pass < 0.4))


def test_wrong_words_are_bad_input(run: Callable, tmp_path: Path) -> None:
    for words, says in (
        (("motion", "dance", PAPER, "-o", tmp_path / "a.json"), "no motion 'dance'"),
        (
            ("log", tmp_path / "a.csv", "-p", PAPER, "-o", tmp_path / "a.png"),
            "give the plan with --plan",
        ),
        (("identify", tmp_path / "none.csv", "-p", PAPER), "none.csv"),
        (("log", PAPER, "-p", PAPER, "--column", "t_s"), "write it as theta1_deg="),
    ):
        result = run(*words)
        assert result.status == 2
        assert says in result.err


def test_goals_in_a_row_name_the_plan_before(run: Callable, tmp_path: Path) -> None:
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    on = ("--set", "compensation.on=true")
    assert run("plan", PAPER, *on, "--out", first).status == 0
    last = planner.load_plan(first)
    goal = ("--set", "goal.theta_deg=[10, 10, 10]", "--set", "goal.travel=free", *on)
    made = run("plan", PAPER, *goal, "--after", first, "--out", second, "--json")
    assert made.status == 0
    plan = planner.load_plan(second)
    assert plan.problem.machine.start_state == last.notes["end_state"]
    assert np.rad2deg(plan.q(0.0)[1:]) == pytest.approx(last.notes["end_theta_deg"], abs=1e-6)
    assert made.json["notes"]["end_state"] == plan.notes["end_state"]
    assert made.json["notes"]["after"] == "first.json"
    told = run("export", second, "--out", tmp_path / "second.csv")
    words = "for an arm that rests at (30, 30, 30) deg after first.json, state -1, -1,"
    assert words in told.err
    data = run("export", second, "--out", tmp_path / "a.csv", "--json").json
    assert data["after"] == "first.json"
    assert data["start"] == plan.start_words
    assert "after first.json, state -1" in plan.start_words
    run("plan", PAPER, "--out", first)
    refused = run("plan", PAPER, "--after", first)
    assert refused.status != 0
    assert "does not tell the state in which it leaves the arm" in refused.err
