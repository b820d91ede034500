"""The widget's messages, as the browser sends them."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import planner
from planner import METHODS
from planner.support import deadline
from planner.support.progress import Progress
from planner.verification import verdict

ROOT = Path(__file__).parents[2]

worker = pytest.importorskip("planner.explorer.widget", reason="needs the extra 'notebook'").worker


def done() -> None:
    """Wait until what was asked is answered."""
    worker().do(lambda: None).result(60)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch, paper: planner.Problem) -> tuple[Any, list[Any]]:
    widget = planner.explore(paper.changed({"goal.travel": 0.82}), "polynomial", samples=2)
    messages: list[Any] = []
    monkeypatch.setattr(widget, "send", lambda m: None if "heard" in m else messages.append(m))
    return widget, messages


def test_a_request_is_confirmed_before_it_is_worked_on(
    monkeypatch: pytest.MonkeyPatch, paper: planner.Problem
) -> None:
    """Also while another takes long: a page that hears nothing says that the kernel is gone."""
    widget, free, messages = planner.explore(paper), threading.Event(), list[Any]()
    monkeypatch.setattr(widget, "send", messages.append)
    earlier = worker().do(lambda: free.wait(60))
    try:
        widget._hear(widget, {"ask": "picture", "number": 8}, [])
        assert messages == [{"number": 8, "heard": True}]
    finally:
        free.set()
    earlier.result(60)
    done()
    assert [m["number"] for m in messages] == [8, 8]


def test_each_question_has_one_answer_with_its_number(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._hear(widget, {"ask": "picture", "number": 1}, [])
    changes = [["goal.travel", 0.8286], ["goal.duration", 40.0]]
    widget._hear(widget, {"ask": "change", "number": 2, "changes": changes}, [])
    widget._hear(widget, {"ask": "judge", "number": 3}, [])
    widget._hear(widget, {"ask": "texts", "number": 4}, [])
    done()
    assert [m["number"] for m in messages] == [1, 2, 3, 4]
    assert messages[1]["todo"][-1:] == ["judge"]
    assert messages[2]["kind"] == "verified"
    assert "0.8286" in messages[3]["code"]
    assert widget.plan.duration == 40.0
    assert widget.problem.travel == 0.8286
    assert repr(widget).startswith("Explorer(\"the paper's example")


def test_the_second_plan_and_the_errors_are_asked_for(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    for number, what in enumerate(("picture", "errors", "second")):
        widget._hear(widget, {"ask": what, "number": number}, [])
    done()
    picture, errors, second = messages
    assert picture["todo"][0] == "errors"
    assert errors["error"]["id"] == "error"
    assert second["second"]["label"] == "collocation"
    assert second["second"]["kind"] == "verified"
    assert "kind" not in second, "the verdict on the screen stays"


def test_it_begins_with_a_plan_that_is_solved(paper: planner.Problem) -> None:
    assert planner.explore(paper, samples=0).plan.verified


def test_an_unknown_question_is_not_answered_by_a_picture(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._hear(widget, {"ask": "weather", "number": 1}, [])
    done()
    assert messages[0]["kind"] == "a bug"
    assert "asks for 'weather', which the explorer does not know" in messages[0]["text"]


def test_a_message_about_a_control_that_is_gone_is_answered(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._hear(widget, {"ask": "change", "number": 1, "changes": [["gone", 1.0]]}, [])
    done()
    assert "no control 'gone'" in messages[0]["text"]
    assert messages[0]["panels"]


def test_another_method_brings_its_controls_before_its_plan(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._hear(widget, {"ask": "change", "number": 1, "changes": [["method", "convex"]]}, [])
    done()
    first, last = messages
    assert first.keys() == {"number", "controls", "more"}
    assert any(c["name"].startswith("method.convex.") for c in first["controls"])
    assert not any(c["name"].startswith("method.polynomial.") for c in first["controls"])
    assert "more" not in last
    assert last["panels"]


@pytest.mark.parametrize("at_once", [True, False])
def test_stop_ends_the_search(
    sent: tuple[Any, list[Any]], monkeypatch: pytest.MonkeyPatch, at_once: bool
) -> None:
    """A method that would go on for ever, and asks for the time as methods do."""
    widget, messages = sent
    begun = threading.Event()

    def endless(problem: planner.Problem, options: Any) -> planner.Plan:
        begun.set()
        while True:
            deadline.check()
            time.sleep(0.001)

    entry = replace(METHODS["convex"], plan=endless)
    monkeypatch.setitem(METHODS, "convex", entry)  # type: ignore[index]
    widget._hear(widget, {"ask": "change", "number": 7, "changes": [["method", "convex"]]}, [])
    assert begun.wait(60)
    widget._hear(widget, {"ask": "stop", "number": 7, "at_once": at_once}, [])
    done()
    assert (messages[-1]["number"], messages[-1]["kind"]) == (7, "stopped")
    assert "the Stop button ended the method 'convex'" in messages[-1]["text"]


def test_stop_ends_the_verification_and_the_path_stays(
    sent: tuple[Any, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Proofs that would go on for ever, and ask as those of many intervals do."""
    widget, messages = sent
    begun = threading.Event()

    def endless(_: planner.Plan) -> None:
        begun.set()
        while True:
            deadline.check_stopped()
            time.sleep(0.001)

    widget._hear(widget, {"ask": "change", "number": 1, "changes": [["goal.travel", 0.8286]]}, [])
    done()
    monkeypatch.setattr(verdict, "certify", endless)
    widget._hear(widget, {"ask": "change", "number": 2, "changes": [["goal.duration", 40.0]]}, [])
    widget._hear(widget, {"ask": "judge", "number": 3}, [])
    assert begun.wait(60)
    widget._hear(widget, {"ask": "stop", "number": 3, "at_once": False}, [])
    done()  # without a stop never
    assert (messages[-1]["number"], messages[-1]["kind"]) == (3, "stopped")
    assert "the Stop button ended the verification" in messages[-1]["text"]
    assert widget._screen.outcome.plan is not None
    with pytest.raises(planner.NoPlanError, match="ended the verification"):
        _ = widget.plan


def test_the_mechanism_is_drawn_for_the_constants_on_the_screen(
    sent: tuple[Any, list[Any]],
) -> None:
    widget, messages = sent
    widget._hear(widget, {"ask": "picture", "number": 1}, [])
    widget._hear(widget, {"ask": "mechanism", "number": 2}, [])
    widget._hear(widget, {"ask": "change", "number": 3, "changes": [["system.K:0", 0.9]]}, [])
    done()
    first, drawing, changed = messages
    assert "<svg" in drawing["mechanism"]
    assert drawing["drawn"] == first["system"] != changed["system"]


def test_stop_ends_what_has_not_begun_and_nothing_else(sent: tuple[Any, list[Any]]) -> None:
    """Another explorer plans; this one's question waits, and its settings are not lost."""
    widget, messages = sent
    begun, go_on = threading.Event(), threading.Event()

    def other() -> float:
        begun.set()
        assert go_on.wait(60)
        return deadline.remaining()

    another = worker().do(other)
    assert begun.wait(60)
    widget._hear(widget, {"ask": "change", "number": 1, "changes": [["method", "convex"]]}, [])
    widget._hear(widget, {"ask": "stop", "number": 1}, [])
    go_on.set()
    assert another.result(60) == math.inf
    done()
    assert messages[-1]["kind"] == "stopped"
    assert widget._screen.state.method == "convex"


def test_stop_keeps_the_best_plan_found_by_then() -> None:
    """Collocation, which then answers with what it has; another thread ends it."""
    problem = planner.load_problem(ROOT / "problems/paper.toml", {"goal.duration": "free"})
    options = {"start": "wander", "starts": 50, "attempts": 50}

    heard = threading.Event()

    def until_found(progress: Progress) -> None:
        if progress.best:
            heard.set()

    asked = worker().do(lambda: planner.solve(problem, progress=until_found, **options))
    assert heard.wait(60)
    worker().stop(asked, at_once=False)
    found = asked.result(120)
    assert found.verified
    assert found.notes["ended_early"].startswith("the Stop button ended the search")


def test_python_can_end_while_the_explorer_plans() -> None:
    code = f"""
import time, planner
from planner.explorer.widget import worker
search = {{"start": "wander", "starts": 50, "attempts": 50}}
problem = planner.load_problem({str(ROOT / "problems/obstacle.toml")!r},
                               {{"method.collocation": search}})
worker().do(lambda: planner.solve(problem))
time.sleep(1.0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
