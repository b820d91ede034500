"""Places that lie on a limit but for rounding, and measured ones but for an encoder's noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import planner

FULL_REACH = {
    "system": {
        "kind": "manipulator",
        "joints": 3,
        "K": [0.870125, 0.711625],
        "k_g": 0.668811,
        "link_lengths": [0.4, 0.3, 0.2],
    },
    "start": {"theta_deg": [10, 10, 10]},
    "goal": {"tip_m": [0.9, 0.0], "duration": 10.0},
    "limits": {"input_rad_s": [0.5, 0.5], "joint_deg": 80},
}


@pytest.mark.parametrize("method", ["collocation", "polynomial", "convex"])
def test_a_goal_that_rounding_puts_beyond_a_limit_is_planned(
    paper: planner.Problem, method: str
) -> None:
    over = np.nextafter(30.0, 31.0)
    limit = {"limits.joint_deg": [80.0, 30.0, 80.0], "limits.input_rad_s": 1000.0}
    for goal in (30.0, over, 30.0 * (1 + 5e-10)):
        problem = paper.changed({**limit, "goal.theta_deg": [30, goal, 30]})
        assert planner.solve(problem, method).verified


def test_a_goal_beyond_its_limit_is_refused_with_digits_that_differ(
    paper: planner.Problem,
) -> None:
    for goal, said in ((30.001, "30.001"), (30.0000003, "30.0000003")):
        with pytest.raises(planner.InputError, match=f"= {said} deg .* 30"):
            paper.changed({"limits.joint_deg": 30.0, "goal.theta_deg": [goal, 30, 30]})


def test_a_measured_pose_may_exceed_a_limit_by_noise(paper: planner.Problem) -> None:
    problem = paper.changed({"limits.joint_deg": [30.0, 40.0, 40.0]})
    there = problem.from_pose([30.004, 1.0, 1.0])
    assert np.rad2deg(there.start[1:]) == pytest.approx([30.0, 1.0, 1.0], rel=1e-12)
    below = problem.changed({"limits.z2_margin": None}).from_pose([-30.004, 1.0, 1.0])
    assert np.rad2deg(below.start[1]) == pytest.approx(-30.0, rel=1e-12)
    with pytest.raises(planner.InputError, match=r"30\.2 deg .* 30"):
        problem.from_pose([30.2, 1.0, 1.0])
    with pytest.raises(planner.InputError, match=r"\b2 angles"):
        problem.from_pose([30.004, 1.0])


@pytest.mark.parametrize("turn_deg", [0.0, 25.0])
@pytest.mark.parametrize("rounding", [0.0, 4e-16, -4e-16])
def test_a_tip_at_full_reach_means_the_straight_arm(turn_deg: float, rounding: float) -> None:
    turn, reach = np.deg2rad(turn_deg), 0.9 * (1 + rounding)
    place = [reach * np.cos(turn), reach * np.sin(turn)]
    problem = planner.Problem.from_dict(FULL_REACH).changed({"goal.tip_m": place})
    assert np.rad2deg(problem.goal[1:]) == pytest.approx([turn_deg, 0.0, 0.0])
    q = planner.solve(problem).q(10.0)
    assert problem.system.arm_points(q[1:])[-1] == pytest.approx(place, abs=3e-5)
    given = problem.changed({"goal.theta_deg": ["free", "free", 0.0]})
    assert given.free == ()
    with pytest.raises(planner.InputError, match="and the stretched arm is"):
        problem.changed({"goal.tip_m": [0.9001, 0.0]})


def test_a_tip_just_below_full_reach_is_planned() -> None:
    problem = planner.Problem.from_dict(FULL_REACH).changed({"goal.tip_m": [0.8999999, 0.0]})
    assert planner.solve(problem).verified


def test_shapes_of_a_matlab_file_are_looked_at_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zeros take a thousandth of their size in a compressed file."""
    fits = {"t": 3, "q": (3, 4), "u": (3, 2), "motors": (3, 2), "z": (3, 4), "v": (3, 2)}
    arrays = {name: np.zeros(shape) for name, shape in fits.items()}
    four = ["phi2_rad", "theta1_rad", "theta2_rad", "theta3_rad"]
    names = {"coordinates": four, "inputs": ["a", "b"], "axes": ["c", "d"]}
    lists = {name: np.array(held, dtype=object) for name, held in names.items()}
    path = tmp_path / "x.mat"

    def load(**changes: np.ndarray) -> planner.Samples:
        savemat(path, {**arrays, **lists, **changes}, do_compression=True)
        return planner.load_samples(path)

    other = np.zeros((1000, 1000))
    assert load(other=other).q.shape == (3, 4)
    read: list[list[str]] = []
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, variable_names, **__: read.append([]))
    for name in fits:
        with pytest.raises(planner.InputError, match=f"{name} 1000000"):
            load(**{name: other})
    with pytest.raises(planner.InputError, match="coordinates 1000000"):
        load(coordinates=other)
    rows = 2_000_001
    long = {name: np.zeros((rows, np.prod(shape) // 3)) for name, shape in fits.items()}
    with pytest.raises(planner.InputError, match=f"t {rows}"):
        load(**long)
    assert read == []
