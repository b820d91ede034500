"""Ctrl-C reaches the caller although CasADi and OSQP catch it; their chatter does not."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from types import SimpleNamespace

import casadi as ca
import numpy as np
import osqp
import pytest
import scipy.sparse as sp

from planner.machine.feedback.programme import Solver
from planner.support.interrupts import hold_signals, mute_lines, osqp_result
from planner.support.solver_calls import NlpCall


def long_solve() -> None:
    """A problem that IPOPT needs far longer for than the test lasts."""
    x = ca.MX.sym("x", 4000)
    f = 100 * ca.sumsqr(x[1:] - x[:-1] ** 2) + ca.sumsqr(1 - x[:-1])
    endless = {"max_iter": 10**6, "tol": 1e-30, "acceptable_iter": 0}
    quiet = {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}
    options = {"print_time": False, "ipopt": {**quiet, **endless}}
    NlpCall("ipopt", "long", {"x": x, "f": f}, options)(x0=np.full(4000, -1.3))


def press_ctrl_c(after_s: float) -> None:
    threading.Timer(after_s, lambda: os.kill(os.getpid(), signal.SIGINT)).start()


def test_ipopt_passes_ctrl_c_on(capsys: pytest.CaptureFixture[str]) -> None:
    press_ctrl_c(0.5)
    began = time.process_time()
    with pytest.raises(KeyboardInterrupt):
        long_solve()
    assert time.process_time() - began < 20
    assert capsys.readouterr().err == ""  # CasADi warns of an exception that it swallows


def test_an_exception_of_the_block_wins_and_the_handler_is_put_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with hold_signals():
        pass
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(ValueError, match="mine"), hold_signals():
        raise ValueError("mine")
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_may_use_it() -> None:
    done = []

    def work() -> None:
        with hold_signals():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [True]


def long_osqp() -> osqp.OSQP:
    """A programme that OSQP needs far longer for than the test lasts."""
    return programme(300, eps_abs=0.0, eps_rel=1e-300, max_iter=10**8)


def programme(size: int, **options: float) -> osqp.OSQP:
    rng = np.random.default_rng(0)
    solver = osqp.OSQP()
    given = (sp.eye(size, format="csc"), rng.normal(size=size))
    rows, low = sp.csc_matrix(rng.normal(size=(3 * size, size))), np.full(3 * size, -np.inf)
    high = rng.uniform(-0.1, 1, 3 * size)
    solver.setup(*given, rows, low, high, verbose=False, scaling=0, **options)
    return solver


def test_osqp_swallows_what_we_heed(capfd: pytest.CaptureFixture[str]) -> None:
    solver = long_osqp()
    press_ctrl_c(0.3)
    began = time.process_time()
    with pytest.raises(KeyboardInterrupt):
        osqp_result(solver)
    assert time.process_time() - began < 20
    assert capfd.readouterr().out == ""


def test_no_ctrl_c_is_lost_in_the_last_iteration() -> None:
    """Where OSQP takes it and returns as if nothing had been: one in ten of such short solves."""
    solver = programme(40, check_termination=10)
    osqp_result(solver)  # from here on each is over after ten iterations
    for _ in range(60):
        with pytest.raises(KeyboardInterrupt):
            _solve_until_interrupted(solver)


def _solve_until_interrupted(solver: osqp.OSQP) -> None:
    press_ctrl_c(0.005)
    end = time.process_time() + 10
    while time.process_time() < end:
        osqp_result(solver)


def test_other_threads_print_while_osqp_runs(capsys: pytest.CaptureFixture[str]) -> None:
    solver = long_osqp()
    threading.Timer(0.1, print, ["from elsewhere"]).start()
    press_ctrl_c(0.4)
    with pytest.raises(KeyboardInterrupt):
        osqp_result(solver)
    assert capsys.readouterr().out == "from elsewhere\n"


def test_osqp_in_a_thread_leaves_ctrl_c_to_the_main_one() -> None:
    solver, done = programme(300, eps_abs=0.0, eps_rel=1e-300, max_iter=10**8, time_limit=0.4), []
    thread = threading.Thread(target=lambda: done.append(osqp_result(solver).info.status_val))
    thread.start()
    press_ctrl_c(0.1)
    with pytest.raises(KeyboardInterrupt):
        time.sleep(20)
    thread.join(20)
    assert done
    assert done[0] != osqp.SolverStatus.OSQP_SIGINT


def test_osqp_in_two_threads_leaves_the_process_able_to_hear() -> None:
    before = handler_of_the_system()
    work = [threading.Thread(target=_often, args=(20 + k,)) for k in range(2)]
    for thread in work:
        thread.start()
    for thread in work:
        thread.join()
    assert handler_of_the_system() == before


def _often(size: int) -> None:
    solver = programme(size)
    for _ in range(300):
        osqp_result(solver)


def handler_of_the_system() -> bytes:
    """What a process really does on Ctrl-C, whatever Python believes: C's struct sigaction."""
    action = ctypes.create_string_buffer(1024)
    assert ctypes.CDLL(None).sigaction(signal.SIGINT, None, action) == 0
    return action.raw[: ctypes.sizeof(ctypes.c_void_p)]


def test_a_tracker_stops_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """And does not count OSQP as late."""
    monkeypatch.setattr(osqp.OSQP, "solve", _interrupted)
    solver = Solver(np.ones((2, 2), dtype=bool), 100)
    with pytest.raises(KeyboardInterrupt):
        solver(np.eye(2), np.array([1.0, 1.0]), np.array([2.0, 2.0]), np.zeros(2))


def _interrupted(self: osqp.OSQP, **_: object) -> SimpleNamespace:
    return SimpleNamespace(info=SimpleNamespace(status_val=osqp.SolverStatus.OSQP_SIGINT))


# -- chatter of solvers ------------------------------------------------------------------------


def test_only_lines_with_the_words_are_kept_back(capsys: pytest.CaptureFixture[str]) -> None:
    with mute_lines("secret", "private"):
        print("a")
        sys.stdout.write("private\n")
        sys.stdout.write("b\na secret\nc")
        sys.stdout.write("open end")
    assert capsys.readouterr().out == "a\nb\ncopen end"


def test_osqp_says_nothing_where_it_has_nothing_to_polish(
    capsys: pytest.CaptureFixture[str],
) -> None:
    solver, one = osqp.OSQP(), sp.csc_matrix([[1.0]])
    limits = (np.array([-1.0]), np.array([1.0]))
    solver.setup(one, np.zeros(1), one, *limits, verbose=False, polishing=True)
    osqp_result(solver)
    assert capsys.readouterr().out == ""
    solver.solve(raise_error=False)
    assert "Polishing not needed" in capsys.readouterr().out
