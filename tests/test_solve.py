import numpy as np
import pytest

import planner
from planner.methods.judgement import judge_plan


def test_a_law_that_breaks_a_limit_is_refused_with_its_last_iterate(paper: planner.Problem) -> None:
    with pytest.raises(planner.VerificationError) as info:
        planner.solve(paper.changed({"goal.travel": 0.82}), "polynomial")
    error = info.value
    assert error.plan is not None
    assert not error.plan.verified
    assert error.plan.status == "verification_failed"
    assert error.violations[0].label == "input u2"
    assert error.violations[0].value == pytest.approx(40.3, abs=0.1)
    assert "input u2 reaches 40.3" in str(error)


def test_the_advised_duration_works(paper: planner.Problem) -> None:
    problem = paper.changed({"goal.travel": 0.825})
    with pytest.raises(planner.VerificationError) as info:
        planner.solve(problem, "polynomial")
    assert info.value.advice is not None
    seconds = float(info.value.advice.split("goal.duration = ")[1].split()[0])
    plan = planner.solve(problem.changed({"goal.duration": seconds}), "polynomial")
    assert plan.verified


def test_free_duration_meets_the_input_limit_exactly(paper: planner.Problem) -> None:
    problem = paper.changed({"goal.travel": 0.825, "goal.duration": "free"})
    plan = planner.solve(problem, "polynomial")
    peak = np.max(np.abs(plan.u(np.linspace(0, plan.duration, 5001))))
    assert peak == pytest.approx(0.5, rel=1e-6)


def test_outside_the_domain_is_refused_with_times(unlimited: planner.Problem) -> None:
    problem = unlimited.changed({"goal.travel": float(np.pi / 4)})
    with pytest.raises(planner.SingularError) as info:
        planner.solve(problem, "polynomial")
    assert len(info.value.times_s) == 3  # z2 = 0 twice, and the last exit through theta1 = 0
    assert f"{info.value.times_s[0]:.4f}" in str(info.value)
    assert info.value.plan is not None
    assert info.value.times_s == info.value.plan.domain.singular_times_s
    assert not info.value.plan.executable
    plan = planner.solve(problem, "polynomial", allow_singular=True)  # for study
    assert (plan.status, plan.verified, plan.executable) == ("singular", False, False)


@pytest.mark.parametrize(
    ("method", "options", "says"),
    [
        ("polynomail", {}, "did you mean 'polynomial'"),
        ("polynomial", {"point": [[5.0, -0.2]]}, "did you mean 'points'"),
        ("polynomial", {"allow_singular": 1}, "allow_singular"),
        ("polynomial", {"points": [[12.0, -0.2]]}, "not inside the motion"),
        ("polynomial", {"points": [[5.0, -0.2], [5.0, -0.3]]}, "two points at one time"),
    ],
)
def test_bad_requests_are_named(
    unlimited: planner.Problem, method: str, options: dict[str, object], says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.solve(unlimited.changed({"goal.travel": 0.82}), method, **options)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"start.theta_deg": [0, 1, 1]}, "start .*theta1 = 0"),
        ({"goal.theta_deg": [30, 0, 30]}, "goal .*theta2 = 0"),
        ({"start.theta_deg": [1, -1, 1]}, "theta2 changes sign"),
    ],
)
def test_ends_off_the_chart_are_refused(
    unlimited: planner.Problem, changes: dict[str, object], says: str
) -> None:
    with pytest.raises(planner.SingularError, match=says) as info:
        planner.solve(unlimited.changed({"goal.travel": 0.82, **changes}), "polynomial")
    assert "collocation" in {change.method for change in info.value.changes}


@pytest.mark.parametrize("method", ["collocation", "desensitised"])
def test_a_method_is_not_advised_in_place_of_itself(paper: planner.Problem, method: str) -> None:
    narrow = paper.changed({"limits.joint_deg": 31})  # its theta1 goes to 38 degrees
    plan = planner.Plan(narrow, method, {}, planner.solve(paper).trajectory)
    with pytest.raises(planner.VerificationError) as refusal:
        judge_plan(plan)
    ways = [change.method for change in refusal.value.changes]
    assert ways == ([] if method == "collocation" else ["collocation"])
