"""Trade-off curves: each point a verified plan within its limit, kept, continued, replayed."""

import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import TradeOff, trade_off
from planner.report.figures.robustness import knee_sentence, reversals
from planner.robustness.trade_off import knee
from planner.robustness.trade_off_points import compensated_errors

SETTINGS = {"samples": 20, "intervals": 12}


@pytest.fixture(scope="module")
def two_joints(paper: planner.Problem) -> planner.Problem:
    """A small arm, quickly planned for."""
    tables = paper.to_dict()
    tables["system"] = {"kind": "manipulator", "joints": 2, "K": [0.87], "k_g": 0.67}
    tables["start"] = {"theta_deg": [0, 0]}
    tables["goal"] = {"theta_deg": [20, 40], "travel": "free", "duration": 10.0}
    tables["limits"] = {"input_rad_s": [0.5, 0.5]}
    tables["machine"] = {"step_s": 0.01}
    return planner.Problem.from_dict(tables, "two joints")


@pytest.fixture(scope="module")
def curve(two_joints: planner.Problem, tmp_path_factory: pytest.TempPathFactory) -> TradeOff:
    return trade_off(two_joints, "effort", 4, tmp_path_factory.mktemp("curve") / "e", **SETTINGS)  # type: ignore[arg-type]


@pytest.fixture
def uncompensated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points whose compensated plans, which take most of the time, are not made."""
    monkeypatch.setattr(
        "planner.robustness.trade_off.compensated_errors", lambda *_: {"refused": "not asked for"}
    )


def test_effort_curve(curve: TradeOff) -> None:
    assert len(curve.points) >= 3
    assert np.all(np.diff(curve.cost) > 0)
    assert np.all(np.diff(curve.response_deg) < 0)
    for point in curve.points:
        assert point.plan.verified
        assert planner.verify(point.plan).ok
        assert point.plan.effort <= point.limit * (1 + 1e-6)
        assert planner.sensitivity(point.plan).passive_block_deg() == pytest.approx(
            point.passive_deg
        )
    assert curve.points[-1].passive_deg < 0.5 * curve.points[0].passive_deg


def test_points_are_saved_plans_and_were_replayed(curve: TradeOff) -> None:
    assert curve.folder is not None
    index = json.loads((curve.folder / "trade-off.json").read_text())
    assert len(index["points"]) == 4
    for name, entry in index["points"].items():
        plan = planner.load_plan(curve.folder / "plans" / f"{name}.json")
        assert plan.verified
        run = planner.replay(plan, samples=20, seed=0, record_s=None)
        seen = float(np.percentile(run.terminal_E_deg, 95))
        assert entry["machine"]["end_p95_deg"] == pytest.approx(seen)


def test_design_errors_alone_show_the_total(two_joints: planner.Problem, curve: TradeOff) -> None:
    from planner.robustness.trade_off_points import errors_machine, replay_errors

    machine = errors_machine(two_joints, curve.options)
    run = replay_errors(curve.points[0].plan, machine, 800, 0)
    assert run["end_rms_deg"] == pytest.approx(curve.points[0].total_deg, rel=0.05)


def test_a_curve_goes_on_from_its_folder(
    two_joints: planner.Problem, curve: TradeOff, monkeypatch: pytest.MonkeyPatch
) -> None:
    def planned(*_: Any) -> Any:
        raise AssertionError("planned again")

    monkeypatch.setattr("planner.robustness.trade_off.solved_point", planned)
    again = trade_off(two_joints, "effort", 4, curve.folder, **SETTINGS)  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.cost, curve.cost)


@pytest.mark.usefixtures("uncompensated")
def test_an_interrupted_curve_keeps_its_points(
    two_joints: planner.Problem, curve: TradeOff, tmp_path: Path
) -> None:
    def stop(doing: str, share: float) -> None:
        if doing.startswith("point 3"):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        trade_off(two_joints, "effort", 3, tmp_path / "e", progress=stop, **SETTINGS)  # type: ignore[arg-type]
    kept = json.loads((tmp_path / "e" / "trade-off.json").read_text())["points"]
    assert list(kept) == ["00", "01"]
    done = trade_off(two_joints, "effort", 3, tmp_path / "e", **SETTINGS)  # type: ignore[arg-type]
    assert done.cost[0] == pytest.approx(kept["00"]["effort"], rel=1e-9)
    assert done.cost[0] == pytest.approx(curve.cost[0], rel=1e-4)
    again = json.loads((tmp_path / "e" / "trade-off.json").read_text())["points"]
    assert [entry["swept"] for entry in again.values()] == [2, 2, 2]


def test_another_curve_in_the_folder_is_refused(
    two_joints: planner.Problem, curve: TradeOff, tmp_path: Path
) -> None:
    with pytest.raises(planner.InputError, match="holds another trade-off"):
        trade_off(two_joints, "effort", 5, curve.folder, **SETTINGS)  # type: ignore[arg-type]
    (tmp_path / "notes.txt").touch()
    with pytest.raises(planner.InputError, match="not from an earlier run"):
        trade_off(two_joints, "effort", 4, tmp_path, **SETTINGS)  # type: ignore[arg-type]


@pytest.mark.usefixtures("uncompensated")
@pytest.mark.parametrize("kind", ["duration", "peak"])
def test_other_axes(two_joints: planner.Problem, kind: Any) -> None:
    found = trade_off(two_joints, kind, 3, **SETTINGS)  # type: ignore[arg-type]
    assert found.folder is None
    assert len(found.points) >= 2
    assert np.all(np.diff(found.response_deg) < 0)
    for point in found.points:
        if kind == "duration":
            assert point.plan.duration == pytest.approx(point.limit)
        else:
            assert np.all(point.plan.peak_u <= 0.5 * point.limit * (1 + 1e-6))


@pytest.mark.usefixtures("uncompensated")
def test_peaks_of_a_car_are_limited_each_by_its_own_key() -> None:
    car = planner.load_problem(Path(__file__).parents[2] / "problems" / "car.toml")
    (point, *_) = trade_off(car, "peak", 3, **SETTINGS).points  # type: ignore[arg-type]
    peaks = point.plan.peak_u
    assert np.all(peaks <= np.array([5.0, 0.5]) * point.limit * (1 + 1e-6))
    assert np.any(peaks > 0.9 * np.array([5.0, 0.5]) * point.limit)


def test_knee_of_a_hyperbola() -> None:
    x = np.geomspace(0.1, 10, 201)
    # the chord of 1/x over [a, 1/a] has slope -1: the tangent point is x = 1
    assert x[knee(x, 1 / x)] == pytest.approx(1.0, rel=0.03)
    assert knee(np.array([1.0, 2.0]), np.array([3.0, 3.0])) == 0


def test_picture(curve: TradeOff) -> None:
    axes = curve.plot().axes
    assert [len(ax.get_lines()) > 1 for ax in axes] == [True, True, True]
    assert "effort" in axes[0].get_xlabel()
    labels = axes[1].get_legend_handles_labels()[1]
    assert labels == ["machine, plan as it is", "machine, compensated", "design errors alone"]


def test_the_machine_is_told_with_and_without_compensation(curve: TradeOff) -> None:
    for point in curve.points:
        plain, compensated = point.machine, point.compensated
        assert plain is not None
        assert compensated is not None
        assert compensated["end_p95_deg"] < 0.7 * plain["end_p95_deg"]
    plan = planner.compensate(curve.points[-1].plan)
    run = planner.replay(plan, samples=20, seed=0, record_s=None)
    assert curve.points[-1].compensated["E_p95_deg"] == pytest.approx(run.percentile(95))  # type: ignore[index]
    frame = curve.to_frame()
    assert list(frame["compensated_E_p95_deg"]) == [
        point.compensated["E_p95_deg"]  # type: ignore[index]
        for point in curve.points
    ]


def test_a_system_that_cannot_be_compensated_says_so() -> None:
    problem = planner.load_problem(Path(__file__).parents[2] / "problems" / "unicycle.toml")
    plan = planner.solve(problem)
    assert "compensation is for arms with friction disks" in compensated_errors(
        plan, planner.Machine.ideal(), 2, 0)["refused"]  # fmt: skip


def test_a_title_tells_what_the_knee_gains(curve: TradeOff) -> None:
    def told(k: int, **figures: float) -> str:
        points = [replace(p, **figures) if i == k else p for i, p in enumerate(curve.points)]
        return knee_sentence(replace(curve, points=tuple(points)))

    first, knee = curve.points[0], curve.knee_index
    assert "gives a passive block of 0.001 deg instead of" in told(knee, passive_deg=0.001)
    assert "gives a total of" in told(knee, passive_deg=first.passive_deg)
    assert "a higher cost gains little" in knee_sentence(replace(curve, points=curve.points[:1]))
    assert [reversals(count) for count in (0, 1, 2)] == ["one way", "1 reversal", "2 reversals"]


def test_bad_arguments(two_joints: planner.Problem, paper: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match="effort, duration, peak"):
        trade_off(two_joints, "money")  # type: ignore[arg-type]
    with pytest.raises(planner.InputError, match="points = 2: "):
        trade_off(two_joints, points=2)
    with pytest.raises(planner.InputError, match="needs limits on both inputs"):
        trade_off(paper.changed({"limits": {}}), "duration")
    with pytest.raises(planner.InputError, match=r"goal\.duration"):
        trade_off(paper.changed({"goal.duration": "free"}), "effort")


def test_a_curve_is_a_frame(curve: TradeOff) -> None:
    frame = curve.to_frame()
    assert list(frame.index) == [p.limit for p in curve.points]
    assert frame.index.name == "limit"
    assert list(frame["passive_deg"]) == [p.passive_deg for p in curve.points]
    assert list(frame["peak_u2"]) == [p.peak_u[1] for p in curve.points]
    assert list(np.flatnonzero(frame["knee"])) == [curve.knee_index]
    for k, point in enumerate(curve.points):
        assert point.machine is not None
        assert frame["machine_E_p95_deg"].iloc[k] == point.machine["E_p95_deg"]
    assert not any(frame[name].dtype == object for name in frame.columns)
    assert frame.attrs["kind"] == "effort"
