"""An answer in bounded time: the best verified plan so far, or a refusal that says how far."""

from __future__ import annotations

import json
import logging
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import planner
from planner.cli import output
from planner.cli.app import main
from planner.support import deadline
from planner.support.progress import Progress
from planner.verification.summary import plan_summary

PAPER = Path(__file__).parents[1] / "problems/paper.toml"
MANY_STARTS = {"start": "wander", "starts": 50, "attempts": 50}


class Clock:
    """Time stands still until `jump`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: self.now))


@pytest.fixture(scope="module")
def hard() -> planner.Problem:
    """A random pair that takes half a minute: four joints, no travel."""
    ratio, k2 = 0.8178, 0.870125
    return planner.Problem.from_dict(
        {
            "system": {
                "kind": "manipulator",
                "joints": 4,
                "K": [k2, k2 * ratio, k2 * ratio**2],
                "k_g": 0.668811,
            },
            "start": {"theta_deg": [21.877, 48.673, 8.215, -0.562]},
            "goal": {
                "theta_deg": [-25.209, -24.391, 22.314, -64.153],
                "travel": 0.0,
                "duration": "free",
            },
            "limits": {"input_rad_s": [0.5, 0.5], "joint_deg": 80.0},
        }
    )


@pytest.fixture
def early(paper: planner.Problem, monkeypatch: pytest.MonkeyPatch) -> planner.Plan:
    """What is found by the limit, which is reached as soon as there is a motion."""
    clock = Clock(monkeypatch)

    def until_found(progress: Progress) -> None:
        if progress.best:
            clock.now = 80.0

    free = paper.changed({"goal.duration": "free"})
    return planner.solve(free, time_limit_s=100.0, progress=until_found, **MANY_STARTS)


def test_the_best_plan_so_far_is_verified_and_says_so(early: planner.Plan) -> None:
    assert early.verified
    assert early.certificate is not None
    assert early.status == "time_limit"
    assert early.notes["ended_early"].startswith("the time limit of 100 s ended the search")
    summary = plan_summary(early)
    assert (summary["status"], summary["verified"]) == ("time_limit", True)
    assert planner.verify(early).ok


def test_ctrl_c_has_the_best_plan_so_far_too(paper: planner.Problem) -> None:
    def until_found(progress: Progress) -> None:
        if progress.best:
            deadline.stop()

    free = paper.changed({"goal.duration": "free"})
    plan = planner.solve(free, progress=until_found, **MANY_STARTS)
    assert plan.verified
    assert plan.status == "interrupted"
    assert plan.notes["ended_early"].startswith("Ctrl-C ended the search")


def test_a_coarse_motion_is_made_a_plan(
    hard: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first motion is none on any finer mesh; no solver has the time to better it."""
    clock = Clock(monkeypatch)

    def until_found(progress: Progress) -> None:
        ends = {"timing": 80.0, "refining": 95.0}
        clock.now = ends.get(progress.doing.split()[0], clock.now)

    plan = planner.solve(hard, time_limit_s=100.0, progress=until_found, starts=1)
    assert plan.verified
    assert plan.status == "time_limit"


@pytest.mark.parametrize("limit", [0.05, 0.3])
def test_there_is_an_answer_in_time(hard: planner.Problem, limit: float) -> None:
    began = time.perf_counter()
    with pytest.raises(planner.TimeLimitError) as caught:
        planner.solve(hard, time_limit_s=limit)
    assert f"the time limit of {limit:g} s ended the search" in caught.value.reason
    assert caught.value.advice == deadline.MORE_TIME
    assert time.perf_counter() - began < 1.2 * limit + 2 + 15  # for a busy machine


@pytest.mark.parametrize("method", planner.METHODS)
def test_every_method_hears_of_it(paper: planner.Problem, method: str) -> None:
    free = paper.changed({"goal.travel": "free"})
    options = {"points": "auto"} if method == "polynomial" else {}
    with pytest.raises(planner.TimeLimitError) as caught:
        planner.solve(free, method, time_limit_s=1e-9, **options)
    assert caught.value.exit_status == 3
    assert caught.value.status == "time_limit"


def test_the_limit_may_stand_in_the_file(paper: planner.Problem) -> None:
    limited = paper.changed({"method.collocation.time_limit_s": 1e-9})
    with pytest.raises(planner.TimeLimitError, match="the time limit of 1e-09 s"):
        planner.solve(limited)
    plan = planner.solve(limited, time_limit_s=1000.0)
    assert plan.status == "solved"
    assert plan.options["time_limit_s"] == 1000.0


def test_without_a_limit_nothing_is_said(paper: planner.Problem) -> None:
    plan = planner.solve(paper)
    assert plan.status == "solved"
    assert "ended_early" not in plan.notes


def test_replanning_hears_of_it(paper: planner.Problem) -> None:
    warm = planner.solve(paper)
    with pytest.raises(planner.TimeLimitError):
        planner.solve(paper, warm=warm, time_limit_s=1e-9)


def test_check_tells_what_ended_it(paper: planner.Problem) -> None:
    found = planner.check(paper.changed({"goal.travel": "free"}), time_limit_s=1e-9)
    assert {o["status"] for o in found.outcomes} == {"time_limit"}
    assert found.remedy is None
    assert found.verdict.endswith("(The time limit of 1e-09 s ended the search.)")
    assert "its share of the time limit" in found.outcomes[0]["reason"]


def test_a_comparison_limits_each_method(paper: planner.Problem) -> None:
    found = planner.compare(paper, ["collocation", "collocation:time_limit_s=900"], samples=1)
    assert [row.solved for row in found.rows] == [True, True]
    cut = planner.compare(paper, ["collocation"], samples=1, time_limit_s=1e-9)
    assert "time limit" in cut.rows[0].why


def test_progress_and_log(paper: planner.Problem, caplog: pytest.LogCaptureFixture) -> None:
    told: list[Progress] = []
    with caplog.at_level(logging.INFO, logger="planner"):
        planner.solve(paper, progress=told.append)
    assert told[-1].doing == "verifying"
    assert told[-1].best is not None
    assert told[-1].solves > 0
    assert [p.seconds for p in told] == sorted(p.seconds for p in told)
    assert "verifying" in caplog.messages
    assert str(told[-1]).startswith(f"verifying; {told[-1].solves} solves, best so far")
    # With no handler of its own, warnings reach standard error where nobody set up logging.
    assert logging.getLogger("planner").handlers == []


def test_the_command_refuses_with_what_it_came_to(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["plan", str(PAPER), "--json", "--time-limit", "1e-9"]) == 3
    assert json.loads(capsys.readouterr().out)["status"] == "time_limit"
    assert main(["plan", str(PAPER), "--json", "--time-limit", "0"]) == 2
    assert "is not a time limit" in capsys.readouterr().err


def test_a_redirected_job_says_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "EVERY_S", 0.01)
    with output.waiting("planning"):
        time.sleep(0.2)
    with output.progress_bar() as tell:
        tell("replaying", 0.25)
        time.sleep(0.2)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "planner: 0 s: planning"
    assert said[-1] == "planner: 0 s: replaying, 25% of all done"
    monkeypatch.setattr(output.volume, "quiet", True)
    with output.waiting("planning"):
        time.sleep(0.1)
    assert capsys.readouterr().err == ""
