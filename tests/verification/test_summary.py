from typing import Any

import numpy as np
import pytest

import planner
from planner.verification.summary import SUMMARY_KEYS, direction, plan_summary, refusal_summary

DESIGN_KEYS = {
    "method", "status", "objective", "solve_time_s", "build_time_s", "iterations", "duration_s",
    "travel_rad", "terminal_error_deg", "peak_u_rad_s", "domain_ok", "domain_margin", "z2_max",
    "singular_times_s", "verified",
}  # fmt: skip


@pytest.fixture(scope="module")
def solved(paper: planner.Problem) -> planner.Plan:
    task = paper.changed({"goal.travel": 0.82, "limits": {}})
    return planner.solve(task, "polynomial")


def test_a_plan_has_every_key(solved: planner.Plan) -> None:
    summary = plan_summary(solved)
    assert tuple(summary) == SUMMARY_KEYS
    assert set(SUMMARY_KEYS) >= DESIGN_KEYS
    assert summary["verified"] is True
    assert summary["travel_rad"] == pytest.approx(0.82)
    assert summary["duration_s"] == 10.0
    assert len(summary["terminal_error_deg"]) == 3
    assert np.max(np.abs(summary["terminal_error_deg"])) < 1e-3
    assert set(summary["terminal_error"]) == {"phi2", "theta1", "theta2", "theta3"}
    assert summary["peak_u_rad_s"][1] == pytest.approx(40, rel=0.02)
    assert summary["domain_ok"] is True
    assert 0 < summary["domain_margin"] <= np.sin(np.deg2rad(1)) ** 2 + 1e-12
    assert summary["z2_max"] == pytest.approx(-0.0324, abs=1e-4)
    assert summary["singular_times_s"] == []
    assert summary["direction"] == "one way"
    assert summary["violations"] == []


def refusal(problem: planner.Problem, **options: Any) -> planner.NoPlanError:
    with pytest.raises(planner.NoPlanError) as caught:
        planner.solve(problem, "polynomial", **options)
    return caught.value


def test_a_refused_path_is_described_but_never_verified(paper: planner.Problem) -> None:
    error = refusal(paper.changed({"goal.travel": 0.82}))
    summary = refusal_summary(error, "polynomial")
    assert tuple(summary) == SUMMARY_KEYS
    assert summary["verified"] is False
    assert summary["status"] == "verification_failed"
    assert summary["peak_u_rad_s"][1] > 0.5
    assert summary["violations"][0]["label"] == "input u2"
    assert summary["violations"][0]["limit"] == 0.5
    assert "rad/s" in summary["violations"][0]["text"]
    assert summary["advice"]


def test_a_singular_path_has_its_times(paper: planner.Problem) -> None:
    summary = refusal_summary(refusal(paper.changed({"goal.travel": np.pi / 4})), "polynomial")
    assert summary["status"] == "singular"
    assert summary["domain_ok"] is False
    assert len(summary["singular_times_s"]) >= 2
    assert np.all(np.isnan(summary["peak_u_rad_s"]))


def test_a_refusal_without_a_path_has_the_keys_and_nothing_made_up(paper: planner.Problem) -> None:
    error = refusal(paper.changed({"goal.duration": 1.0}))
    assert error.plan is None
    summary = refusal_summary(error, "polynomial")
    assert tuple(summary) == SUMMARY_KEYS
    known = {key for key, value in summary.items() if value not in (None, [])}
    assert known == {"method", "status", "verified", "reason", "advice"}


def test_direction_counts_turns(paper: planner.Problem, solved: planner.Plan) -> None:
    assert direction(solved) == "one way"
    task = paper.changed({"goal.travel": 0, "limits": {}})
    assert direction(planner.solve(task, "polynomial", allow_singular=True)) == "turns once"
