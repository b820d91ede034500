"""Plans and replays as pandas frames and xarray datasets."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.distribution import how_to_install
from planner.errors import InputError
from planner.export.samples import RATE_HZ, sample
from planner.plan import Plan
from planner.replay import Replay
from planner.systems.base import Array

if TYPE_CHECKING:
    import pandas
    import xarray


def to_frame(plan: Plan, rate_hz: float = RATE_HZ) -> pandas.DataFrame:
    """The plan at even times as a frame: index t_s, columns with units in their names.

    Raises:
        InputError: If pandas is not installed or the rate is wrong.
    """
    samples = sample(plan, rate_hz)
    frame = (
        imported("pandas").DataFrame(samples.table, columns=list(samples.columns)).set_index("t_s")
    )
    frame.attrs = facts(plan)
    return frame


def to_xarray(plan: Plan, rate_hz: float = RATE_HZ) -> xarray.Dataset:
    """The plan at even times as a dataset: q, u, z, v over time, coordinate and input by name.

    `dataset.q.sel(coordinate="theta1")` is one angle; units are in the coordinates `unit_of_q` and
    `unit_of_u`.

    Raises:
        InputError: If xarray is not installed or the rate is wrong.
    """
    samples, system = sample(plan, rate_hz), plan.problem.system
    chained = [f"z{i + 1}" for i in range(system.size)]
    dataset: xarray.Dataset = imported("xarray").Dataset(
        {
            "q": (("time", "coordinate"), samples.q),
            "u": (("time", "input"), samples.u),
            "z": (("time", "chained"), samples.z),
            "v": (("time", "chained_input"), samples.v),
        },
        coords={
            "time": ("time", samples.t, {"units": "s"}),
            "coordinate": [c.name for c in system.coordinates],
            "input": [c.name for c in system.inputs],
            "chained": chained,
            "chained_input": ["v1", "v2"],
            "unit_of_q": ("coordinate", [c.unit for c in system.coordinates]),
            "unit_of_u": ("input", [c.unit for c in system.inputs]),
        },
        attrs=facts(plan),
    )
    return dataset


def replay_frame(replay: Replay) -> pandas.DataFrame:
    """One row a machine: its errors, and every setting of it that differs from machine to machine.

    Index: number of the sample. Columns: E_deg (eq. 29), terminal_E_deg, terminal_NAME_deg for each
    angle, then settings by name, with _1, _2 ... where there is one a motor or joint.

    Raises:
        InputError: If pandas is not installed.
    """
    columns: dict[str, Array] = {}
    if replay.angles:
        columns |= {"E_deg": replay.index_E_deg, "terminal_E_deg": replay.terminal_E_deg}
    coordinates = replay.plan.problem.system.coordinates
    for i, error in zip(replay.angles, replay.terminal_error_deg.T, strict=True):
        columns[f"terminal_{coordinates[i].name}_deg"] = error
    for name, values in replay.draws.values.items():
        for k, row in enumerate(values, start=1):
            if np.ptp(row) > 0:
                columns[name if len(values) == 1 else f"{name}_{k}"] = row
    pandas = imported("pandas")
    frame = pandas.DataFrame(columns, index=pandas.Index(replay.numbers, name="sample"))
    frame.attrs = {**facts(replay.plan), "seed": replay.seed}
    return frame


def replay_dataset(replay: Replay) -> xarray.Dataset:
    """True motions and motor speeds of every machine: q and motor_rates over sample and time.

    Raises:
        InputError: If xarray is not installed.
    """
    system = replay.plan.problem.system
    dataset: xarray.Dataset = imported("xarray").Dataset(
        {
            "q": (("sample", "time", "coordinate"), replay.q),
            "motor_rates": (("sample", "time", "input"), replay.motor_rates),
            "terminal_error": (("sample", "coordinate"), replay.terminal_error),
        },
        coords={
            "sample": replay.numbers,
            "time": ("time", replay.t, {"units": "s"}),
            "coordinate": [c.name for c in system.coordinates],
            "input": [c.name for c in system.inputs],
            "unit_of_q": ("coordinate", [c.unit for c in system.coordinates]),
        },
        attrs={**facts(replay.plan), "seed": replay.seed},
    )
    return dataset


def imported(name: str) -> Any:
    """A library of the extra `tables`.

    Raises:
        InputError: If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            f"this view needs {name}; install it with: {how_to_install('tables')}"
        ) from None


def facts(plan: Plan) -> dict[str, Any]:
    """What frames and datasets say of their plan."""
    return {
        "problem": plan.problem.name,
        "method": plan.method,
        "status": plan.status,
        "verified": int(plan.verified),
        "duration_s": plan.duration,
    }
