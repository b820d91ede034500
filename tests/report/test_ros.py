"""What ROS is given, read by the libraries that read it there: the arm, and its joints' motion."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import planner

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def rest() -> planner.Plan:
    changes = {
        "limits.input_rate_rad_s2": 2.0,
        "limits.joint_deg": [80, 70, 60],
        "system.link_lengths": [0.4, 0.3, 0.2],
    }
    return planner.solve(planner.load_problem(ROOT / "problems/paper.toml", changes))


def test_the_arm_in_urdf_stands_where_the_plan_says(
    rest: planner.Plan, tmp_path: Path, sent: Callable
) -> None:
    yourdfpy = pytest.importorskip("yourdfpy", reason="needs the extra 'dev'")
    path = planner.export(rest, tmp_path / "arm.urdf")
    arm = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    assert arm.validate()
    assert arm.actuated_joint_names == ["theta1", "theta2", "theta3"]
    limits = [(joint.limit.lower, joint.limit.upper) for joint in arm.actuated_joints]
    np.testing.assert_allclose(np.rad2deg(limits), [[-80, 80], [-70, 70], [-60, 60]])
    speeds = [joint.limit.velocity for joint in arm.actuated_joints]
    message = sent(rest, 100, ["theta1", "theta2", "theta3"])
    moving = np.abs([point["velocities"] for point in message["points"]]).max(axis=0)
    assert np.all(moving < speeds)
    straight = 0.668811 * np.array([0.870125, 0.711625])  # per rad/s of the drive, at the pose 0
    np.testing.assert_allclose(speeds, 0.5 * np.append(1.0, straight), rtol=1e-6)
    assert all(joint.limit.effort > 0 for joint in arm.actuated_joints)
    for point in message["points"][::100]:
        arm.update_cfg(point["positions"])
        places = rest.problem.system.arm_points(np.array(point["positions"]))  # type: ignore[attr-defined]
        for name, place in zip(["link2", "link3", "tip"], places[1:], strict=True):
            np.testing.assert_allclose(arm.get_transform(name, "base")[:2, 3], place, atol=1e-9)


def test_the_joints_motion_belongs_together_and_is_a_message(
    rest: planner.Plan, sent: Callable
) -> None:
    typesys = pytest.importorskip("rosbags.typesys", reason="needs the extra 'ros'")
    message = sent(rest, 100, ["theta1", "theta2", "theta3"])
    t = np.array([1e-9 * p["time_from_start"]["nanosec"] + p["time_from_start"]["sec"]
                  for p in message["points"]])  # fmt: skip
    q, v, a = (np.array([p[key] for p in message["points"]])
               for key in ("positions", "velocities", "accelerations"))  # fmt: skip
    np.testing.assert_allclose(q, rest.q(t)[:, 1:], atol=1e-9)
    np.testing.assert_allclose(np.gradient(q, t, axis=0)[1:-1], v[1:-1], atol=2.0 * 0.01 / 2)
    inner = np.abs(np.gradient(v, t, axis=0) - a)[2:-2]
    assert np.quantile(inner, 0.9) < 0.02 * np.abs(a).max()  # corners aside
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    make = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    stamp = make["Time"](**message["header"]["stamp"])
    points = [
        make["JointTrajectoryPoint"](
            positions=np.array(p["positions"]),
            velocities=np.array(p["velocities"]),
            accelerations=np.array(p["accelerations"]),
            effort=np.array(p["effort"]),
            time_from_start=make["Duration"](**p["time_from_start"]),
        )
        for p in message["points"]
    ]
    header = make["Header"](stamp=stamp, frame_id=message["header"]["frame_id"])
    kind = "trajectory_msgs/msg/JointTrajectory"
    whole = store.types[kind](header=header, joint_names=message["joint_names"], points=points)
    again = store.deserialize_cdr(store.serialize_cdr(whole, kind), kind)
    np.testing.assert_array_equal([p.positions for p in again.points], q)


def test_a_vehicle_is_no_arm(tmp_path: Path) -> None:
    plan = planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"))
    with pytest.raises(planner.InputError, match="a unicycle is not an arm"):
        planner.export(plan, tmp_path / "x.urdf")
    assert not (tmp_path / "x.urdf").exists()
