"""The compiled simulation of manipulators: the C files compute the same as `StepwiseMotion`.

The kernel is an optional extension: if the package was installed without a compiler, `library`
returns None and replays run in NumPy. Without inertia it computes sixteen machines at once.
"""

from __future__ import annotations

import ctypes
import logging
import os
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import cache, partial
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.machine.bodies import Masses, StateRows
from planner.machine.commands import CommandGrid, Steps, lengths
from planner.machine.disk_chain import DiskChain
from planner.machine.friction.contact_load import gear_constants, weights
from planner.machine.friction.contacts import VARYING_EFFECTS, friction_capacity, lateral_friction
from planner.machine.machine import Draws
from planner.machine.march import GAMMA, begin_march
from planner.problem.tables.machine_effects import EFFECTS
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

SAMPLES_A_CALL, STEPS_A_CALL = 32, 2000
"""Samples and steps of one kernel call: few enough to share among threads and to hear Ctrl-C."""

HEADERS = ("functions.h", "lanes.h", "contacts.h", "chain.h", "layout.h")
SOURCES = ("kernel.c", "wide.c", "dynamic.c", *HEADERS)
"""The C files of the kernel, in the order of setup.py."""

SLOW_WARNING = (
    "planner: the compiled replay is {}, so replays are about ten times slower (50 machines at"
    " once: 50 times; 1000: 6 times); {}"
)
"""Warning of a replay without the compiled kernel. The factors compare process time, for the
paper's plan and machine on one thread."""
MISSING_WARNING = SLOW_WARNING.format("missing", "install a C compiler, then this package again")
VERSION_WARNING = SLOW_WARNING.format(
    "of another version", "run make in the project's folder, or install this package again"
)

# -- data shared with C --------------------------------------------------------------------------
# `make generated` writes layout.h from these tables; the C files include it.

FLAGS = ("lagging", "second", "limited", "ramped", "geared_1", "geared_2", "lagged", "soft",
         "damped", "creeping", "loaded", "inclined")  # fmt: skip
"""Flags in the C structure `Model`: which effects are on, for all samples."""

COUNTS = ("samples", "joints", "points", "steps", "rows", *FLAGS, "dynamic", "coordinates", "heavy")
"""Integers in the C structure `Model`. `dynamic` is the number of rows of a dynamic state (else 0),
`coordinates` the first row of its coordinates, `heavy` how many numbers `Masses` has."""

ARRAYS = {
    "parameters": "const double",  # (samples, see `Own`)
    "length": "const double",  # (steps)
    "running": "const uint8_t",  # (steps)
    "desired": "const double",  # (steps + 1, joints)
    "row": "const int64_t",  # (steps + 1): where to record, or -1
    "state": "double",  # (samples, see `STATE_NUMBERS`)
    "q": "double",  # (samples, rows, joints + 1)
    "speed": "double",  # (samples, rows, 2)
    "masses": "const double",  # (samples, see `Masses`)
    "moving": "double",  # (samples, see `Moving`)
}
"""Arrays in the C structure `Model`, each with the C type of an element."""

STRIDES = ("step", "point", "motor", "sample")
"""Strides in the C structure `Commands`, in numbers; 0 along an axis with equal values."""

Size = tuple[int, int]
"""Size of an array: (a, b) means a + b m numbers, for m passive joints."""

MACHINE, MOTORS, PASSIVE, JOINTS = (1, 0), (2, 0), (0, 1), (1, 1)
_OWNERS = {"machine": MACHINE, "motor": MOTORS, "passive": PASSIVE, "joint": JOINTS}

MACHINE_NUMBERS: dict[str, Size] = {
    **{name: _OWNERS[each.owner] for name, each in EFFECTS.items() if not each.dynamic_only},
    **dict.fromkeys(("gain", "gearhead_half"), MOTORS),
    **dict.fromkeys(("k", "half_gap", "rest"), PASSIVE),
    "weights": JOINTS,
}
"""Parameters of one machine: effects except those of inertia, and what `_parameters` adds."""

STATE_NUMBERS: dict[str, Size] = {
    **dict.fromkeys(("speed", "slope", "saturated"), MOTORS),
    "slip": (3, 0),  # see `MachineMotion.slip`
    "disk": (2, 0),  # gearhead of motor 1: theta, axis
    "first": (1, 0),  # coordinate of the last disk
    **dict.fromkeys(("theta", "axis", "wound", "gap"), JOINTS),  # gap: largest deviation
}
"""Parts of the state of one sample without inertia."""

MASSES: dict[str, Size] = {each.name: each.metadata["rows"] for each in fields(Masses)}

LIMITED_LAWS, PLAY_LAWS = (4, 4), (2, 1)
"""Numbers of limited laws and of play laws in `StageLaws`."""


def _row_numbers(m: int) -> dict[str, int]:
    """Return the first row of each part of a dynamic state (`StateRows`), for m passive joints."""
    state, bodies = StateRows(m), StateRows(m).bodies
    speeds = {"axes": bodies.axes.start, "disk": bodies.disk, "links": bodies.links.start}
    speeds |= {"stages": bodies.stages.start, "bodies": bodies.count}
    rest = ("behind", "twist", "gap", "reference", "q", "torque")
    return {**speeds, **{name: getattr(state, name).start for name in rest}, "count": state.count}


_NONE, _ONE = _row_numbers(0), _row_numbers(1)
ROWS: dict[str, Size] = {name: (_NONE[name], _ONE[name] - _NONE[name]) for name in _NONE}

DYNAMIC_NUMBERS: dict[str, Size] = {
    "y": ROWS["count"],
    "pieces": (LIMITED_LAWS[0] + PLAY_LAWS[0], LIMITED_LAWS[1] + PLAY_LAWS[1]),
    "gained": (1, 2),
    "energy": (2, 0),
    "slipping": (1, 0),
    "last": (1, 0),
}
"""Parts of the dynamic state of one sample: those of `March`, and the length of the last step."""

MOST_PASSIVE = 16
"""Largest number of passive joints in `dynamic.c`."""

_TABLES = (COUNTS, ARRAYS, STRIDES, MACHINE_NUMBERS, STATE_NUMBERS, DYNAMIC_NUMBERS, MASSES, ROWS)
VERSION = zlib.crc32(repr((*_TABLES, LIMITED_LAWS, PLAY_LAWS, MOST_PASSIVE)).encode())
"""Checksum of the data layout. A kernel with another checksum is refused with a warning."""


def places(table: dict[str, Size], m: int) -> dict[str, slice]:
    """Return where each part of a table lies in an array that holds all of its parts in order, for
    m passive joints."""
    sizes = [a + b * m for a, b in table.values()]
    ends = zip(table, sizes, accumulate(sizes), strict=True)
    return {name: slice(end - size, end) for name, size, end in ends}


class _KernelModel(ctypes.Structure):
    """The C structure `Model` of layout.h."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in COUNTS),
        ("k_g", ctypes.c_double),
        ("gamma", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    ]


class _KernelCommands(ctypes.Structure):
    """The C structure `Commands` of layout.h."""

    _fields_ = [("value", ctypes.c_void_p), *((name, ctypes.c_int64) for name in STRIDES)]


@cache
def library() -> Any | None:
    """Return the compiled kernel, or None if it is missing or was built from other source.

    Without a kernel the first call logs a warning in the logger `planner`. Python prints it on
    standard error unless the program configures logging.
    """
    why = MISSING_WARNING
    for suffix in EXTENSION_SUFFIXES:
        path = Path(__file__).with_name(f"_kernel{suffix}")
        if path.exists():
            try:
                kernel = open_library(path)
            except OSError:  # built for another computer, or incomplete
                continue
            except AttributeError:  # a kernel without a checksum of its source
                kernel = None
            if kernel is not None:
                return kernel
            why = VERSION_WARNING
    logging.getLogger("planner").warning(why)
    return None


def source_checksum(unknown: int) -> int:
    """Return the checksum of the C files in this folder, computed as in setup.py; `unknown` without
    the files, as in a wheel, whose kernel cannot be out of date."""
    files = [Path(__file__).with_name(name) for name in SOURCES]
    if not all(file.exists() for file in files):
        return unknown
    return zlib.crc32(b"".join(file.read_bytes() for file in files))


def open_library(path: Path) -> Any | None:
    """Load the kernel in a file; return None for a kernel of another version (see `library`)."""
    kernel = ctypes.CDLL(str(path))
    versions = kernel.planner_kernel_version, kernel.planner_kernel_source
    for function in versions:
        function.restype = ctypes.c_int64
    layout, source = (function() for function in versions)
    if layout != VERSION or source != source_checksum(source):
        return None
    pointers = ctypes.POINTER(_KernelModel), ctypes.POINTER(_KernelCommands)
    kernel.planner_advance.argtypes = [*pointers, *[ctypes.c_int64] * 4]
    return kernel


def threads() -> int:
    """Return the number of threads to use: OMP_NUM_THREADS if set, else one per core of this
    process."""
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    if wanted.isdigit() and int(wanted) > 0:
        return int(wanted)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class CompiledMotion:
    """Simulation of S manipulators in the compiled kernel; a `MachineMotion`.

    Args:
        system: The manipulator.
        fidelity: "quasi-static" or "dynamic".
        draws, start: See `StepwiseMotion`.
    """

    def __init__(self, system: Manipulator, fidelity: str, draws: Draws, start: Array) -> None:
        kernel = library()
        assert kernel is not None, "ask `library` first"
        self._advance, self._count, n = kernel.planner_advance, draws.count, len(start) - 1
        parameters = _parameters(system, draws)
        self._places = places(STATE_NUMBERS, n - 1)
        self._state = state = _state(system, draws, start)
        read = (state[:, self._places[name]] for name in ("gap", "saturated", "slip"))
        self.deviation, self.saturated_s, self.slip = read
        self._arrays = {  # kept alive while the kernel points into them
            "parameters": np.concatenate([*parameters.values()]).T.copy(),
            "state": self._state,
            **(_moving(system, draws, start) if fidelity == "dynamic" else _NO_INERTIA),
        }
        self._model = _KernelModel(
            samples=draws.count, joints=n, heavy=self._arrays["masses"].shape[1],
            k_g=system.k_g, gamma=GAMMA, **_flags(draws, parameters), **_rows(fidelity, n),
        )  # fmt: skip

    def begin(self, orders: CommandGrid, desired: Array, rows: NDArray[np.int64]) -> None:
        """Begin a stretch where the one before ended; see `MachineMotion.begin`."""
        self._orders, self._k, n = orders, 0, desired.shape[1]
        gap = np.abs(self.coordinates[1:] - desired[0]).T
        np.fmax(self.deviation, gap, out=self.deviation)
        self.q = np.empty((self._count, len(rows), n + 1))
        self.speed = np.empty((self._count, len(rows), 2))
        row = np.full(len(orders.t), -1, dtype=np.int64)
        row[rows] = np.arange(len(rows))
        self._arrays |= {
            "length": lengths(orders.t),
            "running": orders.running.astype(np.uint8),
            "desired": np.ascontiguousarray(desired[:, :, 0]),
            "row": row,
            "q": self.q,
            "speed": self.speed,
        }
        self._model.points = orders.block(0, 1).shape[1]
        self._model.steps, self._model.rows = len(orders.t) - 1, len(rows)
        for name, array in self._arrays.items():
            setattr(self._model, name, array.ctypes.data)

    @property
    def coordinates(self) -> Array:
        """Present coordinates, (N, S)."""
        return np.concatenate([self._state[:, self._places[k]].T for k in ("first", "theta")])

    @property
    def lead(self) -> Array:
        """Present angles of motors and axes before what they drive, see `MachineMotion.lead`."""
        if self._model.dynamic:
            place = StateRows(self._model.joints - 1)
            y = self._arrays["moving"].T
            return np.asarray(y[place.gap] + y[place.twist])
        disk, axis, theta = (self._state[:, self._places[k]].T for k in ("disk", "axis", "theta"))
        return np.concatenate([np.diff(disk, axis=0), axis - theta])

    def advance(self, last: int, tell: Steps | None = None) -> None:
        """Simulate up to the point `last` of the stretch's grid."""
        with ThreadPoolExecutor(threads()) as pool:
            while self._k < last:
                first, self._k = self._k, min(self._k + STEPS_A_CALL, last)
                block = self._orders.block(first, self._k)
                # Counted in numbers; 0 if all samples share the values.
                strides = [step // block.itemsize for step in block.strides]
                strides[3] *= block.shape[3] > 1
                commands = _KernelCommands(block.ctypes.data, *strides)
                begins = range(0, self._count, SAMPLES_A_CALL)
                call = partial(self._call, commands, first=first, last=self._k)
                # For a single call, as in each tick of a closed loop, a thread costs more time.
                calls = pool.map(call, begins) if len(begins) > 1 else map(call, begins)
                for done, _ in enumerate(calls, start=1):
                    if tell:
                        tell(first + (self._k - first) * done // len(begins))

    def _call(self, commands: _KernelCommands, begin: int, first: int, last: int) -> None:
        end = min(begin + SAMPLES_A_CALL, self._count)
        if self._advance(self._model, commands, begin, end, first, last):
            raise MemoryError


def _parameters(system: Manipulator, draws: Draws) -> dict[str, Array]:
    """Return the parameters of S machines in the order of `MACHINE_NUMBERS`, each (count, S)."""
    m = len(system.K)
    half_gap = np.deg2rad(draws["backlash_deg"]) / 2
    weighed = weights(draws, m + 1)
    derived = {
        "gain": 1 + draws["input_gain_error"],
        "gearhead_half": np.deg2rad(draws["gearhead_backlash_deg"]) / 2,
        "lateral_friction": lateral_friction(draws),
        "friction_capacity_nm": friction_capacity(draws),
        "k": gear_constants(system, draws),
        "half_gap": half_gap,
        "rest": half_gap + draws["coulomb_friction_nm"] / draws["shaft_stiffness_nm_per_rad"],
        "weights": np.zeros((m + 1, 1)) if weighed is None else weighed,
    }
    given = {name: derived[name] if name in derived else draws[name] for name in MACHINE_NUMBERS}
    sizes = {name: a + b * m for name, (a, b) in MACHINE_NUMBERS.items()}
    return {name: np.broadcast_to(x, (sizes[name], draws.count)) for name, x in given.items()}


def _flags(draws: Draws, parameters: dict[str, Array]) -> dict[str, int]:
    lagging = draws.has_effect("servo_bandwidth_rad_s")
    soft = np.isfinite(parameters["shaft_stiffness_nm_per_rad"]).all()
    flags = {
        "lagging": lagging,
        "second": lagging and draws.has_effect("servo_damping"),
        "limited": draws.has_effect("velocity_limit_rad_s"),
        "ramped": draws.has_effect("acceleration_limit_rad_s2"),
        "geared_1": parameters["gearhead_half"][0].any(),
        "geared_2": parameters["gearhead_half"][1].any(),
        "lagged": soft and parameters["viscous_friction_nms_per_rad"].any(),
        "soft": soft,
        "damped": not soft and parameters["viscous_friction_nms_per_rad"].any(),
        "creeping": draws.has_effect("creep"),
        "loaded": any(draws.has_effect(name) for name in VARYING_EFFECTS),
        "inclined": parameters["weights"].any(),
    }
    return {name: int(flags[name]) for name in flags}


def _state(system: Manipulator, draws: Draws, start: Array) -> Array:
    """Return the state of S samples at the start, in the order of `STATE_NUMBERS`, (S, numbers)."""
    place = places(STATE_NUMBERS, len(start) - 2)
    state = np.zeros((draws.count, place["gap"].stop))
    parts = {"first": start[:1], "theta": start[1:]}
    parts["slip"] = np.array([[0.0], [-1.0], [-1.0]])
    chain = DiskChain(system, draws, start)
    parts |= {"axis": chain.axes, "disk": chain.disk}
    for name, values in parts.items():
        state[:, place[name]] = values.T
    return state


_NO_INERTIA = {"masses": np.empty((0, 0)), "moving": np.empty((0, 0))}


def _moving(system: Manipulator, draws: Draws, start: Array) -> dict[str, Array]:
    """Return the parameters and the state at the start of S manipulators with inertia, (S, …), in
    the order of the C structures `Masses` and `Moving`."""
    march = begin_march(system, draws, start)
    last = np.full((1, draws.count), np.inf)
    state = [march.y, march.pieces, march.speed_change, march.energy, march.slipping, last]
    return {"masses": march.table.T.copy(), "moving": np.concatenate(state).T.copy()}


def _rows(fidelity: str, n: int) -> dict[str, int]:
    place = StateRows(n - 1)
    dynamic = fidelity == "dynamic"
    return {"dynamic": place.count * dynamic, "coordinates": place.q.start}
