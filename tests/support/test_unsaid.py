"""Solvers' chatter."""

from __future__ import annotations

import sys

import casadi as ca
import numpy as np
import pytest

from planner.support.interrupts import mute_lines


def test_only_lines_with_the_words_are_kept_back(capsys: pytest.CaptureFixture[str]) -> None:
    with mute_lines("secret", "stdout"):
        print("a")
        sys.stdout.write("a sec")
        sys.stdout.write("ret\nb")
        print("c")
        sys.stdout.write("open end")
    assert capsys.readouterr().out == "a\nbc\nopen end"


def test_casadi_s_warning_of_zero_pivots_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """It is written in several parts."""
    matrix, column = ca.MX.sym("matrix", 2, 2), ca.MX.sym("column", 2)
    solve = ca.Function("solve", [matrix, column], [ca.solve(matrix, column, "ldl")])
    with mute_lines("LDL factorization has zeros", "stderr"):
        solve(np.full((2, 2), 1e11), [1, 2])
    assert capsys.readouterr().err == ""
    solve(np.full((2, 2), 1e11), [1, 2])
    assert "LDL factorization has zeros" in capsys.readouterr().err
