"""A plan as a pandas frame or an xarray dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from planner.errors import InputError
from planner.export.samples import RATE_HZ, sample
from planner.plan import Plan

if TYPE_CHECKING:
    import pandas
    import xarray


def to_frame(plan: Plan, rate_hz: float = RATE_HZ) -> pandas.DataFrame:
    """The plan at even times as a frame: index t_s, columns with units in their names.

    Raises:
        InputError: If pandas is not installed or the rate is wrong.
    """
    try:
        import pandas
    except ImportError:
        raise InputError(_LACKING.format("pandas")) from None
    samples = sample(plan, rate_hz)
    frame = pandas.DataFrame(samples.table, columns=list(samples.columns)).set_index("t_s")
    frame.attrs = _facts(plan)
    return frame


def to_xarray(plan: Plan, rate_hz: float = RATE_HZ) -> xarray.Dataset:
    """The plan at even times as a dataset: q, u, z, v over time, coordinate and input by name.

    `dataset.q.sel(coordinate="theta1")` is one angle; units are in the coordinates `unit_of_q` and
    `unit_of_u`.

    Raises:
        InputError: If xarray is not installed or the rate is wrong.
    """
    try:
        import xarray
    except ImportError:
        raise InputError(_LACKING.format("xarray")) from None
    samples, system = sample(plan, rate_hz), plan.problem.system
    chained = [f"z{i + 1}" for i in range(system.size)]
    return xarray.Dataset(
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
        attrs=_facts(plan),
    )


_LACKING = "this view needs {}; install it with: pip install 'planner[tables]'"


def _facts(plan: Plan) -> dict[str, Any]:
    return {
        "problem": plan.problem.name,
        "method": plan.method,
        "status": plan.status,
        "verified": int(plan.verified),
        "duration_s": plan.duration,
    }
