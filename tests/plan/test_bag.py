"""Recorded runs from ROS 2 bags that `rosbags` itself writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra 'ros'")
typesys = pytest.importorskip("rosbags.typesys")

STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
JOINTS, COMMANDS = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
COLUMNS = {
    "u1_rad_s": "/commands/data[0]",
    "u2_rad_s": "/commands/data[1]",
    "theta1_rad": "/arm/joint_states/position[theta1]",
    "theta2_deg": "/arm/joint_states/velocity[0]",
}


@pytest.fixture(scope="module")
def log() -> planner.Log:
    t = 0.01 * np.arange(120)
    u = np.column_stack([np.where(t < 0.5, 0.2, -0.1), np.full_like(t, 0.3)])
    return planner.Log(t, u, np.column_stack([0.3 * t, 0.1 * np.sin(t)]), source="made")


def write(log: planner.Log, path: Path, storage: str, stamped: bool) -> Path:
    """Joint angles every row, commands a millisecond before, and only where they change."""
    kinds = STORE.types
    stamp, header = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]
    layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    plugin = getattr(rosbag2.StoragePlugin, storage)
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as bag:
        joints = bag.add_connection("/arm/joint_states", JOINTS, typestore=STORE)
        commands = bag.add_connection("/commands", COMMANDS, typestore=STORE)
        for k, t in enumerate(log.t):
            now = 10**18 + round(1e9 * t)
            if k == 0 or np.any(log.u[k] != log.u[k - 1]):
                command = kinds[COMMANDS](layout=layout, data=log.u[k])
                bag.write(commands, now - 10**6, STORE.serialize_cdr(command, COMMANDS))
            made = divmod(now, 10**9) if stamped else (0, 0)
            late = 3 * 10**5 * (k % 3) if stamped else 0  # a recorder's jitter
            position = np.array([7.0, log.theta[k, 0]])
            state = kinds[JOINTS](
                header=header(stamp=stamp(sec=made[0], nanosec=made[1]), frame_id=""),
                name=["other", "theta1"],
                position=position,
                velocity=np.array([np.rad2deg(log.theta[k, 1])]),
                effort=np.zeros(0),
            )
            bag.write(joints, now + late, STORE.serialize_cdr(state, JOINTS))
    return path


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
@pytest.mark.parametrize("stamped", [True, False])
def test_a_bag_is_read_by_topic(
    log: planner.Log, tmp_path: Path, storage: str, stamped: bool
) -> None:
    found = planner.read_log(write(log, tmp_path / "bag", storage, stamped), COLUMNS)
    np.testing.assert_allclose(found.t, log.t, atol=1e-9)
    np.testing.assert_array_equal(found.u, log.u)
    np.testing.assert_allclose(found.theta, log.theta, rtol=1e-14)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"u1_rad_s": "/nothing/data[0]"}, r"no topic for '/nothing/data\[0\]'.*/commands"),
        ({"u1_rad_s": "/commands/dat[0]"}, r"no field 'dat\[0\]'; did you mean 'data'"),
        ({"u1_rad_s": "/commands/data[2]"}, "no entry '2' in data; it has 2 numbers"),
        ({"theta1_rad": "/arm/joint_states/position[theta9]"}, "allowed: other, theta1"),
        ({"u1_rad_s": "/arm/joint_states/header"}, "is not a number"),
        (None, r"topics: /arm/joint_states \(sensor_msgs/msg/JointState\), /commands"),
    ],
)
def test_what_a_bag_lacks_is_named(
    log: planner.Log, tmp_path: Path, change: Any, said: str
) -> None:
    path = write(log, tmp_path / "bag", "SQLITE3", True)
    with pytest.raises(planner.InputError, match=said):
        planner.read_log(path, None if change is None else COLUMNS | change)


def test_a_damaged_bag_is_refused_in_one_line(log: planner.Log, tmp_path: Path) -> None:
    path = write(log, tmp_path / "bag", "SQLITE3", True)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: 3\n", encoding="utf-8")
    with pytest.raises(planner.InputError, match="cannot be read as a ROS 2 bag") as error:
        planner.read_log(path, COLUMNS)
    assert "\n" not in str(error.value)
