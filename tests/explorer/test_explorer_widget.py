"""The widget's messages, as the browser sends them."""

from __future__ import annotations

from typing import Any

import pytest

import planner

pytest.importorskip("anywidget", reason="needs the extra 'notebook'")


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch, paper: planner.Problem) -> tuple[Any, list[Any]]:
    widget = planner.explore(paper.changed({"goal.travel": 0.82}), samples=2)
    messages: list[Any] = []
    monkeypatch.setattr(widget, "send", messages.append)
    return widget, messages


def test_each_question_has_one_answer_with_its_number(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._asked(widget, {"ask": "picture", "number": 1}, [])
    changes = [["goal.travel", 0.8286], ["goal.duration", 40.0]]
    widget._asked(widget, {"ask": "change", "number": 2, "changes": changes}, [])
    widget._asked(widget, {"ask": "judge", "number": 3}, [])
    widget._asked(widget, {"ask": "texts", "number": 4}, [])
    assert [m["number"] for m in messages] == [1, 2, 3, 4]
    assert messages[1]["todo"][-1:] == ["judge"]
    assert messages[2]["kind"] == "verified"
    assert "0.8286" in messages[3]["code"]
    assert widget.plan.duration == 40.0
    assert widget.problem.travel == 0.8286
    assert repr(widget).startswith("Explorer(\"the paper's example")


def test_a_message_about_a_control_that_is_gone_is_answered(sent: tuple[Any, list[Any]]) -> None:
    widget, messages = sent
    widget._asked(widget, {"ask": "change", "number": 1, "changes": [["gone", 1.0]]}, [])
    assert "no control 'gone'" in messages[0]["text"]
    assert messages[0]["panels"]
