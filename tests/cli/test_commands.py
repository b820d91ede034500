"""What plan, check and the listings answer when the input is right."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import shlex
import signal
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.cli import output
from planner.cli.arguments import parse_changes
from planner.verification.summary import plan_summary

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = PROBLEMS / "paper.toml"
SOLVED = ("plan", PAPER, "-m", "polynomial", "--set", "goal.travel=0.82", "--set", "limits={}")
FIGURES = {
    "method", "status", "objective", "solve_time_s", "build_time_s", "iterations", "duration_s",
    "travel_rad", "terminal_error_deg", "peak_u_rad_s", "domain_ok", "domain_margin", "z2_max",
    "singular_times_s", "verified", "violations", "reason", "advice", "direction", "terminal_error",
}  # fmt: skip


BESIDE_A_POST = """
system = {{kind = "manipulator", joints = 2, K = [0.9], k_g = 0.7, link_lengths = [0.4, 0.3]}}
start.theta_deg = [5, 5]
goal = {{theta_deg = [35, 30], duration = 8.0}}
limits = {{input_rad_s = [0.6, 0.6], joint_deg = 75}}
obstacles = [{{centre_m = [{x}, 0.28], radius_m = 0.06, clearance_m = 0.003}}]
"""


def lacking(text: str, *pieces: str) -> list[str]:
    return [piece for piece in pieces if piece not in text]


def test_a_plan_for_people(run: Callable) -> None:
    result = run(*SOLVED)
    assert (result.status, result.err) == (0, "")
    assert not lacking(
        result.out,
        "solved, verified",
        "0.82 rad, one way",
        "inside the domain",
        "The plan reaches the goal and keeps every limit",
        "requirements proven between the nodes",
    )
    took, solved = re.findall(r"([\d.e-]+) s (?:in all|to solve)", " ".join(result.out.split()))
    assert float(took) > float(solved)
    assert "\x1b" not in result.out
    assert all(line == line.rstrip() for line in result.out.splitlines())


def test_a_plan_that_starts_with_a_jump_says_so(run: Callable, tmp_path: Path) -> None:
    """Limits on input rates hold from its start to its end, and do not say how it gets there."""
    out, rates = tmp_path / "plan.json", {"limits.input_rate_rad_s2": 0.5, "goal.duration": "free"}
    settings = [word for key, x in rates.items() for word in ("--set", f"{key}={x}")]
    shown = run("plan", PAPER, "-m", "sinusoid", *settings, "--out", out)
    plan = planner.load_plan(out)
    speeds = [rf"\|u{k}\| = {abs(plan.u(0.0)[k - 1]):.4g} rad/s" for k in (1, 2)]
    words = rf"starts with a jump \({', '.join(speeds)}\) and ends with a jump \("
    assert re.search(f"keeps every limit .*It {words}", " ".join(shown.out.split()))
    assert re.search(words, repr(plan))
    assert re.search(words, repr(planner.verify(plan)))
    assert re.search(words, planner.verify(plan)._repr_html_())
    data = run("plan", PAPER, "-m", "sinusoid", *settings, "--json").json
    assert (data["starts_at_rest"], data["ends_at_rest"]) == (False, False)
    assert data["on_machines"] is None
    assert re.search(words, run("export", out, "--out", tmp_path / "x.mat", "--json").json["jumps"])
    result = planner.compare(plan.problem, ["sinusoid"], samples=2)
    assert re.search(words, result.rows[0].remark)
    assert re.search(f"sinusoid {words}", result.headline)
    rest = planner.load_problem(PAPER, rates | {"goal.duration": 30})
    slow = planner.solve(rest, "convex")
    assert slow.jump_words == ""
    assert plan_summary(slow)["starts_at_rest"]
    free = planner.solve(planner.load_problem(PAPER), "collocation")
    assert free.jump_words == "", "nothing limits its rates"


def test_plan_and_export_say_how_many_machines_hit_a_post(run: Callable, tmp_path: Path) -> None:
    """A plan may graze a post; nearly every machine then hits it."""
    file, out = tmp_path / "post.toml", tmp_path / "plan.json"
    file.write_text(BESIDE_A_POST.format(x=0.69))
    data = run("plan", file, "--out", out, "--json").json["on_machines"]
    plan = planner.load_plan(out)
    runs = planner.replay(plan, samples=100)
    assert (data["machines"], data["touching"]) == (100, runs.touching)
    assert 0 < runs.touching < 100
    words = rf"{runs.touching} of 100 machines break a limit: clearance of link \d from obstacle 1"
    assert re.match(words, data["words"])
    assert re.search(r"about clearance_m = [\d.]+ of obstacle 1", data["words"])
    assert re.search(words, " ".join(run("plan", file).out.split()))
    for name, known in (("x.csv", data), ("x.json", None)):
        exported = run("export", out, "--out", tmp_path / name, "--json").json["on_machines"]
        told = exported and {key: exported[key] for key in data}
        assert told == known, "said where motors may execute the file"
    assert re.search(words, run("export", out, "--out", tmp_path / "y.csv").err)
    file.write_text(BESIDE_A_POST.format(x=-0.6))
    far = run("plan", file, "--json").json
    assert far["on_machines"] == {"machines": 100, "touching": 0, "words": None}


def test_plan_says_where_to_stand_clear_of_a_swing(run: Callable, tmp_path: Path) -> None:
    """Joint 1 swings farther before a compensated plan than in it; only export said so."""
    out, words = tmp_path / "plan.json", ("plan", PAPER, "-m", "collocation compensated")
    shown = run(*words, "--out", out)
    space = run("export", out, "--out", tmp_path / "x.csv", "--json").json["on_machines"]["space"]
    low, high = space["theta1_deg"]
    clear = re.search(r"stand clear: theta1 (\S+) to (\S+) deg, theta2", shown.words)
    assert clear is not None
    assert [float(each) for each in clear.groups()] == pytest.approx([low, high], rel=1e-3)
    assert run(*words, "--json").json["on_machines"]["space"] == space
    assert "stand clear" not in run("plan", PAPER).out


def test_export_says_where_to_stand_clear_of_a_plan_that_is_not_verified(
    run: Callable, tmp_path: Path
) -> None:
    with pytest.raises(planner.NoPlanError) as refusal:
        planner.solve(PAPER, "polynomial:travel=middle")
    assert refusal.value.plan is not None
    file = refusal.value.plan.save(tmp_path / "refused.json")
    exported = run("export", file, "--out", tmp_path / "x.csv")
    assert re.search(r"stand clear: theta1 \S+ to \S+ deg", exported.words + exported.err)


def test_a_plan_as_json_and_file(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    result = run(*SOLVED, "--json", "--out", out)
    data = result.json
    assert data.keys() >= FIGURES
    assert (data["verified"], data["domain_ok"], data["duration_s"]) == (True, True, 10.0)
    assert (data["direction"], data["violations"], data["singular_times_s"]) == ("one way", [], [])
    assert data["certificate"]["ok"] is True
    assert {claim["status"] for claim in data["certificate"]["claims"]} == {"proven"}
    assert data["terminal_error"].keys() == {"phi2", "theta1", "theta2", "theta3"}
    assert np.max(np.abs(data["terminal_error_deg"])) < 1e-3
    assert data["peak_u_rad_s"][1] == pytest.approx(40, rel=0.02)
    assert 0 < data["domain_margin"] <= np.sin(np.deg2rad(1)) ** 2 + 1e-12
    assert data["z2_max"] == pytest.approx(-0.0324, abs=1e-4)
    assert result.status == data["exit_status"] == 0
    assert data["written"] == str(out)
    assert result.err == f"plan written to {out}\n"
    assert list(tmp_path.iterdir()) == [out]
    plan = planner.load_plan(out)
    assert plan.verified
    assert plan.travel == pytest.approx(data["travel_rad"])


def test_a_saved_plan_is_drawn_and_judged_anew(run: Callable, tmp_path: Path) -> None:
    file, picture = tmp_path / "plan.json", tmp_path / "plan.svg"
    made = run(*SOLVED, "--out", file, "--figure", picture, "--json").json
    assert "<svg" in picture.read_text(encoding="utf-8")
    judged = run("verify", file, "--json")
    assert judged.status == 0
    assert judged.json["verified"]
    assert judged.json["certificate"] == made["certificate"]
    data = json.loads(file.read_text(encoding="utf-8"))
    data["problem"]["limits"] = {"input_rad_s": [0.01, 0.01]}
    file.write_text(json.dumps(data), encoding="utf-8")
    broken = run("verify", file, "--json")
    assert (broken.status, broken.json["status"]) == (3, "verification_failed")
    assert str(file) in broken.json["error"]
    refused = run(*SOLVED, "--figure", tmp_path / "plan.gif")
    assert (refused.status, refused.out) == (2, "")


def test_refused_plans_as_json(run: Callable, tmp_path: Path) -> None:
    out = ("--json", "--out", tmp_path / "plan.json")
    path = run("plan", PAPER, "-m", "polynomial", "--set", "goal.travel=0.82", *out)
    none = run("plan", PROBLEMS / "unreachable.toml", "-m", "polynomial", *out)
    assert "input u2 reaches" in path.err
    for result, status in ((path, "verification_failed"), (none, "infeasible")):
        assert result.status == result.json["exit_status"] == 3
        assert result.json.keys() >= FIGURES
        assert (result.json["status"], result.json["verified"]) == (status, False)
        assert result.json["advice"]
        assert result.json["written"] is None
    assert path.json["peak_u_rad_s"][1] == pytest.approx(40, rel=0.02)
    (broken,) = path.json["violations"]
    assert (broken["label"], broken["limit"]) == ("input u2", 0.5)
    assert "rad/s" in broken["text"]
    known = {name for name in FIGURES if none.json[name] not in (None, [])}
    assert known == {"method", "status", "verified", "reason", "advice"}
    assert list(tmp_path.iterdir()) == []


def test_a_singular_path_is_shown_for_study_only(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "study.json"
    words = ("plan", PROBLEMS / "paper-fig4.toml", "-m", "polynomial", "--out", out,
             "--set", "method.polynomial.allow_singular=true")  # fmt: skip
    result = run(*words)
    assert result.status == 0
    assert "For study only, not executable" in result.out
    data = run(*words, "--json").json
    assert (data["status"], data["verified"], data["executable"]) == ("singular", False, False)
    assert data["domain_ok"] is False
    assert data["peak_u_rad_s"] == [None, None]
    assert data["terminal_error_deg"] == [None, None, None]
    np.testing.assert_allclose(data["singular_times_s"], [0.3057, 2.2975, 8.6790], atol=1e-4)
    assert planner.load_plan(out).status == "singular"
    assert not planner.load_plan(out).verified


def test_the_direction_counts_turns(run: Callable) -> None:
    study = ("--set", "goal.travel=0", "--set", "method.polynomial.allow_singular=true", "--json")
    assert run(*SOLVED[:4], "--set", "limits={}", *study).json["direction"] == "reverses once"


def test_check_for_people_and_as_json(run: Callable) -> None:
    words = ("check", *SOLVED[1:2], *SOLVED[4:], "--methods", "polynomial")
    brief, result = run(*words), run(*words, "--verbose")
    assert (brief.status, result.status) == (0, 0)
    verdict, step, *_ = brief.out.splitlines()
    assert verdict == "There is a plan: polynomial (one way, inside the chart)."
    assert step == f"Next: planner compare {SOLVED[1]}"
    mathematics = "(0, -0.0324, 0.7113, 0.01745)", "0.78635 to 0.89664 rad", "inside the window"
    assert not lacking(result.out, verdict, *mathematics)
    assert lacking(brief.out, *mathematics) == list(mathematics)
    data = run(*words, "--json").json
    assert data["has_plan"] is True
    assert data["constants"]["K"] == [0.870125, 0.711625]
    assert data["ends"]["start"]["in_chart"] is True
    assert [m["method"] for m in data["methods"]] == ["polynomial"]
    (titles,) = (line.split() for line in brief.out.splitlines() if line.startswith("method "))
    (figures,) = (line.split() for line in brief.out.splitlines() if line.startswith("polynomial "))
    assert titles[6] == "effort"
    assert float(figures[6]) == pytest.approx(data["methods"][0]["effort"], rel=1e-3)


@pytest.mark.parametrize(
    ("file", "changes", "says"),
    [
        ("unreachable", [], "No plan of any kind exists: theta3 must move 29 deg"),
        ("unreachable", [], 'Change goal.duration = "free"'),
        ("paper", ["start.theta_deg=[1,0,1]", "limits={}"], "singularity of the chart: theta2 = 0"),
        (
            "tip",
            ["goal.tip_m=[-0.1,0.7]", "limits.joint_deg=50"],
            "none found within the limits of the joints; the nearest, 0.153 m off",
        ),
    ],
)
def test_check_of_what_has_no_plan(file: str, changes: list, says: str, run: Callable) -> None:
    sets = [word for change in changes for word in ("--set", change)]
    words = ("check", PROBLEMS / f"{file}.toml", "--methods", "polynomial", *sets)
    result = run(*words, "--verbose")
    assert result.status == 3
    assert says in result.words


def test_check_says_equal_refusals_once_and_what_to_run_next(run: Callable) -> None:
    out = run("check", PROBLEMS / "unreachable.toml", "--methods", "polynomial,sinusoid").out
    assert out.startswith("No plan of any kind exists: theta3 must move 29 deg")
    assert "polynomial, sinusoid: " not in out, "the verdict is their refusal"
    assert out.count("goal.duration is 2 s") == 1
    (step,) = (line for line in out.splitlines() if line.startswith("Next: "))
    words = shlex.split(step.removeprefix("Next: planner "))
    assert run(*words).status == 0


def test_a_goal_of_the_tip_for_people(run: Callable) -> None:
    found = run("plan", PROBLEMS / "tip.toml")
    assert found.status == 0
    assert re.search(r"(?m)^joints at the goal +\(28\.\d+, 33\.\d+, 24\.\d+\) deg$", found.out)
    assert not lacking(
        run("check", PROBLEMS / "tip.toml", "--methods", "polynomial", "--verbose").words,
        "the tip at (0.4964, 0.6598) m; theta1, theta2, theta3 free",
        "0.8257 m from the base; the arm is 0.9 m long",
        "elbows can bend in 4 ways, the one nearest to the start",
        "methods in the chart need every joint at the goal",
    )


def test_listings(run: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("methods").out.split() == list(planner.METHODS)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    listed = run("methods").out
    for name, method in planner.METHODS.items():
        assert not lacking(listed, f"{name} ", method.summary.split()[0])
    assert run("methods", "--json").json.keys() == planner.METHODS.keys()
    systems = run("systems", "--json").json
    assert {"manipulator", "unicycle", "car"} <= systems.keys()
    assert all(systems.values())
    assert "manipulator" in run("systems").out


def test_schemas(run: Callable) -> None:
    """Every shipped problem is accepted, and no misspelt key."""
    import jsonschema  # slow

    validator = jsonschema.Draft202012Validator(run("schema").json)
    paths = sorted(PROBLEMS.glob("*.toml"))
    assert len(paths) >= 4
    for path in paths:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        validator.validate(data)
        assert not validator.is_valid({**data, "goal": {**data["goal"], "duratoin": 1}})
    assert not validator.is_valid({**data, "gaol": {}})
    assert "grid" in run("schema", "sweep").json["properties"]
    assert {"grid", "tasks", "front"} <= run("schema", "design").json["properties"].keys()


def test_version_and_no_command(run: Callable) -> None:
    assert run("--version").out == f"planner {planner.__version__}\n"
    nothing = run()
    assert nothing.status == 2
    assert "Commands:" in nothing.out + nothing.err


@pytest.mark.parametrize(
    ("pair", "value"),
    [
        ("a.b=0.8", 0.8),
        ("a.b = 3", 3),
        ("a.b=true", True),
        ("a.b=free", "free"),
        ('a.b="free"', "free"),
        ("a.b=[1, 2.5, 3]", [1, 2.5, 3]),
        ("a.b=[[5.0, -0.2]]", [[5.0, -0.2]]),
        ("a.b={ r1 = 1.0 }", {"r1": 1.0}),
        ("a.b=-1e-3", -1e-3),
        ("a.b=x=y", None),
    ],
)
def test_values_of_set(pair: str, value: Any) -> None:
    if value is None:
        with pytest.raises(planner.InputError, match="'x=y'"):
            parse_changes([pair])
    else:
        assert parse_changes([pair]) == {"a.b": value}


def test_a_bug_is_one_short_message(
    run: Callable, law: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    law(lambda plan: 1 / 0)
    result = run(*SOLVED)
    assert (result.status, result.out) == (1, "")
    assert result.err.startswith("planner: a bug in planner 1.")
    assert "ZeroDivisionError: division by zero. Please report it" in result.err
    assert "Traceback" not in result.err
    assert run(*SOLVED, "--json").json["status"] == "bug"
    assert "Traceback" in run("--debug", *SOLVED).err
    monkeypatch.setenv("PLANNER_DEBUG", "1")
    assert "Traceback" in run(*SOLVED).err


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 12 GiB"), RuntimeError("std::bad_alloc 12 GiB")]
)
def test_a_lack_of_memory_is_no_bug(run: Callable, law: Callable, error: Exception) -> None:
    def greedy(plan: Any) -> planner.Plan:
        raise error

    law(greedy)
    result = run(*SOLVED)
    assert result.status == 2
    assert result.err.startswith("planner: there is not enough memory for this (")
    assert "12 GiB); use fewer machines" in result.err
    assert run(*SOLVED, "--json").json["status"] == "bad_input"


def test_chatter_of_libraries_stays_off_standard_output(run: Callable, law: Callable) -> None:
    def chatty(plan: Callable[[], planner.Plan]) -> planner.Plan:
        print("a banner")
        return plan()

    law(chatty)
    result = run(*SOLVED, "--json")
    assert result.json["status"] == "solved"
    assert "a banner" in result.err


@pytest.mark.parametrize("command", ["plan", "plan, hidden", "check", "compare"])
def test_ctrl_c_ends_quietly(command: str, run: Callable, law: Callable, tmp_path: Path) -> None:
    """Also where a solver swallows it."""

    def press(plan: Any) -> planner.Plan:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if "hidden" not in command:
                raise
        raise planner.NotConvergedError("stopped")

    law(press)
    name = command.partition(",")[0]
    out = [] if name == "check" else ["--out", tmp_path / "out"]
    option = "--method" if name == "plan" else "--methods"
    result = run(name, PAPER, option, "polynomial", "--json", *out)
    assert result.status == 130
    assert result.json["status"] == "interrupted"
    assert result.err == "planner: interrupted, nothing written\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["plan", "compare"])
def test_a_disk_that_fills_leaves_no_file(
    command: str, run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The table of a comparison is on the screen by then."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    compare = ("compare", *SOLVED[1:2], "--methods", *SOLVED[3:], "-n", "3")
    words = SOLVED if command == "plan" else compare
    result = run(*words, "--out", tmp_path / "new")
    assert result.status == 2
    assert ("polynomial" in result.out) == (command == "compare")
    assert "No space left on device" in result.err
    assert list(tmp_path.iterdir()) == []


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "patience_s", "shown"),
    [(Terminal(), 0.0, True), (Terminal(), 60.0, False), (io.StringIO(), 0.0, False)],
    ids=["terminal", "quick job", "file"],
)
def test_progress_shows_on_a_terminal_only_and_after_a_while(
    stream: io.StringIO, patience_s: float, shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "PROGRESS_DELAY_S", patience_s)
    monkeypatch.setattr(sys, "stderr", stream)
    with output.job("planning with patience") as notice:
        notice("still planning")
        time.sleep(0.3)
    assert ("still planning" in stream.getvalue()) == shown
    with output.job() as tell:
        tell("replaying", 0.25)
        tell("replaying", 0.5)
    assert ("replaying" in stream.getvalue()) == shown
    if not shown:
        assert stream.getvalue() == ""
