"""An answer in bounded time: the best verified plan so far, or a refusal that says how far."""

from __future__ import annotations

import json
import logging
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import main

import planner
from planner import chained_form
from planner.cli import output
from planner.cli.output import Job, keep_best_on_interrupt
from planner.explorer.outcome import path
from planner.explorer.state import State
from planner.machine.feedforward import follow
from planner.methods.collocation import best
from planner.methods.collocation.transcription import transcription
from planner.methods.judgement import judge_plan
from planner.methods.laws import scores
from planner.support import deadline
from planner.support.calculus.bernstein import Bernstein
from planner.support.progress import Progress
from planner.verification.summary import plan_summary

PAPER = Path(__file__).parents[1] / "problems/paper.toml"
MANY_STARTS = {"start": "wander", "starts": 50, "attempts": 50}


class Clock:
    """Time stands still until `jump`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        clock = SimpleNamespace(monotonic=lambda: self.now, process_time=lambda: self.now)
        monkeypatch.setattr(deadline, "time", clock)


@pytest.fixture(scope="module")
def hard() -> planner.Problem:
    """A random pair that takes half a minute: four joints, no travel."""
    start, goal = [21.877, 48.673, 8.215, -0.562], [-25.209, -24.391, 22.314, -64.153]
    limits = {"input_rad_s": 0.5, "joint_deg": 80}
    return planner.Problem.manipulator(start, goal, travel=0.0, duration=None, **limits)  # type: ignore[arg-type]


def test_the_best_plan_so_far_is_verified_and_says_so(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit is reached as soon as there is a motion."""
    clock = Clock(monkeypatch)

    def until_found(progress: Progress) -> None:
        if progress.best:
            clock.now = 80.0

    free = paper.changed({"goal.duration": "free"})
    early = planner.solve(free, time_limit_s=100.0, progress=until_found, **MANY_STARTS)
    assert early.verified
    assert early.certificate is not None
    assert early.status == "time_limit"
    assert early.notes["ended_early"].startswith("the time limit of 100 s ended the search")
    summary = plan_summary(early)
    assert (summary["status"], summary["verified"]) == ("time_limit", True)
    assert planner.verify(early).ok


def test_a_search_without_a_limit_ends_by_itself(
    hard: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(deadline, "DEFAULT_SEARCH_S", 0.5)
    with pytest.raises(planner.TimeLimitError, match=r"the default limit of 0\.5 s of processor"):
        planner.solve(hard, "collocation", start="wander")
    plan = planner.solve(planner.load_problem(PAPER), "collocation", time_limit_s=60.0)
    assert plan.status == "solved"  # a limit that is given takes its place


def test_ctrl_c_has_the_best_plan_so_far_too(paper: planner.Problem) -> None:
    def until_found(progress: Progress) -> None:
        if progress.best:
            deadline.stop()

    free = paper.changed({"goal.duration": "free"})
    plan = planner.solve(free, progress=until_found, **MANY_STARTS)
    assert plan.verified
    assert plan.status == "interrupted"
    assert plan.notes["ended_early"].startswith("Ctrl-C ended the search")


@pytest.mark.parametrize(("status", "advised"), [("interrupted", False), ("time_limit", True)])
def test_a_plan_that_is_not_fine_enough_says_what_ended_its_search(
    paper: planner.Problem, status: str, advised: bool
) -> None:
    narrow = paper.changed({"limits.joint_deg": 31})  # its theta1 goes to 38 degrees
    found = planner.solve(paper)
    notes = {"ended_early": "something ended the search"}
    coarse = replace(found, problem=narrow, status=status, notes=notes)
    with pytest.raises(planner.TimeLimitError) as refusal:
        judge_plan(coarse)
    assert refusal.value.status == status
    assert refusal.value.plan is not None
    assert refusal.value.plan.status == status
    assert (refusal.value.advice is not None) == advised


def test_motions_that_there_is_no_time_to_refine_are_refused_for_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    posts = planner.load_problem(PAPER.with_name("obstacle.toml"))
    assert planner.solve(posts, attempts=1).verified
    monkeypatch.setattr(best, "REFINING_SHARE", 0.0)
    with pytest.raises(planner.TimeLimitError) as refusal:
        planner.solve(posts, attempts=1)
    assert refusal.value.plan is not None
    assert refusal.value.advice is not None
    with pytest.raises(planner.NotConvergedError) as too_short:  # without a motion it says why
        planner.solve(posts.changed({"goal.duration": 3.3}), attempts=1)
    assert too_short.value.violations


def test_ctrl_c_ends_the_searches_among_posts_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """The posts are met: a search without them is followed by searches with them."""
    monkeypatch.setattr(deadline, "LEAST_FINISH_S", 0.001)
    endless = {"start": "wander", "starts": 4000, "attempts": 4000}
    posts = planner.load_problem(PAPER.with_name("obstacle.toml"), {"method.collocation": endless})
    pressed = False

    def until_found(progress: Progress) -> None:
        nonlocal pressed
        pressed = pressed or deadline.stop()

    with pytest.raises(planner.NoPlanError, match="Ctrl-C ended the search") as refused:
        planner.solve(posts, "collocation", time_limit_s=60.0, progress=until_found)
    assert pressed
    assert refused.value.status == "interrupted"


def test_a_coarse_motion_is_made_a_plan(
    hard: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first motion is none on any finer mesh; no solver has the time to better it."""
    clock = Clock(monkeypatch)

    def until_found(progress: Progress) -> None:
        ends = {"timing": 80.0, "refining": 95.0}
        clock.now = ends.get(progress.doing.split()[0], clock.now)

    coarse = {"starts": 1, "intervals": 30, "degree": 2}
    plan = planner.solve(hard, time_limit_s=100.0, progress=until_found, **coarse)
    assert plan.verified
    assert plan.status == "time_limit"


@pytest.mark.parametrize("limit", [0.05, 0.3])
def test_there_is_an_answer_in_time(hard: planner.Problem, limit: float) -> None:
    began = time.process_time()  # so that a busy machine does not count
    with pytest.raises(planner.TimeLimitError) as caught:
        planner.solve(hard, time_limit_s=limit)
    assert f"the time limit of {limit:g} s ended the search" in caught.value.reason
    assert caught.value.advice == deadline.time_advice()
    assert time.process_time() - began < 1.2 * limit + 2


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


def test_replanning_hears_of_it(paper: planner.Problem) -> None:
    warm = planner.solve(paper)
    elsewhere = paper.changed({"goal.theta_deg": [20.0, 25.0, 30.0]})
    with pytest.raises(planner.TimeLimitError):
        planner.solve(elsewhere, warm=warm, time_limit_s=1e-9)
    held = planner.solve(paper.changed({"goal.duration": 15.0}), warm=warm, time_limit_s=1e-9)
    assert (held.status, held.verified, held.duration) == ("time_limit", True, 15.0)


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
        plan = planner.solve(paper, progress=told.append)
    assert plan.status == "solved"
    assert "ended_early" not in plan.notes
    assert told[-1].doing == "verifying"
    assert told[-1].best is not None
    assert told[-1].solves > 0
    assert [p.seconds for p in told] == sorted(p.seconds for p in told)
    assert "verifying" in caplog.messages
    held = f"verifying; {told[-1].solves} solves, motion found (effort 0.3358)"
    assert str(told[-1]).startswith(held)


def test_the_command_says_that_ctrl_c_takes_what_is_held() -> None:
    notice, progress = Job("planning"), Progress("refining", 3.0, 5, "effort 0.101")
    notice.hear(progress)
    assert "Ctrl-C" not in notice.line
    with keep_best_on_interrupt():
        notice.hear(replace(progress, best=None))
        assert "Ctrl-C" not in notice.line
        notice.hear(progress)
    assert "motion found (effort 0.101), 3 s; Ctrl-C verifies and returns it" in notice.line


def test_warnings_reach_standard_error_where_nobody_set_up_logging() -> None:
    """With no handler of its own."""
    assert logging.getLogger("planner").handlers == []


def test_the_command_refuses_with_what_it_came_to(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(PAPER), "--json", "--time-limit", "1e-9"]) == 3
    assert json.loads(capsys.readouterr().out)["status"] == "time_limit"
    assert main(["plan", str(PAPER), "--json", "--time-limit", "0"]) == 2
    assert "time_limit_s" in capsys.readouterr().err


def test_a_redirected_job_says_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "LOG_INTERVAL_S", 0.01)
    with output.job("planning"):
        time.sleep(0.2)
    with output.job() as tell:
        tell("replaying", 0.25)
        time.sleep(0.2)
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "planner: 0 s: planning"
    assert said[-1] == "planner: 0 s: replaying, 25% done"
    monkeypatch.setattr(output.manner, "quiet", True)
    with output.job("planning"):
        time.sleep(0.1)
    assert capsys.readouterr().err == ""


LATE = "the time limit of 100 s ended the call before the plan was compensated"


@pytest.fixture
def both(paper: planner.Problem) -> planner.Problem:
    """To be planned and then compensated."""
    return paper.changed({"compensation.on": True})


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is time for a plan, and none is left for its compensation."""
    clock, usual = Clock(monkeypatch), follow.follow

    def up(*given: object) -> object:
        clock.now += 100.1
        return usual(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(follow, "follow", up)


@pytest.mark.usefixtures("late")
def test_compensation_has_no_time_of_its_own(both: planner.Problem) -> None:
    plan = planner.solve(both, time_limit_s=100.0)
    assert plan.verified
    assert plan.compensation is None
    assert plan.status == "time_limit"
    assert plan.notes["ended_early"] == LATE


@pytest.mark.usefixtures("late")
def test_nor_has_it_with_the_limit_in_the_file(both: planner.Problem) -> None:
    plan = planner.solve(both.changed({"method.collocation.time_limit_s": 100}))
    assert (plan.status, plan.compensation) == ("time_limit", None)


@pytest.mark.usefixtures("late")
def test_nor_in_a_comparison(paper: planner.Problem) -> None:
    (row,) = planner.compare(paper, ["collocation compensated"], samples=1, time_limit_s=100.0).rows
    assert row.solved
    assert row.why == LATE


@pytest.mark.usefixtures("late")
def test_nor_in_a_sweep(paper: planner.Problem, tmp_path: Path) -> None:
    tables = {"problem": paper, "methods": ["collocation compensated:time_limit_s=100"]}
    database = tmp_path / "db.sqlite"
    planner.run_sweep({**tables, "grid": {"limits.joint_deg": [80]}}, database, workers=0)
    (row,) = planner.load_sweep(database).to_dict("records")
    assert (row["solved"], row["status"], row["why"]) == (True, "time_limit", LATE)


@pytest.mark.usefixtures("late")
def test_nor_in_the_explorer(both: planner.Problem) -> None:
    outcome = path(State.from_problem(both, "collocation", 0, 100.0))
    assert outcome.kind == "verified"
    assert outcome.plan is not None
    assert outcome.plan.notes["ended_early"] == LATE


@pytest.mark.usefixtures("late")
def test_the_command_says_that_the_plan_is_not_compensated(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["plan", str(PAPER), "--set", "compensation.on=true", "--time-limit", "100"]
    assert main(words) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"{LATE[0].upper()}{LATE[1:]}; more time" in shown
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["status"], told["verified"]) == ("time_limit", True)
    assert told["notes"]["ended_early"] == LATE


def test_a_search_leaves_time_for_compensation(
    both: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Planning ends at 75 of 100 s, its search at 75 % of that, if it holds a motion by then."""
    clock = Clock(monkeypatch)

    def until_found(progress: Progress) -> None:
        if progress.best:
            clock.now = 60.0

    free = both.changed({"goal.duration": "free"})
    few = {"start": "wander", "starts": 4, "attempts": 4}
    plan = planner.solve(free, time_limit_s=100.0, progress=until_found, **few)
    assert plan.verified
    assert plan.compensation is not None
    assert plan.notes["ended_early"].startswith("the time limit of 100 s ended the search")


def test_ctrl_c_while_compensating_loses_nothing(
    both: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = follow.follow

    def pressed(*given: object) -> object:
        assert deadline.stop()
        return usual(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(follow, "follow", pressed)
    plan = planner.solve(both)
    assert plan.verified
    assert plan.status == "interrupted" or plan.compensation is not None  # if that was done in time


def _straight(x: np.ndarray) -> tuple[Bernstein, Bernstein]:
    """Candidates of three joints; which do not matter here."""
    breaks = np.array([0.0, 1.0])
    values = np.repeat(x[None, None], 2, axis=0)
    return Bernstein(values * [1.0, -1.0, 1.0, 1.0], breaks), Bernstein(values * [1.0, 0.0], breaks)


def test_candidates_are_scored_only_while_there_is_time(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, parts, usual = Clock(monkeypatch), [], scores.score

    def slow(problem: planner.Problem, curves: scores.Curves, places: np.ndarray) -> scores.Scores:
        parts.append(curves[0].c.shape[2])
        clock.now += 1.0
        return usual(problem, curves, places)

    monkeypatch.setattr(scores, "score", slow)
    monkeypatch.setattr(scores, "CALL_S", 2.5 * 200 * chained_form(paper.system).point_s)
    with pytest.raises(deadline.TimeUpError), deadline.time_limit(2.5):
        scores.score_candidates(paper, _straight, np.full((10, 1), 0.1))
    assert parts == [2, 2, 2]


def test_samples_go_through_the_chart_a_part_at_a_time(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = np.linspace(0.1, 0.4, 3)[:, None]
    whole = scores.score_candidates(paper, _straight, x)
    monkeypatch.setattr(scores, "CALL_S", 0.0)
    parts = scores.score_candidates(paper, _straight, x)
    assert whole.inside.all()
    for name in ("margin", "slack", "peak"):
        assert str(getattr(parts, name)) == str(getattr(whole, name))


def test_a_transcription_is_built_only_while_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of four joints and their response, which no other test builds."""
    clock, steps = Clock(monkeypatch), []
    usual = transcription.ca.cse

    def slow(given: object) -> object:
        steps.append(1)
        clock.now = 101.0
        return usual(given)

    monkeypatch.setattr(transcription.ca, "cse", slow)
    with pytest.raises(planner.TimeLimitError, match="the time limit of 100 s"):
        planner.solve(arm(4), "desensitised", time_limit_s=100.0, intervals=7)
    assert steps == [1]


def arm(joints: int) -> planner.Problem:
    """Joints as in problems/four-joint.toml."""
    ends, limits = ([1] * joints, [30] * joints), {"input_rad_s": 0.5, "joint_deg": 80}
    return planner.Problem.manipulator(*ends, duration=60.0, **limits)  # type: ignore[arg-type]


@pytest.mark.parametrize("on", [False, True])
@pytest.mark.parametrize(
    ("joints", "limit"),
    [
        (8, 0.01),
        pytest.param(3, 0.01, marks=pytest.mark.campaign),
        *(pytest.param(n, s, marks=pytest.mark.campaign) for n in (5, 8) for s in (0.3, 3.0)),
    ],
)
@pytest.mark.parametrize("method", planner.METHODS)
def test_every_method_keeps_the_promise(method: str, joints: int, limit: float, on: bool) -> None:
    """In time of the processor, so that a busy machine does not count."""
    problem = arm(joints).changed({"compensation.on": on})
    began = time.process_time()
    with suppress(planner.NoPlanError):
        assert planner.solve(problem, method, time_limit_s=limit).verified
    assert time.process_time() - began < 1.2 * limit + 2
