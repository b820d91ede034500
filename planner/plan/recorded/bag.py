"""Read a recorded run from a ROS 2 bag: `read_bag` returns the table that a CSV file would hold.

Each message with the reading of joint 1 gives a row. Other topics give their last value before it,
as a controller would hold it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.errors import InputError
from planner.plan.recorded.columns import parse_name
from planner.plan.recorded.number_table import NumberTable
from planner.support.files import expect_path
from planner.support.package import how_to_install
from planner.support.tables import line
from planner.support.user_tables import allowed_hint

EXAMPLE = '{"theta1_rad": "/joint_states/position[theta1]", "u1_rad_s": "/commands/data[0]", ...}'

_PART = re.compile(r"(\w+)((?:\[[^\]]*\])?)")


def is_bag(path: str | Path) -> bool:
    """Return whether the path is a folder that `ros2 bag record` wrote, or a bag's file."""
    path = expect_path(path)
    return path.suffix in (".mcap", ".db3") or (path / "metadata.yaml").is_file()


def read_bag(path: str | Path, columns: Mapping[str, str]) -> NumberTable:
    """Return the messages of a bag as a table.

    Args:
        path: The bag's folder, or its file.
        columns: Maps names of `planner.read_log` to "/topic/field"; `field[2]` is the third number
            of a list, `position[theta1]` a joint of a JointState. The time, which needs no entry,
            is the message's stamp or the time of recording.

    Raises:
        InputError: If the package `rosbags` is missing, the bag cannot be read, or a topic, a field
            or an entry is missing.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            f"{path}: reading a ROS 2 bag needs rosbags; install it with: {how_to_install('ros')}"
        ) from None
    place = Path(path) if Path(path).is_dir() else Path(path).parent
    try:
        with AnyReader([place], default_typestore=get_typestore(Stores.LATEST)) as reader:
            return _table(str(path), reader, columns)
    except InputError:
        raise
    except Exception as error:  # rosbags and its storages raise many kinds
        raise InputError(f"{path} cannot be read as a ROS 2 bag: {line(str(error))}") from error


def _table(source: str, reader: Any, columns: Mapping[str, str]) -> NumberTable:
    types = {each.topic: str(each.msgtype) for each in reader.connections}
    if not columns:
        topics = ", ".join(f"{topic} ({kind})" for topic, kind in types.items())
        raise InputError(
            f"{source}: map columns to topics, as in columns={EXAMPLE}; its topics: {topics}"
        )
    places = {name: _find_topic(source, name, list(types)) for name in columns.values()}
    named = ((parse_name(ours) or ("", ""), theirs) for ours, theirs in columns.items())
    clock = next((places[theirs][0] for (name, _), theirs in named if name == "theta1"), None)
    last: dict[str, str] = {}
    rows, numbers = [], []
    wanted = {topic for topic, _ in places.values()}
    connections = [each for each in reader.connections if each.topic in wanted]
    for number, (connection, recorded, raw) in enumerate(reader.messages(connections), start=1):
        message = reader.deserialize(raw, connection.msgtype)
        for name, (topic, field) in places.items():
            if topic == connection.topic:
                value = float(_value(message, field, f"{source}: {name}"))
                last[name] = f"{value:.17e}"  # always with a decimal point
        if connection.topic == clock:
            rows.append([str(_stamp(message, recorded)), *(last.get(name, "") for name in places)])
            numbers.append(number)
    return NumberTable(
        source, ("t_ns", *places), ("",) * (1 + len(places)), rows, numbers, ",", "message"
    )


def _find_topic(source: str, name: str, topics: list[str]) -> tuple[str, str]:
    """Return the topic and the field into which a column's name splits, as in "/topic/field"."""
    fitting = [topic for topic in topics if name.startswith(topic + "/")]
    if not fitting:
        raise InputError(
            f"{source} has no topic for '{line(name)}'; write /topic/field;"
            f" {allowed_hint(name.rpartition('/')[0], topics)}"
        )
    topic = max(fitting, key=len)
    return topic, name[len(topic) + 1 :]


def _value(message: Any, field: str, what: str) -> Any:
    """Return a number of a message by field: "position[theta1]", "data[0]", "twist.linear.x"."""
    value = message
    for part in field.split("."):
        match = _PART.fullmatch(part)
        if not match or not hasattr(value, match[1]):
            there = list(getattr(value, "__dataclass_fields__", {}))
            raise InputError(f"{what}: no field '{line(part)}'; {allowed_hint(part, there)}")
        entries = getattr(value, match[1])
        if not match[2]:
            value = entries
            continue
        index, names = match[2][1:-1], list(getattr(value, "name", []))
        if index in names:
            index = str(names.index(index))
        if not index.isdecimal() or int(index) >= len(entries):
            hint = allowed_hint(index, names) if names else f"it has {len(entries)} numbers"
            raise InputError(f"{what}: no entry '{line(index)}' in {match[1]}; {hint}")
        value = entries[int(index)]
    if not isinstance(value, (int, float)) and not hasattr(value, "__float__"):
        raise InputError(f"{what} is not a number")
    return value


def _stamp(message: Any, recorded: int) -> int:
    """Return the message's stamp in ns, or the time of recording without a stamp."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec if stamp else 0
    return stamp_ns or recorded
