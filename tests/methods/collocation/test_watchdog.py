"""Compiled code that does not return is left behind."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import pytest

import planner
from planner.methods.collocation import solvers
from planner.methods.collocation.method import plan_collocation
from planner.problem.tables.method_options import CollocationOptions
from planner.support.solver_calls import call_within


def _busy(until: threading.Event) -> None:
    while not until.is_set():
        sum(range(1000))


def test_a_value_or_an_error_comes_through() -> None:
    assert call_within(10.0, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        call_within(10.0, lambda: 1 // 0)


def test_a_call_that_does_not_return_is_left_and_the_next_is_made() -> None:
    done = threading.Event()
    assert call_within(0.05, lambda: _busy(done)) is None
    assert call_within(10.0, lambda: 7) == 7
    done.set()


def test_a_loaded_machine_leaves_no_call_behind() -> None:
    """What counts is the time that the processor spends, not how long that takes."""
    assert call_within(0.1, lambda: time.sleep(0.8) or 7) == 7


@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell no thread's time")
def test_work_of_other_threads_leaves_no_call_behind() -> None:
    """As that of an earlier call that was left and goes on for ever."""
    done = threading.Event()
    assert call_within(0.05, lambda: _busy(done)) is None
    try:
        assert call_within(0.3, lambda: time.sleep(1.5) or 7) == 7
    finally:
        done.set()


def test_ctrl_c_does_not_wait_for_it() -> None:
    never = threading.Event()
    timer = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        call_within(60.0, lambda: never.wait(60))
    timer.join(10.0)
    assert timer.finished.is_set()
    never.set()


def test_where_fatrop_does_not_return_ipopt_answers_and_later_answers_are_the_same(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = plan_collocation(paper, CollocationOptions())
    stuck = threading.Event()
    with monkeypatch.context() as patched:
        patched.setattr(solvers, "PATIENCE_S", 0.1)
        patched.setattr(solvers, "PATIENCE_EACH_S", 0.0)
        patched.setattr(solvers._Fatrop, "_answer", lambda *_: _busy(stuck))
        plan = plan_collocation(paper.changed({"goal.duration": 11.0}), CollocationOptions())
        assert planner.verify(plan).ok
        assert plan.notes["tried"][0]["start"] == "straight"
    stuck.set()
    after = plan_collocation(paper, CollocationOptions())
    assert after.iterations == before.iterations
    assert after.objective == before.objective
