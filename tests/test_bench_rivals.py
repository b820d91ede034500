"""The collocation benchmark judges answers by itself, and says which rivals are not there."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from planner import Problem

sys.path.append(str(Path(__file__).parent / "benchmarks"))

import collocation
import frameworks
from bench_cases import cases


def test_an_answer_passes_only_if_its_inputs_lead_to_the_goal_within_limits(paper: Problem) -> None:
    outcome = collocation.ours(cases()[0])()
    goal, over = collocation.judged(paper, outcome)
    assert goal < collocation.GOAL_TOLERANCE
    assert over <= collocation.LIMIT_TOLERANCE
    astray = replace(outcome, inputs=1.001 * outcome.inputs)
    assert collocation.judged(paper, astray)[0] > collocation.GOAL_TOLERANCE
    narrow = paper.changed({"limits.input_rad_s": [0.5, 0.12]})
    assert collocation.judged(narrow, outcome)[1] > 0.01


def test_frameworks_that_are_not_installed_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frameworks, "find_spec", lambda name: None if name == "mpopt" else name)
    assert frameworks.missing() == ["mpopt"]
    assert list(frameworks.frameworks(cases()[0].arm)) == [
        "rockit + IPOPT",
        "rockit + Fatrop",
        "do-mpc + IPOPT",
    ]
