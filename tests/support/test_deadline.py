"""When a search must end: blocks with an end, solvers that hear of it, Ctrl-C."""

from __future__ import annotations

import contextvars
import signal
import threading
import time
from typing import Any

import casadi as ca
import numpy as np
import pytest

from planner import InputError
from planner.support import deadline
from planner.support.deadline import TimeUpError, time_limit, time_share
from planner.support.interrupts import hold_signals
from planner.support.solver_calls import ITERATION_S, NlpCall, call_within


def rosenbrock(size: int, iterations: int) -> NlpCall:
    """Which IPOPT solves in less than a hundred iterations; it may go on after that."""
    x = ca.MX.sym("x", size)
    f = 100 * ca.sumsqr(x[1:] - x[:-1] ** 2) + ca.sumsqr(1 - x[:-1])
    endless = {"max_iter": iterations, "tol": 1e-300, "acceptable_iter": 0}
    quiet = {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}
    options = {"print_time": False, "ipopt": {**quiet, **endless}}
    return NlpCall("ipopt", "long", {"x": x, "f": f}, options)


def test_a_time_limit_does_not_cut_a_verification_short_but_a_stop_does() -> None:
    with time_limit(1e-9):
        time.sleep(0.001)
        deadline.check_stopped()
        deadline.end(contextvars.copy_context(), "the Stop button")
        with time_limit(None), pytest.raises(TimeUpError):
            deadline.check_stopped()


def test_of_two_limits_the_earlier_counts() -> None:
    assert deadline.remaining() == np.inf
    with time_limit(100.0):
        with time_limit(1.0):
            assert deadline.remaining() <= 1.0
        with time_limit(1000.0):
            assert 1.0 < deadline.remaining() <= 100.0
        with time_share(0.5):
            assert 1.0 < deadline.remaining() <= 50.0
        with time_limit(None):
            assert 50.0 < deadline.remaining() <= 100.0
    assert deadline.remaining() == np.inf


def test_a_share_may_wait_for_something_to_finish() -> None:
    holds = [False]
    with time_limit(100.0), time_share(1e-9, condition=lambda: holds[0]):
        deadline.check()
        holds[0] = True
        with pytest.raises(TimeUpError):
            deadline.check()


def test_a_share_that_waits_is_one_of_the_share_around_it() -> None:
    holds = [False]
    with time_limit(100.0, has_answer=lambda: holds[0]):
        with time_share(0.5, condition=deadline.holds_answer):
            assert 50.0 < deadline.remaining() <= 100.0
            with time_share(0.5, condition=deadline.holds_answer):
                holds[0] = True
                assert deadline.remaining() <= 25.0
            assert 25.0 < deadline.remaining() <= 50.0
        with time_limit(None, has_answer=lambda: False):
            assert deadline.holds_answer()  # the outermost says so
    assert not deadline.holds_answer()


def test_a_share_of_processor_time_does_not_pass_by_the_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a busy computer, plans depended on what else it did."""
    wall_s, processor_s = 0.0, 0.0
    monkeypatch.setattr(time, "monotonic", lambda: wall_s)
    monkeypatch.setattr(time, "process_time", lambda: processor_s)
    with deadline.default_limit(None), time_share(0.5, condition=lambda: True):
        wall_s = 1000.0
        assert deadline.remaining() == deadline.DEFAULT_SEARCH_S / 2
        processor_s = deadline.DEFAULT_SEARCH_S / 2
        with pytest.raises(TimeUpError):
            deadline.check()


def test_what_is_cut_short_is_known_outside() -> None:
    assert not deadline.is_over()
    with time_limit(100.0) as outer, time_limit(1e-9) as limited, time_share(0.5) as share:
        with time_limit(None) as inner:
            assert deadline.is_over()
            with pytest.raises(TimeUpError):
                deadline.check()
        assert inner.was_reached
        assert share.was_reached
        assert limited.was_reached
        assert not outer.was_reached  # its own limit cuts nothing short
        assert limited.why == "the time limit of 1e-09 s"
        assert outer.why == "the time limit of 100 s"


def test_a_share_that_is_over_cuts_the_whole_block_short() -> None:
    with time_limit(100.0) as outer, time_limit(None) as search:  # noqa: SIM117
        with time_share(1e-12), time_share(0.5), pytest.raises(TimeUpError):
            deadline.check()
    assert search.was_reached
    assert outer.was_reached


def test_a_limit_of_work_reads_no_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work counts in every block around the solver, and a share of the work left is work too."""
    clock_s = 0.0
    for name in ("monotonic", "process_time"):
        monkeypatch.setattr(time, name, lambda: clock_s)
    with time_limit(None) as outer, deadline.work_limit(8.0, "work") as limited:
        clock_s = 1e6
        deadline.check()
        deadline.spend(2.0)
        with time_share(0.5) as share:
            assert deadline.remaining() == 3.0
            deadline.spend(3.0)
            with pytest.raises(TimeUpError):
                deadline.check()
        assert (share.was_reached, limited.was_reached, outer.was_reached) == (True, True, False)
        assert deadline.remaining() == 3.0
    assert outer.work == 5.0
    assert limited.why == "work"


def test_a_solver_counts_its_work_by_iterations_alone() -> None:
    solver = rosenbrock(40, 5)
    with deadline.work_limit(1.0, "work") as block:
        solver(x0=np.full(40, -1.3))
    each = ITERATION_S * 40
    assert block.work == pytest.approx(each * (solver.stats()["iter_count"] + 1))
    with pytest.raises(TimeUpError), deadline.work_limit(2.5 * each, "work") as short:
        solver(x0=np.full(40, -1.3))
    assert short.work == pytest.approx(3 * each)


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, np.inf, True, "5"])
def test_what_is_no_limit_is_refused(seconds: Any) -> None:
    with pytest.raises(InputError, match="time_limit_s"), time_limit(seconds):
        pass


def test_another_thread_has_a_limit_of_its_own() -> None:
    seen = []
    with time_limit(1e-9):
        thread = threading.Thread(target=lambda: seen.append(deadline.remaining()))
        thread.start()
        thread.join()
    assert seen == [np.inf]


def test_ipopt_ends_after_the_iteration_in_which_time_is_up() -> None:
    solver, began = rosenbrock(4000, 10**6), time.process_time()
    with pytest.raises(TimeUpError), time_limit(0.3):
        solver(x0=np.full(4000, -1.3))
    assert time.process_time() - began < 20


def test_a_solver_that_was_stopped_solves_the_next_time() -> None:
    solver, start = rosenbrock(4, 60), np.full(4, -1.3)
    whole = np.asarray(solver(x0=start)["x"])
    with pytest.raises(TimeUpError), time_limit(1e-9):
        solver(x0=start)
    np.testing.assert_array_equal(np.asarray(solver(x0=start)["x"]), whole)


def test_a_call_that_is_late_for_the_limit_is_not_lost() -> None:
    never = threading.Event()
    with pytest.raises(TimeUpError), time_limit(0.05):
        call_within(60.0, lambda: never.wait(60))
    never.set()
    assert call_within(60.0, lambda: True)


def test_ctrl_c_ends_a_search_that_holds_an_answer() -> None:
    holds = [False]
    with time_limit(None, has_answer=lambda: holds[0]) as search, time_share() as part:
        assert not deadline.stop()
        deadline.check()
        holds[0] = True
        assert not deadline.is_over()
        assert deadline.stop()
        assert deadline.is_over()
        assert part.end <= time.monotonic()
        with pytest.raises(TimeUpError):
            deadline.check()
    assert search.interrupter
    assert search.why == "Ctrl-C"
    assert 0 < search.end - time.monotonic() <= deadline.LEAST_FINISH_S
    assert not deadline.stop()


def test_after_ctrl_c_a_long_search_refines_for_a_quarter_of_its_time() -> None:
    with time_limit(None, has_answer=lambda: True) as search:
        search.start -= 100.0
        assert deadline.stop()
        assert 24.0 < deadline.remaining() <= 25.1


def test_a_handler_that_does_not_raise_lets_the_solver_go_on() -> None:
    heard = []
    signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    with hold_signals():
        signal.raise_signal(signal.SIGINT)
    assert heard == [True]


def test_another_thread_ends_what_runs_in_a_context() -> None:
    """All of it, or the search alone where that holds something to show."""
    context = contextvars.copy_context()
    seen: list[float] = []

    def search(holds: bool) -> tuple[str, bool]:
        with time_limit(100.0), time_limit(None, has_answer=lambda: holds) as span:
            asked = threading.Event()

            def other() -> None:
                if not deadline.stop(context, "the button"):
                    deadline.end(context, "the button")
                asked.set()

            threading.Thread(target=other).start()
            assert asked.wait(10)
            seen.append(deadline.remaining())
            with time_share(0.5) as inner:
                return inner.ended_by, span.was_reached

    assert context.run(search, True) == ("the button", True)
    assert context.run(search, False) == ("the button", True)
    assert 0 < seen[0] <= deadline.LEAST_FINISH_S, "time to refine what is held"
    assert seen[1] == 0
