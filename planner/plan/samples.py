"""Sample a plan at evenly spaced times, and read files of such samples.

Also converts plans and replays to pandas frames and xarray datasets.
"""

from __future__ import annotations

import importlib
import io
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.errors import ABOVE_ZERO, InputError, expect_number
from planner.plan.plan import Plan
from planner.plan.quadrature import POINTS, integrate, read_trajectory
from planner.plan.recorded.number_table import read_table
from planner.plan.trajectory import StateTrajectory
from planner.support.arrays import Array, Frozen
from planner.support.calculus.bernstein import Bernstein
from planner.support.files import SAMPLES_BYTES, expect_path, read_bytes
from planner.support.package import DataFrame, Dataset, how_to_install
from planner.systems.triangular_system import Coordinate

MAX_ROWS = 2_000_000
RATE_HZ = 100.0
"""Default number of samples per second, as for the emulated machine's controller."""

MISS_BLOCK = 5000
"""Number of rows that `held_miss` integrates at once, in some 100 MB."""

ARRAYS = ("t", "q", "u", "motors", "z", "v")
"""Arrays of `Samples`, in the order of its columns."""


LISTS = ("coordinates", "inputs", "axes")
MAT_NAMES = (*ARRAYS, *LISTS)
"""Variables of a MATLAB file that are read."""

MOST_COORDINATES = 30


@dataclass(frozen=True, eq=False)
class Samples(Frozen):
    """A motion sampled at R times.

    Attributes:
        coordinates: Names of the columns of `q`, with units, for example "theta1_rad"; these are
            the system's user coordinates.
        inputs: Names of the columns of `u`, for example "u1_rad_s".
        axes: Names of the columns of `motors`, for example "motor1_rad".
        t: Times, shape (R,), s; the first is 0. If the duration is no multiple of the step, the
            last is up to a step later; the motors then take the whole step for what is left.
        q: User coordinates, shape (R, N); NaN where they would not be real.
        u: Mean inputs until the next time, shape (R, 2); 0 at the end, NaN if undefined.
        motors: Motor angles, shape (R, 2); see `motor_angles`.
        z: Chained coordinates, shape (R, N).
        v: Chained inputs at these times, shape (R, 2); 0 at the end.
    """

    coordinates: tuple[str, ...]
    inputs: tuple[str, str]
    axes: tuple[str, str]
    t: Array
    q: Array
    u: Array
    motors: Array
    z: Array
    v: Array

    def __repr__(self) -> str:
        return f"Samples({len(self.t)} instants to {self.t[-1]:.4g} s: {', '.join(self.columns)})"

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns: t_s, then those of q, u, both motors, z1 … zN, v1, v2."""
        chained = [f"z{i + 1}" for i in range(len(self.coordinates))]
        return ("t_s", *self.coordinates, *self.inputs, *self.axes, *chained, "v1", "v2")

    @property
    def table(self) -> Array:
        """All values, shape (R, 2N + 7), one column for each name in `columns`."""
        return np.column_stack([getattr(self, name) for name in ARRAYS])

    @classmethod
    def from_table(cls, columns: Sequence[str], table: Array) -> Samples:
        """Return the samples with the given `columns` and `table`.

        Raises:
            ValueError: If the number or the names of the columns are not those of samples.
        """
        size = (len(columns) - 7) // 2
        if size < 2 or table.ndim != 2 or table.shape[1] != len(columns):
            raise ValueError(f"it has {len(columns)} columns")
        cuts = np.cumsum([1, size, 2, 2, size])
        t, q, u, motors, z, v = np.split(table, cuts, axis=1)
        names, u1, u2, *axes = (tuple(columns[1 : 1 + size]), *columns[1 + size : 5 + size])
        samples = cls(names, (u1, u2), (axes[0], axes[1]), t[:, 0], q, u, motors, z, v)
        if samples.columns != tuple(columns):
            raise ValueError(f"its columns are {', '.join(columns)}")
        return samples


def sample(plan: Plan, rate_hz: float = RATE_HZ) -> Samples:
    """Return samples of a plan at even times, for motors that hold inputs from row to row.

    Each input is its mean until the next row, so that at every row each motor has turned as far as
    the plan says. A compensated plan holds each command for one tick, so the mean over a tick is
    the command itself.

    Args:
        plan: Any plan.
        rate_hz: Samples per second.

    Raises:
        InputError: If the rate is not positive, or gives more than two million samples.
    """
    expect_number("rate_hz", rate_hz, "a positive number of samples per second", ABOVE_ZERO)
    steps = max(1, int(np.ceil(min(plan.duration * rate_hz, 1e15) - 1e-9)))
    if steps >= MAX_ROWS:
        raise InputError(
            f"rate_hz = {rate_hz:g} gives {steps + 1} samples, allowed {MAX_ROWS}; lower the rate"
        )
    t = np.arange(steps + 1) / rate_hz
    t[-1] = max(t[-1], plan.duration)
    on_plan = np.minimum(t, plan.duration)
    system = plan.problem.system
    first, second = system.inputs
    return Samples(
        coordinates=tuple(_column_name(c) for c in system.user_coordinates),
        inputs=commands(plan),
        axes=(f"motor1_{_travel_unit(first)}", f"motor2_{_travel_unit(second)}"),
        t=t,
        q=plan.user(on_plan),
        u=np.concatenate([_turns(plan, on_plan) / np.diff(t)[:, None], np.zeros((1, 2))]),
        motors=motor_angles(plan, on_plan),
        z=plan.z(on_plan),
        v=np.concatenate([plan.v(t[:-1]), np.zeros((1, 2))]),
    )


def commands(plan: Plan) -> tuple[str, str]:
    """Return the names of the columns with motor commands, such as u1_rad_s."""
    first, second = plan.problem.system.inputs
    return _column_name(first), _column_name(second)


def motor_angles(plan: Plan, t: Array) -> Array:
    """Return the angles of the motors at increasing times t (R,) from 0, (R, 2).

    The angles are the integrals of u, in rad, or in m if the input is a speed. Motor 1 starts at 0,
    as its axis has no absolute zero in the model; motor 2 starts at q₂, which is θ₁ of an arm. For
    a compensated plan these are the commanded angles.
    """
    angles = np.concatenate([np.zeros((1, 2)), np.cumsum(_turns(plan, t), axis=0)])
    return np.asarray(angles + np.array([0.0, plan.q(0.0)[1]]))


def _turns(plan: Plan, t: Array) -> Array:
    """Return the integrals of u between consecutive times t (R,), (R − 1, 2).

    The method is Gauss quadrature on cells where u is a polynomial up to rounding.
    """
    cells = read_trajectory(plan.trajectory).cells
    begins = cells.time(np.arange(len(cells.piece)), np.array(-1.0))
    edges = np.unique(np.concatenate([t, begins[(begins > t[0]) & (begins < t[-1])]]))
    nodes, weights = np.polynomial.legendre.leggauss(POINTS // 2)
    half = np.diff(edges)[:, None] / 2
    u = plan.u(edges[:-1, None] + half * (1 + nodes))
    turned = np.sum((half * weights)[..., None] * u, axis=1)
    return np.asarray(np.add.reduceat(turned, np.searchsorted(edges, t[:-1]), axis=0))


def held_miss(plan: Plan, rate_hz: float = RATE_HZ) -> Array:
    """Return the end of the sampled minus the end of the original motion, user coordinates (N,).

    The sampled motion holds each sample's inputs until the next; the original motion has the plan's
    own inputs. Both are integrated from the plan's start by the kinematics, without a machine. NaN
    for a plan without real inputs.

    Raises:
        InputError: As for `sample`.
    """
    samples, system = sample(plan, rate_hz), plan.problem.system
    start, q = plan.q(0.0), plan.q(np.minimum(samples.t, plan.duration))
    if not (np.all(np.isfinite(q)) and np.all(np.isfinite(samples.u))):
        return np.full(system.size, np.nan)
    held_end = start
    for first in range(0, len(samples.t) - 1, MISS_BLOCK):
        rows = slice(first, first + MISS_BLOCK + 1)
        t = samples.t[rows] - samples.t[first]
        straight = Bernstein(np.stack([q[rows][:-1], q[rows][1:]]), t)
        inputs = Bernstein(samples.u[None, rows][:, :-1].copy(), t)
        held_end = integrate(StateTrajectory(system, straight, inputs), held_end).q[-1, -1]
    end = integrate(plan.trajectory, start).q[-1, -1]
    return np.asarray(system.user(held_end) - system.user(end))


def load_samples(path: str | Path) -> Samples:
    """Read a CSV or MATLAB file written by `export`.

    Raises:
        InputError: If the file is missing, is neither .csv nor .mat, or does not hold samples.
    """
    readers: dict[str, Callable[[Path], Samples]] = {".csv": _from_csv, ".mat": _from_mat}
    suffix = expect_path(path).suffix.lower()
    if suffix not in readers:
        raise InputError(f"cannot read samples from {path}: its name must end in .csv or .mat")
    try:
        return readers[suffix](Path(path))
    except InputError:
        raise
    # SciPy raises many kinds of exceptions for broken files.
    except Exception as error:
        raise InputError(f"{path} does not hold the samples of a plan: {error}") from None


def _from_csv(path: Path) -> Samples:
    table = read_table(path, "samples are CSV", lambda name: name == "t_s")
    values = table.numbers(dict.fromkeys(range(len(table.names)), "nan"))
    return Samples.from_table(table.names, np.column_stack([*values.values()]))


def _from_mat(path: Path) -> Samples:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        content = io.BytesIO(read_bytes(path, SAMPLES_BYTES))
        _refuse_misfits({name: math.prod(shape) for name, shape, _ in whosmat(content)})
        data: dict[str, Any] = loadmat(content, variable_names=MAT_NAMES, simplify_cells=True)
    except (MatReadError, zlib.error) as error:
        raise ValueError(error) from None
    arrays = [np.asarray(data[name], dtype=float) for name in ARRAYS]
    names = [tuple(map(str, data[name])) for name in LISTS]
    samples = Samples(*names, *arrays)  # type: ignore[arg-type]
    return Samples.from_table(samples.columns, samples.table)


def _refuse_misfits(sizes: dict[str, int]) -> None:
    """Raise a ValueError, before they are read, if the sizes of arrays are not those of samples.

    Compressed zeros take a thousandth of their size in a file.
    """
    if missing := [name for name in MAT_NAMES if name not in sizes]:
        raise ValueError(f"it lacks {', '.join(missing)}")
    rows, n = sizes["t"], sizes["coordinates"]
    columns = dict(zip(ARRAYS, (1, n, 2, 2, n, 2), strict=True))
    misfits = [name for name, wide in columns.items() if sizes[name] != rows * wide]
    if misfits or rows > MAX_ROWS or n > MOST_COORDINATES:
        told = ", ".join(f"{name} {sizes[name]}" for name in MAT_NAMES)
        raise ValueError(f"its arrays have other numbers of values than samples have: {told}")


def _travel_unit(rate: Coordinate) -> str:
    """Return the unit of an input's integral, in one word: rad for rad/s."""
    return (rate.unit.removesuffix("/s") or "1").replace("/", "_").replace("^", "")


def _column_name(coordinate: Coordinate) -> str:
    """Return name and unit in one word, as in theta1_rad and speed_m_s; the unit "1" for none."""
    return f"{coordinate.name}_{(coordinate.unit or '1').replace('/', '_').replace('^', '')}"


def to_frame(plan: Plan, rate_hz: float = RATE_HZ) -> DataFrame:
    """Return samples of a plan as a pandas frame: index t_s, columns with units in their names.

    Raises:
        InputError: If pandas is not installed, or as for `sample`.
    """
    samples = sample(plan, rate_hz)
    pandas = import_library("pandas")
    frame = pandas.DataFrame(samples.table, columns=list(samples.columns)).set_index("t_s")
    frame.attrs = plan_facts(plan)
    return frame


def to_xarray(plan: Plan, rate_hz: float = RATE_HZ) -> Dataset:
    """Return samples of a plan as a dataset: q, u, z, v over time; coordinates and inputs by name.

    `dataset.q.sel(coordinate="theta1")` is one angle; units are in the coordinates `unit_of_q` and
    `unit_of_u`.

    Raises:
        InputError: If xarray is not installed, or as for `sample`.
    """
    samples, system = sample(plan, rate_hz), plan.problem.system
    chained = [f"z{i + 1}" for i in range(system.size)]
    return import_library("xarray").Dataset(
        {
            "q": (("time", "coordinate"), samples.q),
            "u": (("time", "input"), samples.u),
            "motors": (("time", "input"), samples.motors),
            "z": (("time", "chained"), samples.z),
            "v": (("time", "chained_input"), samples.v),
        },
        coords={
            "time": ("time", samples.t, {"units": "s"}),
            "coordinate": [c.name for c in system.user_coordinates],
            "input": [c.name for c in system.inputs],
            "chained": chained,
            "chained_input": ["v1", "v2"],
            "unit_of_q": ("coordinate", [c.unit for c in system.user_coordinates]),
            "unit_of_u": ("input", [c.unit for c in system.inputs]),
        },
        attrs=plan_facts(plan),
    )


def import_library(name: str) -> Any:
    """Return an optional library such as pandas, which the package's extra `tables` installs.

    Raises:
        InputError: If the library is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            f"this view needs {name}; install it with: {how_to_install('tables')}"
        ) from None


def plan_facts(plan: Plan) -> dict[str, Any]:
    """Return facts on the plan, which frames and datasets store as attributes."""
    return {
        "problem": plan.problem.name,
        "method": plan.method,
        "status": plan.status,
        "verified": int(plan.verified),
        "duration_s": plan.duration,
    }
