import numpy as np
import pytest
from scipy.interpolate import BPoly

import planner
from planner.plan.trajectory import ChainedTrajectory, StateTrajectory, trajectory_from_dict

Curve = ChainedTrajectory | StateTrajectory


@pytest.fixture(scope="module")
def chained(unlimited: planner.Problem) -> ChainedTrajectory:
    plan = planner.solve(unlimited.changed({"goal.travel": 0.825}), "polynomial")
    assert isinstance(plan.trajectory, ChainedTrajectory)
    return plan.trajectory


@pytest.fixture(scope="module")
def state(unlimited: planner.Problem) -> StateTrajectory:
    rng = np.random.default_rng(1)
    breaks = np.array([0.0, 1.0, 2.5])
    q = BPoly(rng.uniform(0.1, 0.9, (4, 2, 4)), breaks)
    u = BPoly(rng.uniform(-1, 1, (2, 2, 2)), breaks)
    return StateTrajectory(unlimited.system, q, u)


@pytest.fixture(params=["chained", "state"])
def curve(request: pytest.FixtureRequest) -> Curve:
    return request.getfixturevalue(request.param)


def test_shapes_follow_the_times(curve: Curve) -> None:
    for times in (1.0, np.linspace(0, 2, 5), np.zeros((2, 3))):
        shape = np.shape(times)
        for name, size in {"q": 4, "z": 4, "margins": 4, "u": 2, "v": 2}.items():
            assert getattr(curve, name)(times).shape == (*shape, size), name


def test_outside_its_time_it_stands_still(curve: Curve) -> None:
    end = curve.duration
    np.testing.assert_array_equal(curve.q(end + 1), curve.q(end))
    np.testing.assert_array_equal(curve.q(-1.0), curve.q(0.0))
    np.testing.assert_array_equal(curve.u([-1.0, end + 1]), np.zeros((2, 2)))
    assert np.any(curve.u(end) != 0)


def test_dict_round_trip_is_exact(curve: Curve) -> None:
    back = trajectory_from_dict(curve.system, curve.to_dict())
    t = np.linspace(0, curve.duration, 77)
    np.testing.assert_array_equal(back.q(t), curve.q(t))
    np.testing.assert_array_equal(back.u(t), curve.u(t))


def test_slowing_keeps_the_path(curve: Curve) -> None:
    slow = curve.slowed(3.0)
    t = np.linspace(0.1, curve.duration - 0.1, 9)
    assert slow.duration == pytest.approx(3 * curve.duration)
    np.testing.assert_allclose(slow.q(3 * t), curve.q(t), atol=1e-12)
    np.testing.assert_allclose(slow.u(3 * t), curve.u(t) / 3, rtol=1e-9)
    np.testing.assert_allclose(slow.v(3 * t), curve.v(t) / 3, rtol=1e-9)


def test_chained_curve_obeys_the_chained_form(chained: ChainedTrajectory) -> None:
    t = np.linspace(0.2, 9.8, 25)
    rate = chained.z_curve.derivative()(t)
    z, v = chained.z(t), chained.v(t)
    np.testing.assert_allclose(rate[:, 0], v[:, 0], atol=1e-13)
    np.testing.assert_allclose(rate[:, 1], v[:, 1], atol=1e-13)
    np.testing.assert_allclose(rate[:, 2:], z[:, 1:-1] * v[:, :1], atol=1e-13)


def test_chained_curve_and_kinematics_agree(chained: ChainedTrajectory) -> None:
    """q̇ by differences of the inverse chart against the kinematics under the fed-back input."""
    t, h = np.linspace(1.0, 9.0, 17), 1e-4
    difference = (chained.q(t + h) - chained.q(t - h)) / (2 * h)
    np.testing.assert_allclose(
        difference, chained.system.rates(chained.q(t), chained.u(t)), atol=1e-7
    )


def test_unknown_kind_is_refused(paper: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match="spline"):
        trajectory_from_dict(paper.system, {"kind": "spline"})
