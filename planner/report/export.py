"""Write one plan as a file for another program.

For ROS 2, the motion of both motors becomes a trajectory_msgs/JointTrajectory message.

The message definition (ROS 2 `common_interfaces`, trajectory_msgs/msg/JointTrajectory.msg and
JointTrajectoryPoint.msg) requires as many positions, velocities and accelerations as joint names,
and points in increasing order of `time_from_start`. The joint trajectory controller of ros2_control
also rejects a last point with a velocity.
"""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from planner.errors import InputError, InputWarning, expect_number
from planner.machine.machine import Machine
from planner.plan.measures import REST_SHARE, moving_inputs, peak_inputs
from planner.plan.plan import Plan, expect_plan
from planner.plan.samples import (
    ARRAYS,
    LISTS,
    RATE_HZ,
    Samples,
    commands,
    held_miss,
    motor_angles,
    sample,
)
from planner.report.result_folder import folder, refuse_unwritable_folder
from planner.report.urdf import urdf_text
from planner.support.arrays import Array
from planner.support.files import refuse_unwritable, write_bytes, write_text
from planner.support.tables import csv_text
from planner.support.user_tables import allowed_hint
from planner.verification.verify import verify

Real = Literal["double", "float"]
"""Type of the numbers in C."""


@dataclass(frozen=True)
class ExportOptions:
    """Options of `export` that only some formats have."""

    rate_hz: float = field(default=RATE_HZ, metadata={"words": "samples per second"})
    joint_names: Sequence[str] | None = field(default=None, metadata={"words": "joint names"})
    real: Real = field(default="double", metadata={"words": "type of numbers"})
    machine: Machine | None = field(default=None, metadata={"words": "machine"})
    slow: float = field(default=1.0, metadata={"words": "slower motion"})


@dataclass(frozen=True)
class Format:
    """An export format: one kind of file or folder.

    Attributes:
        holds: The format's content in words, for the command's completion and the documentation.
        endings: File name endings that select this format only; empty if the format is a folder.
        content: Function that returns the file (text or bytes), or a folder's files by name.
        reader: Name of the Python function that reads the file back, or "".
        options: Names of the fields of `ExportOptions` that the format uses.
        is_command: Whether a machine or robot executes the file directly. Then `export` warns of a
            plan that does not start at rest, if `content` has not refused it (`_refuse_unfit`).
        has_feedback: Whether the file holds a tracker, which moves the arm by its readings.
        sample_and_hold: Whether motors hold the command of each row until the next row.
        command_columns: Function that returns the names of the columns with the motors' commands;
            empty for formats without named columns.
    """

    holds: str
    endings: tuple[str, ...]
    content: Callable[[Plan, ExportOptions], str | bytes | Mapping[str, str]]
    reader: str = ""
    options: tuple[str, ...] = ("rate_hz", "slow")
    is_command: bool = True
    has_feedback: bool = False
    sample_and_hold: bool = False
    command_columns: Callable[[Plan], Sequence[str]] = lambda _: ()


FORMATS: dict[str, Format] = {
    "csv": Format(
        "table of t, q, u, motor angles, z, v at even times, one header line with units",
        (".csv",),
        lambda plan, options: _csv(sample(slowed(plan, options.slow), options.rate_hz)),
        "planner.load_samples",
        sample_and_hold=True,
        command_columns=commands,
    ),
    "json": Format(
        "the plan itself, exact, as `planner plan --out` writes it (planner schema plan)",
        (".json",),
        lambda plan, _: plan.to_json(),
        "planner.load_plan",
        options=(),
        is_command=False,
    ),
    "ros2": Format(
        "trajectory_msgs/JointTrajectory as YAML, the two motors; needs rest at both ends",
        (".yaml", ".yml"),
        lambda plan, options: yaml_text(
            joint_trajectory(plan, options.rate_hz, options.joint_names, options.slow)
        ),
        options=("rate_hz", "joint_names", "slow"),
    ),
    "matlab": Format(
        "MATLAB: as csv, with names of coordinates and inputs, and facts of the plan",
        (".mat",),
        lambda plan, options: _mat(slowed(plan, options.slow), options.rate_hz),
        "planner.load_samples",
        sample_and_hold=True,
    ),
    "urdf": Format(
        "the arm for ROS and RViz: link lengths, joint limits, joints named as the coordinates",
        (".urdf",),
        lambda plan, _: urdf_text(plan),
        options=(),
        is_command=False,
    ),
    "c": Format(
        "folder with the tracker of the plan in C99, a self-test and a page on its use",
        (),
        lambda plan, options: _c(plan, options),
        options=("real", "machine"),
        has_feedback=True,
    ),
}
"""All export formats by name; the command, messages and the documentation use this table."""


def fitting(option: str) -> str:
    """Return the names of the formats that use an option, separated by commas."""
    return ", ".join(name for name, one in FORMATS.items() if option in one.options)


def export(
    plan: Plan,
    path: str | Path,
    format: str | None = None,
    *,
    rate_hz: float = RATE_HZ,
    joint_names: Sequence[str] | None = None,
    real: Real = "double",
    machine: Machine | None = None,
    slow: float = 1.0,
) -> Path:
    """Write a plan as a file or a folder for another program, completely or not at all.

    The last commands are zero. In tables, the command of a row is the mean from this row to the
    next: motors that hold it until the next row turn as far as planned.
    `planner.plan.samples.held_miss` computes how far the motion with held commands ends from the
    planned end. If the plan does not start at rest, an `InputWarning` says so.

    Args:
        plan: The plan. For a refused plan the samples are NaN (in CSV: empty) where no real angles
            or inputs exist; formats for a robot refuse it.
        path: The file, or the folder if the format is one. An existing file is replaced, a folder
            only if it is from an earlier export; what others put into it stays.
        format: Name in `FORMATS`; by default that of the ending of `path`.
        rate_hz: Samples per second, if the format has samples; see `sample`.
        joint_names: Joint names, if the format has them; see `joint_trajectory`.
        real: Type of the numbers in C: "double" or "float".
        machine: Machine whose mean values the tracker in C knows; by default the `[machine]` table.
        slow: Factor, at least 1, by which the motion takes longer, for a first run; see `slowed`.

    Raises:
        InputError: If the format is unknown, does not have one of the given options, or cannot hold
            the plan; or if the file cannot be written.
    """
    expect_plan(plan)
    name = find_format(path, format)
    refuse_target(path, name)
    options = ExportOptions(rate_hz, joint_names, real, machine, slow)
    _refuse_options(name, options)
    content = FORMATS[name].content(plan, options)
    if FORMATS[name].is_command and (moving := moving_inputs(plan.trajectory, 0.0)):
        warnings.warn(
            f"this {plan.method} plan does not start at rest: {', '.join(moving)} at t = 0;"
            f" {HELD_REST_ADVICE if plan.compensates else REST_ADVICE}",
            InputWarning,
            stacklevel=2,
        )
    if isinstance(content, str):
        return write_text(path, content)
    if isinstance(content, bytes):
        return write_bytes(path, content)
    with folder(path) as place:
        for file, text in content.items():
            (place / file).write_text(text, encoding="utf-8")
    return Path(path).resolve()


def slowed(plan: Plan, factor: float) -> Plan:
    """Return a plan's path `factor` times as slow, to look at; nothing judges it.

    The systems are driftless, so the path is the same without lags. Inputs are smaller by the
    factor; what a compensated plan allows for, such as the servos' lag, is not that of this speed.

    Raises:
        InputError: If the factor is not a number of at least 1.
    """
    expect_number("slow", factor, "a factor of at least 1", 1)
    if factor == 1:
        return plan
    return replace(plan, trajectory=plan.trajectory.slowed(factor), verified=False)


def refuse_target(path: str | Path, format: str) -> None:
    """Check that the file, or the folder if the format is a folder, can be written.

    Raises:
        InputError: If it cannot be written.
    """
    (refuse_unwritable if FORMATS[format].endings else refuse_unwritable_folder)(path)


def _refuse_options(name: str, options: ExportOptions) -> None:
    for each in fields(ExportOptions):
        if getattr(options, each.name) != each.default and each.name not in FORMATS[name].options:
            raise InputError(
                f"the format '{name}' has no option for {each.metadata['words']}; formats that"
                f" have one: {fitting(each.name)}"
            )
    if (real := options.real) not in get_args(Real):
        raise InputError(f"real = {real!r}; {allowed_hint(str(real), get_args(Real))}")


def find_format(path: str | Path, format: str | None) -> str:
    """Return the format of a name or an ending; if it is None, that of the path's ending.

    Raises:
        InputError: If there is no such format.
    """
    endings = {ending: name for name, one in FORMATS.items() for ending in one.endings}
    ending = Path(path).suffix.lower() if format is None else f".{format}"
    format = endings.get(ending, format)
    if format is None:
        raise InputError(
            f"the ending of {path} is not that of a format ({', '.join(endings)}); name the"
            f" format with --format: {', '.join(FORMATS)}"
        )
    if format not in FORMATS:
        raise InputError(f"no format '{format}'; {allowed_hint(format, list(FORMATS))}")
    return format


def _c(plan: Plan, options: ExportOptions) -> dict[str, str]:
    from planner.report.controller.controller import controller_files  # imports OSQP

    return controller_files(plan, options.machine, options.real)


def _csv(samples: Samples) -> str:
    cells = (["" if np.isnan(x) else repr(x) for x in row] for row in samples.table.tolist())
    return csv_text([samples.columns, *cells])


def _mat(plan: Plan, rate_hz: float) -> bytes:
    from scipy.io import savemat

    samples = sample(plan, rate_hz)
    about = {
        "format": "planner-samples",
        "version": 1,
        "method": plan.method,
        "status": plan.status,
        "verified": plan.verified,
        "starts_at_rest": not moving_inputs(plan.trajectory, 0.0),
        "duration_s": plan.duration,
        "held_miss": held_miss(plan, rate_hz),
        "objective": plan.objective,
        "objective_name": plan.objective_name,
        "only_sampled": ", ".join(plan.sampled_labels),
        "claimed": ", ".join(plan.file_figures),
        "problem_json": json.dumps(plan.problem.to_dict()),
    }
    arrays = {name: getattr(samples, name) for name in ARRAYS}
    names = {name: np.array(getattr(samples, name), dtype=object) for name in LISTS}
    stream = io.BytesIO()
    savemat(stream, {**arrays, **names, "about": about}, oned_as="column", do_compression=True)
    return stream.getvalue()


REST_ADVICE = (
    "plan it with rest = true (--set method.collocation.rest=true), or give its path another timing"
    " with planner.retime(plan, {'input_rate_rad_s2': ...}, rest=True)"
)

HELD_REST_ADVICE = (
    "limit the input rates of the original plan (--set limits.input_rate_rad_s2=2.0); the"
    " preparatory motion respects this limit too"
)

DIFFERENCE_SHARE = 1e-6
"""Half width of difference quotients for accelerations, as a fraction of a plan's smooth piece."""


def joint_trajectory(
    plan: Plan, rate_hz: float = RATE_HZ, joint_names: Sequence[str] | None = None, slow: float = 1
) -> dict[str, Any]:
    """Build a trajectory_msgs/JointTrajectory message as nested dictionaries and lists.

    Positions are the angles of the two motors (`planner.plan.samples.motor_angles`), velocities
    the inputs, and accelerations the inputs' time derivatives (at a corner, the right-hand one). If
    `joint_names` are those of all joints of an arm, positions, velocities and accelerations are
    those of the joints, which RViz can show with the arm's description (format `urdf`).

    Args:
        plan: A plan that starts and ends at rest and passes `verify`.
        rate_hz: Points per second.
        joint_names: Two names, as the robot's controller calls the motors; by default "phi1" and
            the name of the second coordinate for arms, the inputs' names for other systems. Or the
            names of all joints of an arm: "theta1", "theta2" …
        slow: See `slowed`; what is checked is the plan at its own speed.

    Raises:
        InputError: If the plan violates a requirement, moves at an end, or its inputs jump; the
            message says what to do.
    """
    names = _names(plan, joint_names)
    _refuse_unfit(plan)
    plan = slowed(plan, slow)
    times = sample(plan, rate_hz).t
    t = np.minimum(times, plan.duration)
    if names == _joints(plan) and joint_names is not None:
        positions = plan.q(t)[:, 1:]
        system = plan.problem.system

        def velocities(t: Array) -> Array:
            return np.asarray(system.rates(plan.q(t), plan.u(t))[..., 1:])
    else:
        positions, velocities = motor_angles(plan, t), plan.u
    u, slopes = velocities(t), time_slopes(plan, velocities, t)
    u[[0, -1]] = 0.0
    points = [
        {
            "positions": positions[k].tolist(),
            "velocities": u[k].tolist(),
            "accelerations": slopes[k].tolist(),
            "effort": [],
            "time_from_start": _stamp(times[k]),
        }
        for k in range(len(t))
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return {"header": header, "joint_names": names, "points": points}


def yaml_text(message: Mapping[str, Any]) -> str:
    """Format the message as YAML for `ros2 topic pub` and `ros2 action send_goal`."""
    lines = [
        f"header: {_flow(message['header'])}",
        f"joint_names: {_flow(message['joint_names'])}",
        "points:",
    ]
    for point in message["points"]:
        entries = [f"{key}: {_flow(value)}" for key, value in point.items()]
        lines += [f"- {entries[0]}", *(f"  {entry}" for entry in entries[1:])]
    return "\n".join(lines) + "\n"


def time_slopes(plan: Plan, function: Callable[[Array], Array], t: Array) -> Array:
    """Return the time derivative of a function at times t (m,); at a corner, the right-hand one.

    The derivative is a central difference inside the smooth piece of the plan that contains t.
    """
    k = np.clip(np.searchsorted(plan.t, t, side="right") - 1, 0, len(plan.t) - 2)
    left, right = plan.t[k], plan.t[k + 1]
    step = DIFFERENCE_SHARE * (right - left)
    middle = np.clip(t, left + step, right - 1.001 * step)
    before, after = middle - step, middle + step
    return np.asarray((function(after) - function(before)) / (after - before)[:, None])


def _refuse_unfit(plan: Plan) -> None:
    """Refuse a plan that a robot's trajectory controller cannot follow; for any robot format."""
    check = verify(plan)
    if not check.ok:
        raise InputError(
            f"this {plan.method} plan cannot be sent to a robot: {check.violations[0]}"
        )
    if plan.compensates:
        raise InputError(
            f"this {plan.method} plan is compensated: its commands are speeds held for a tick each,"
            " but a robot's controller interpolates between points; export it as csv"
        )
    for time, when in ((0.0, "start"), (plan.duration, "end")):
        if moving := moving_inputs(plan.trajectory, time):
            raise InputError(
                f"this {plan.method} plan does not {when} at rest: {moving[0]} at its {when};"
                f" {REST_ADVICE}"
            )
    inputs, peaks = plan.problem.system.inputs, np.maximum(peak_inputs(plan.trajectory), 1e-12)
    inner = plan.t[1:-1]
    jumps = np.abs(plan.u(inner) - plan.u(np.nextafter(inner, 0.0)))
    for k, i in np.argwhere(jumps > REST_SHARE * peaks):
        raise InputError(
            f"{inputs[i].name} of this {plan.method} plan jumps by {jumps[k, i]:.4g}"
            f" {inputs[i].unit} at t = {inner[k]:.4g} s, which no motor can follow; plan it with"
            " rest = true (--set method.collocation.rest=true)"
        )


def _joints(plan: Plan) -> list[str]:
    """Return the names of an arm's joints; [] for a vehicle."""
    system = plan.problem.system
    return [c.name for c in system.coordinates[1:]] if hasattr(system, "arm_points") else []


def _names(plan: Plan, names: Sequence[str] | None) -> list[str]:
    joints = _joints(plan)
    if names is None:
        return ["phi1", joints[0]] if joints else [c.name for c in plan.problem.system.inputs]
    names = [str(name).strip() for name in names]
    if names == joints:
        return names
    if len(set(names)) != 2 or len(names) != 2 or not all(names):
        raise InputError(
            f"joint names {', '.join(names)!r}: give two different names, one for each motor"
            + (f"; or the arm's own, {', '.join(joints)}, for all joints" if joints else "")
        )
    return names


def _stamp(t: float) -> dict[str, int]:
    sec, nanosec = divmod(round(float(t) * 1_000_000_000), 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


def _flow(value: Any) -> str:
    """Return a value as JSON that is also YAML 1.1, which needs a point before an exponent."""
    if isinstance(value, float):
        text = repr(value)
        return text if "e" not in text or "." in text else text.replace("e", ".0e")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    return json.dumps(value)
