import inspect
import json
import re
from pathlib import Path

import numpy as np
import pytest

import planner


@pytest.fixture(scope="module")
def plan(unlimited: planner.Problem) -> planner.Plan:
    return planner.solve(unlimited.changed({"goal.travel": 0.825}), "polynomial")


def test_round_trip_is_exact(plan: planner.Plan, tmp_path: Path) -> None:
    back = planner.load_plan(plan.save(tmp_path / "x.json"))
    t = np.linspace(-1, 11, 301)
    for name in ("q", "u", "z", "v"):
        np.testing.assert_array_equal(
            getattr(back.trajectory, name)(t), getattr(plan.trajectory, name)(t)
        )
    assert back.problem == plan.problem
    for name in ("method", "status", "objective", "solve_time_s", "verified", "notes", "options"):
        assert getattr(back, name) == getattr(plan, name)
    second = back.save(tmp_path / "y.json")
    assert second.read_bytes() == (tmp_path / "x.json").read_bytes()


def test_ends_and_travel(plan: planner.Plan) -> None:
    np.testing.assert_allclose(np.rad2deg(plan.q(0.0)[1:]), [1, 1, 1], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(plan.q(plan.duration)[1:]), [30, 30, 30], atol=1e-9)
    assert plan.travel == pytest.approx(0.825, abs=1e-12)
    assert plan.executable
    assert plan.verified


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda d: d.update(format="other"), "not a plan file"),
        (lambda d: d.update(version=99), "version 99"),
        (lambda d: d.pop("trajectory"), "missing key 'trajectory'"),
        (lambda d: d["trajectory"].update(kind="spline"), "spline"),
        (lambda d: d["trajectory"].pop("z"), "missing key 'trajectory.*z'"),
        (lambda d: d["problem"]["goal"].update(travel="x"), "goal.travel"),
    ],
)
def test_damaged_file_is_named(plan: planner.Plan, tmp_path: Path, edit: object, says: str) -> None:
    path = plan.save(tmp_path / "x.json")
    data = json.loads(path.read_text())
    edit(data)  # type: ignore[operator]
    path.write_text(json.dumps(data))
    with pytest.raises(planner.InputError, match=says):
        planner.load_plan(path)
    path.write_text("hello")
    with pytest.raises(planner.InputError, match="not JSON"):
        planner.load_plan(path)
    with pytest.raises(planner.InputError, match="cannot read"):
        planner.load_plan(tmp_path / "missing.json")


def test_plan_goes_whole_or_not_at_all(
    plan: planner.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(planner.InputError, match="No space left"):
        plan.save(tmp_path / "x.json")
    assert list(tmp_path.iterdir()) == []


def test_plans_problems_and_checks_are_short_in_a_notebook(paper: planner.Problem) -> None:
    assert repr(paper) == 'Problem("the paper\'s example, travel free", manipulator, 10 s)'
    fast = paper.changed({"goal.duration": 40.0, "goal.travel": 0.8286})
    plan = planner.solve(fast, "polynomial")
    times = np.linspace(0, 40, 40_001)
    spent, most = np.trapezoid((plan.u(times) ** 2).sum(1), times), np.abs(plan.u(times)).max(0)
    way = np.linalg.norm(np.diff(plan.theta(times), axis=0), axis=1).sum()
    figures = f"effort {spent:.4g} rad²/s, peaks {most[0]:.4g} rad/s and {most[1]:.4g} rad/s"
    assert (
        repr(plan)
        == f"Plan(polynomial: travel 0.8286 rad in 40 s, {figures}, path {way:.4g} rad, verified)"
    )
    head, objective, name = str(plan).splitlines()
    assert (head, name) == (repr(plan), f"  of {paper.name}")
    assert objective == f"  objective {plan.objective:.4g}, {plan.objective_name}"
    assert repr(planner.verify(plan)).startswith("Check(ok, largest error at the ends ")
    with pytest.raises(planner.VerificationError) as refused:
        planner.solve(paper.changed({"goal.travel": 0.82}), "polynomial")
    assert "not verified, status verification_failed" in repr(refused.value.plan)
    assert "broken: input u2 reaches 40.32 rad/s" in repr(refused.value.check)


def test_joint_angles_have_a_name_of_their_own() -> None:
    plan = planner.solve(planner.load_problem("problems/paper.toml"), "collocation")
    assert np.array_equal(plan.theta([0.0, 3.0]), plan.q([0.0, 3.0])[:, 1:])
    car = planner.solve(planner.load_problem("problems/car.toml"), "polynomial")
    with pytest.raises(planner.InputError, match=r"plan\.q\(t\)"):
        car.theta(0.0)


@pytest.mark.parametrize("name", ["q", "u", "z", "v"])
def test_outside_its_time_a_plan_rests_at_its_ends_and_warns(name: str) -> None:
    plan = planner.solve(planner.load_problem("problems/paper.toml"), "collocation")
    asked = getattr(plan, name)
    T = plan.duration
    first, last = asked([0.0, T])
    before, after = (first, last) if name in "qz" else (0 * first, 0 * last)
    for outside, ends in (
        (-0.1, before),
        (T + 0.1, after),
        ([0.0, T + 1e-6], [first, after]),
        (np.array([[-1e-6, 0.0], [T, 3 * T]]), [[before, first], [last, after]]),
    ):
        with pytest.warns(RuntimeWarning, match=r"\b0 to 10\b"):
            np.testing.assert_array_equal(asked(outside), ends)
    within = np.array([0.0, T * (1 + 1e-13), -1e-12, np.nextafter(T, np.inf)])
    np.testing.assert_array_equal(asked(within), asked([0.0, T, 0.0, T]))
    assert asked(within).shape[0] == 4
    assert asked(0.0).ndim == 1
    still = getattr(plan.trajectory, name)([-1.0, T + 1.0])  # a trajectory stays at its ends
    np.testing.assert_array_equal(still, [before, after])
    np.testing.assert_array_equal(plan.reference([-1.0, T + 1.0]), plan.q([0.0, T]))


def test_completion_offers_what_the_reference_has_first(plan: planner.Plan) -> None:
    offered = dir(plan)
    assert len(offered) <= 30
    assert all(hasattr(plan, name) for name in offered)
    fields = planner.Plan.__dataclass_fields__
    documented = re.findall(r"    def ([a-z]\w*)", inspect.getsource(planner.Plan))
    used = [name for name in plan.__dir__() if name not in fields and name != "compensates"]
    assert documented[: len(used)] == used
