"""One plan as a file for another program."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from planner.display import csv_text
from planner.errors import InputError
from planner.export.ros import joint_trajectory, yaml_text
from planner.export.samples import RATE_HZ, Samples, sample
from planner.files import refuse_unwritable, write_bytes, write_text
from planner.plan import Plan, expect_plan
from planner.schema import nearest

FORMATS = {
    "csv": "table of t, q, u, z, v at even times, one header line with units",
    "json": "the plan itself, exact, as `planner plan --out` writes it (planner schema plan)",
    "ros2": "trajectory_msgs/JointTrajectory as YAML, the two motors; needs rest at both ends",
    "mat": "MATLAB: t, q, u, z, v, names of coordinates and inputs, and facts of the plan",
}
"""Formats by name, each with what it holds."""

_SUFFIXES = {".csv": "csv", ".json": "json", ".yaml": "ros2", ".yml": "ros2", ".mat": "mat"}


def export(
    plan: Plan,
    path: str | Path,
    format: str | None = None,
    *,
    rate_hz: float = RATE_HZ,
    joint_names: Sequence[str] | None = None,
) -> Path:
    """Write a plan as a file for another program, whole or not at all.

    Args:
        plan: The plan. One that is kept for study only goes into every format but "ros2", with NaN
            (in CSV: nothing) where no real angles or inputs exist.
        path: The file; an existing one is replaced.
        format: One of `FORMATS`; by the ending of `path` (.csv, .json, .yaml, .mat) when left out.
        rate_hz: Samples a second, for all but "json"; see `sample`.
        joint_names: For "ros2"; see `joint_trajectory`.

    Raises:
        InputError: If the format is unknown, the plan is not fit for it, or the file cannot be
            written.
    """
    expect_plan(plan)
    name = find_format(path, format)
    refuse_unwritable(path)
    if joint_names is not None and name != "ros2":
        raise InputError(f"the format '{name}' has no joint names; they belong to 'ros2'")
    match name:
        case "csv":
            return write_text(path, _csv(sample(plan, rate_hz)))
        case "mat":
            return write_bytes(path, _mat(plan, sample(plan, rate_hz)))
        case "ros2":
            return write_text(path, yaml_text(joint_trajectory(plan, rate_hz, joint_names)))
        case _:
            return plan.save(path)


def find_format(path: str | Path, format: str | None) -> str:
    """The format asked for, or that of the path's ending.

    Raises:
        InputError: If there is no such format.
    """
    if format is None:
        format = _SUFFIXES.get(Path(path).suffix.lower())
        if format is None:
            endings = ", ".join(_SUFFIXES)
            raise InputError(
                f"the ending of {path} tells no format ({endings}); name it with --format:"
                f" {', '.join(FORMATS)}"
            )
    if format not in FORMATS:
        raise InputError(f"no format '{format}'; {nearest(format, list(FORMATS))}")
    return format


def _csv(samples: Samples) -> str:
    rows = samples.table.tolist()
    shown = (["" if np.isnan(x) else repr(x) for x in row] for row in rows)
    return csv_text([samples.columns, *shown])


def _mat(plan: Plan, samples: Samples) -> bytes:
    from scipy.io import savemat

    about = {
        "format": "planner-samples",
        "version": 1,
        "method": plan.method,
        "status": plan.status,
        "verified": plan.verified,
        "duration_s": plan.duration,
        "objective": plan.objective,
        "objective_name": plan.objective_name,
        "problem_json": json.dumps(plan.problem.to_dict()),
    }
    arrays = {name: getattr(samples, name) for name in ("t", "q", "u", "z", "v")}
    names = {
        "coordinates": np.array(samples.coordinates, dtype=object),
        "inputs": np.array(samples.inputs, dtype=object),
    }
    stream = io.BytesIO()
    savemat(stream, {**arrays, **names, "about": about}, oned_as="column", do_compression=True)
    return stream.getvalue()
