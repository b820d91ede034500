"""Compiled code that does not return is left behind."""

from __future__ import annotations

import os
import signal
import threading

import pytest

import planner
from planner.methods.collocation import plan_collocation
from planner.ocp import backends
from planner.ocp.watchdog import Watchdog
from planner.schema.methods import CollocationOptions


def test_a_value_or_an_error_comes_through() -> None:
    dog: Watchdog[int] = Watchdog()
    assert dog.within(10.0, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        dog.within(10.0, lambda: 1 // 0)
    assert not dog.lost


def test_after_a_call_that_does_not_return_no_other_is_made() -> None:
    dog: Watchdog[bool] = Watchdog()
    never, made = threading.Event(), []
    assert dog.within(0.05, never.wait) is None
    assert dog.lost
    assert dog.within(10.0, lambda: made.append(1) is None) is None
    assert not made
    never.set()


def test_ctrl_c_does_not_wait_for_it() -> None:
    never = threading.Event()
    timer = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        Watchdog[bool]().within(60.0, lambda: never.wait(60))
    assert timer.finished.is_set()
    never.set()


def test_where_fatrop_does_not_return_ipopt_answers(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = threading.Event()

    def never(*_: object) -> None:
        stuck.wait(60)

    monkeypatch.setattr(backends, "_fatrop_calls", Watchdog())
    monkeypatch.setattr(backends, "PATIENCE_S", 0.1)
    monkeypatch.setattr(backends, "PATIENCE_EACH_S", 0.0)
    monkeypatch.setattr(backends._Fatrop, "_answer", never)
    plan = plan_collocation(paper, CollocationOptions())
    assert planner.verify(plan).ok
    assert plan.notes["tried"][0]["start"] == "straight"
    stuck.set()
