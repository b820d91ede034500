"""What plan, check and the listings answer when the input is right."""

from __future__ import annotations

import errno
import io
import os
import re
import signal
import sys
import time
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.cli.arguments import parse_changes
from planner.verification.summary import SUMMARY_KEYS

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = PROBLEMS / "paper.toml"
SOLVED = ("-m", "polynomial", "--set", "goal.travel=0.82", "--set", "limits={}")


def test_a_plan_for_people(run: Callable) -> None:
    result = run("plan", PAPER, *SOLVED)
    assert result.status == 0
    assert result.err == ""
    assert "solved, verified" in result.out
    assert "0.82 rad, one way" in result.out
    assert "inside the domain" in result.out
    took, solved = re.findall(r"([\d.e-]+) s (?:in all|to solve)", " ".join(result.out.split()))
    assert float(took) > float(solved)
    assert "The plan reaches the goal and keeps every limit" in result.out
    assert "\x1b" not in result.out
    assert all(line == line.rstrip() for line in result.out.splitlines())


def test_a_plan_as_json_and_file(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    result = run("plan", PAPER, *SOLVED, "--json", "--out", out)
    assert result.status == 0
    data = result.json
    assert set(SUMMARY_KEYS) <= data.keys()
    assert data["verified"] is True
    assert data["exit_status"] == 0
    assert data["written"] == str(out)
    assert result.err == f"plan written to {out}\n"
    assert list(tmp_path.iterdir()) == [out]
    plan = planner.load_plan(out)
    assert plan.verified
    assert plan.travel == pytest.approx(data["travel_rad"])
    assert planner.verify(plan).ok


def test_a_refused_plan_as_json(run: Callable, tmp_path: Path) -> None:
    result = run("plan", PAPER, "-m", "polynomial", "--set", "goal.travel=0.82", "--json", "--out",
                 tmp_path / "plan.json")  # fmt: skip
    assert result.status == 3
    data = result.json
    assert set(SUMMARY_KEYS) <= data.keys()
    assert data["status"] == "verification_failed"
    assert data["verified"] is False
    assert data["exit_status"] == 3
    assert data["peak_u_rad_s"][1] == pytest.approx(40, rel=0.02)
    assert data["violations"][0]["label"] == "input u2"
    assert data["advice"]
    assert data["written"] is None
    assert list(tmp_path.iterdir()) == []
    assert "input u2 reaches" in result.err


def test_a_refusal_without_a_path_as_json(run: Callable) -> None:
    result = run("plan", PROBLEMS / "unreachable.toml", "-m", "polynomial", "--json")
    assert result.status == 3
    data = result.json
    assert set(SUMMARY_KEYS) <= data.keys()
    assert data["status"] == "infeasible"
    assert data["travel_rad"] is None
    assert data["verified"] is False


def test_a_singular_path_is_shown_for_study_only(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "study.json"
    words = ("plan", PROBLEMS / "paper-fig4.toml", "-m", "polynomial", "--out", out,
             "--set", "method.polynomial.allow_singular=true")  # fmt: skip
    result = run(*words)
    assert result.status == 0
    assert "For study only, not executable" in result.out
    data = run(*words, "--json").json
    assert data["status"] == "singular"
    assert data["verified"] is False
    assert data["executable"] is False
    assert data["peak_u_rad_s"] == [None, None]
    assert data["terminal_error_deg"] == [None, None, None]
    np.testing.assert_allclose(data["singular_times_s"], [0.3057, 2.2975, 8.6790], atol=1e-4)
    assert planner.load_plan(out).status == "singular"
    assert not planner.load_plan(out).verified


def test_check_for_people_and_as_json(run: Callable) -> None:
    words = ("check", PAPER, "--set", "goal.travel=0.82", "--set", "limits={}")
    result = run(*words, "--methods", "polynomial")
    assert result.status == 0
    assert "(0, -0.0324, 0.7113, 0.01745)" in result.out
    assert "0.78635 to 0.89664 rad" in result.out
    assert "inside the window" in result.out
    assert "There is a plan: polynomial (one way, inside the chart)." in result.out
    data = run(*words, "--methods", "polynomial", "--json").json
    assert data["has_plan"] is True
    assert data["constants"]["K"] == [0.870125, 0.711625]
    assert data["ends"]["start"]["in_chart"] is True
    assert [m["method"] for m in data["methods"]] == ["polynomial"]


def test_check_of_the_unreachable(run: Callable) -> None:
    result = run("check", PROBLEMS / "unreachable.toml", "--methods", "polynomial")
    assert result.status == 3
    assert "No plan of any kind exists: theta3 must move 29 deg" in result.out
    assert 'Change goal.duration = "free"' in result.out


def test_check_of_a_start_on_the_singularity(run: Callable) -> None:
    result = run("check", PAPER, "--set", "start.theta_deg=[1,0,1]", "--set", "limits={}",
                 "--methods", "polynomial")  # fmt: skip
    assert result.status == 3
    assert "on a singularity of the chart: theta2 = 0" in result.out


def test_a_goal_of_the_tip_for_people(run: Callable) -> None:
    found = run("plan", PROBLEMS / "tip.toml")
    assert found.status == 0
    assert re.search(r"(?m)^joints at the goal +\(28\.\d+, 33\.\d+, 24\.\d+\) deg$", found.out)
    result = run("check", PROBLEMS / "tip.toml", "--methods", "polynomial")
    assert "the tip at (0.4964, 0.6598) m; theta1, theta2, theta3 free" in result.out
    assert "0.8257 m from the base; the arm is 0.9 m long" in result.out
    assert "elbows can bend in 4 ways, the one nearest to the start" in result.out
    assert "methods in the chart need every joint at the goal" in result.out
    far = ("--set", "goal.tip_m=[-0.1,0.7]", "--set", "limits.joint_deg=50")
    none = run("check", PROBLEMS / "tip.toml", "--methods", "polynomial", *far)
    assert "none found within the limits of the joints; the nearest, 0.153 m off" in none.out


def test_listings(run: Callable) -> None:
    assert set(run("methods", "--json").json) == set(planner.METHODS)
    for name, method in planner.METHODS.items():
        assert f"{name} " in run("methods").out
        assert method.summary in run("methods").out
    systems = run("systems", "--json").json
    assert {"manipulator", "unicycle", "car"} <= systems.keys()
    assert all(systems.values())
    assert "manipulator" in run("systems").out


def test_schema_accepts_every_shipped_problem_and_no_misspelt_key(run: Callable) -> None:
    import jsonschema  # slow

    schema = run("schema").json
    validator = jsonschema.Draft202012Validator(schema)
    paths = sorted(PROBLEMS.glob("*.toml"))
    assert len(paths) >= 4
    for path in paths:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        validator.validate(data)
        assert not validator.is_valid({**data, "gaol": {}})
        assert not validator.is_valid({**data, "goal": {**data["goal"], "duratoin": 1}})


@pytest.mark.parametrize("command", ["plan", "check", "compare", "methods", "systems", "schema"])
def test_help_has_an_example_or_needs_none(command: str, run: Callable) -> None:
    result = run(command, "--help")
    assert result.status == 0
    assert "--json" in result.out
    if command in ("plan", "check", "compare"):
        assert f"planner {command} problems/paper" in result.out


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
        with pytest.raises(planner.InputError, match="cannot read the value 'x=y'"):
            parse_changes([pair])
    else:
        assert parse_changes([pair]) == {"a.b": value}


def module(command: str) -> Any:
    """The module behind a command; its name in the package is taken by the function."""
    return import_module(f"planner.cli.{command}")


def test_a_bug_is_one_short_message(run: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(module("plan"), "solve_and_check", broken)
    result = run("plan", PAPER, *SOLVED)
    assert result.status == 1
    assert result.out == ""
    assert result.err.startswith("planner: a bug in planner 0.")
    assert "ZeroDivisionError: oops. Please report it" in result.err
    assert "Traceback" not in result.err
    assert run("plan", PAPER, *SOLVED, "--json").json["status"] == "bug"
    assert "Traceback" in run("--debug", "plan", PAPER, *SOLVED).err
    monkeypatch.setenv("PLANNER_DEBUG", "1")
    assert "Traceback" in run("plan", PAPER, *SOLVED).err


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 12 GiB"), RuntimeError("std::bad_alloc 12 GiB")]
)
def test_a_lack_of_memory_is_no_bug(
    run: Callable, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def greedy(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(module("plan"), "solve_and_check", greedy)
    result = run("plan", PAPER, *SOLVED)
    assert result.status == 2
    assert result.err.startswith("planner: there is not enough memory for this (")
    assert "12 GiB); ask for less" in result.err
    assert run("plan", PAPER, *SOLVED, "--json").json["status"] == "bad_input"


def test_chatter_of_libraries_stays_off_standard_output(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = module("plan").solve_and_check

    def chatty(*words: Any, **options: Any) -> Any:
        print("a banner")
        return real(*words, **options)

    monkeypatch.setattr(module("plan"), "solve_and_check", chatty)
    result = run("plan", PAPER, *SOLVED, "--json")
    assert result.json["status"] == "solved"
    assert "a banner" in result.err


def test_ctrl_c_counts_even_when_a_solver_swallows_it(
    run: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swallowed(*_: Any, **__: Any) -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            signal.sigtimedwait([], 1)
        except KeyboardInterrupt:
            pass
        raise planner.NotConvergedError("stopped")

    monkeypatch.setattr(module("plan"), "solve_and_check", swallowed)
    result = run("plan", PAPER, *SOLVED, "--json")
    assert result.status == 130
    assert result.json["status"] == "interrupted"
    assert result.err == "planner: interrupted, nothing written\n"


def test_a_disk_that_fills_leaves_no_plan(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    result = run("plan", PAPER, *SOLVED, "--out", tmp_path / "plan.json")
    assert result.status == 2
    assert result.out == ""
    assert "plan.json: No space left on device" in result.err
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
    output = module("output")
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
