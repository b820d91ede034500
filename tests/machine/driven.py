"""Dynamic manipulators driven by hand, without plans; compiled code does their steps."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np
from handmade import draws_of

from planner import Manipulator
from planner.machine import compiled
from planner.machine.march import GAMMA, March
from planner.machine.stepwise import DynamicChain
from planner.systems.manipulator import chain_inertia

INERTIA: dict[str, Any] = {
    "motor_inertia_kgm2": 0.01,
    "disk_inertia_kgm2": 1e-4,
    "axis_inertia_kgm2": 1e-5,
    "link_inertia_kgm2": 0.03,
}
SOFT: dict[str, Any] = {
    **INERTIA,
    "servo_gain_nms_per_rad": 2.0,
    "servo_integral_time_s": 0.05,
    "shaft_stiffness_nm_per_rad": 4.0,
    "shaft_damping_nms_per_rad": 0.02,
    "viscous_friction_nms_per_rad": 0.05,
}
EVENTS: dict[str, dict[str, Any]] = {
    "smooth": SOFT,
    "creep": {**SOFT, "creep": 0.003, "creep_per_nm": 0.01},
    "sideways": {
        **SOFT,
        "creep": 0.003,
        "creep_per_nm": 0.01,
        "lateral_friction": 0.3,
        "friction_capacity_nm": 0.5,
    },
    "play": {**SOFT, "backlash_deg": 2.0},
    "coulomb": {**SOFT, "coulomb_friction_nm": 0.05, "base_friction_nm": 0.02},
    "slip": {**SOFT, "creep_per_nm": 0.01, "friction_capacity_nm": 0.05},
    "torque limit": {**SOFT, "torque_limit_nm": 0.2},
    "chain": {**SOFT, "link_length_m": 0.2, "link_moment_kgm": 0.1},
    "inclined": {
        **SOFT,
        "backlash_deg": 2.0,
        "coulomb_friction_nm": 0.02,
        "incline_deg": 20.0,
        "link_moment_kgm": 0.05,
    },
    "all": {
        **SOFT,
        "backlash_deg": 2.0,
        "coulomb_friction_nm": 0.05,
        "creep": 0.003,
        "creep_per_nm": 0.01,
        "lateral_friction": 0.2,
        "friction_capacity_nm": 0.3,
        "torque_limit_nm": 0.3,
    },
}
"""What happens within a second under `swing`."""

Speeds = Callable[[float], np.ndarray]


def arm(n: int) -> Manipulator:
    return Manipulator([0.87 * 0.8 ** (i - 2) for i in range(2, n + 1)], 0.67)


def start(n: int, samples: int = 1) -> np.ndarray:
    q = np.deg2rad(np.array([0.0, *np.linspace(10, 20, n)]))
    return np.repeat(q[:, None], samples, axis=1)


@cache
def c_march(library: Any) -> Any:
    """The function of C that does what `March.step` does."""
    function = library.planner_dynamic_march
    function.argtypes = [ctypes.c_int64] * 3 + [ctypes.c_double] * 4 + [ctypes.c_void_p] * 8
    return function


class CompiledMarch(March):
    """The same steps in C; its arrays stay where they are."""

    @cached_property
    def table(self) -> np.ndarray:
        return super().table

    @cached_property
    def places(self) -> list[int]:
        state = (self.y, self.pieces, self.speed_change, self.energy, self.slipping)
        return [each.ctypes.data for each in (self.table, *state)]

    def step(self, mean: np.ndarray, swing: np.ndarray, h: float, lead: float) -> None:
        mean, swing = np.ascontiguousarray(mean), np.ascontiguousarray(swing)
        masses, *state = self.places
        sizes = (self.place.bodies.m, *self.y.shape, h, lead, GAMMA, self.k_g)
        inputs = (masses, mean.ctypes.data, swing.ctypes.data)
        c_march(compiled.library())(*sizes, *inputs, *state)


class Driven(DynamicChain):
    """Compiled code does its steps, where that is there; it tells of its torques and energies."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        if compiled.library() is not None:
            self._march = CompiledMarch(**vars(self._march))

    @property
    def shaft_torque(self) -> np.ndarray:
        """Of the shafts into joints 2 … n, springs and damping, (n−1, S), N m."""
        return np.asarray(self._y[self._place.torque][2:])

    @property
    def gap(self) -> np.ndarray:
        """Where the axes of joints 2 … n are in their play, (n−1, S), rad; 0 is the middle."""
        return np.asarray(self._y[self._place.gap][2:])

    @property
    def stored_J(self) -> np.ndarray:
        """Kinetic energy, that of the shafts, and of the links' height, (S,), J."""
        data, links = self._march.data, self._place.bodies.links
        v, twist = self._y[self._place.v].copy(), self._y[self._place.twist]
        angles, v[links] = np.cumsum(self.q[1:], axis=0), np.cumsum(v[links], axis=0)
        chain = chain_inertia(data.inertia[links], data.lengths, data.moments, angles)
        kinetic = np.einsum("js,jks,ks->s", v[links], chain, v[links])
        v[links] = 0.0
        kinetic += np.sum(data.inertia * v * v, axis=0)
        elastic = np.sum(data.stiffness * twist * twist, axis=0)
        raised = np.sum(data.weights * np.sin(angles), axis=0)
        return np.asarray((kinetic + elastic) / 2 + raised)

    @property
    def work_J(self) -> np.ndarray:
        """Work of the motors so far, (S,), J."""
        return np.asarray(self._march.energy[0])

    @property
    def lost_J(self) -> np.ndarray:
        """What friction, slip and damping took of it, (S,), J; rigid teeth that meet take more."""
        return np.asarray(self._march.energy[1])


def chain(n: int = 3, samples: int = 1, **effects: Any) -> Driven:
    return Driven(arm(n), draws_of(n, samples, **effects), start(n, samples))


def swing(t: float) -> np.ndarray:
    """Smooth speeds of both motors that reverse, (2,), rad/s."""
    return np.array([0.6 * np.sin(2 * np.pi * t), 0.4 * np.sin(3 * t) ** 3])


def drive(
    plant: Driven,
    steps: int,
    speed: Speeds = swing,
    end: float = 1.0,
    see: Callable[[], np.ndarray] | None = None,
) -> np.ndarray:
    """What `see` returns after each step (sample 0 of the coordinates by default)."""
    h, seen = end / steps, []
    for k in range(steps):
        points = np.stack([speed(t) for t in k * h + h * np.array([0, 0.5, 1 - 1e-12])])
        way = h / 6 * (points[0] + 4 * points[1] + points[2])
        plant.step(points[:, :, None], np.stack([way / 2, way])[:, :, None], h)
        seen.append(see() if see else plant.q[:, 0].copy())
    return np.array(seen)


@cache
def swung(name: str, steps: int) -> tuple[np.ndarray, float]:
    """A second of `EVENTS[name]` under `swing`: sample 0 after each step, and energy unaccounted.

    The energy is what the motors put in and is neither stored nor lost, as part of the former.
    """
    plant = chain(3, **EVENTS[name])
    before = plant.stored_J
    history = drive(plant, steps)
    missing = plant.work_J - plant.lost_J - (plant.stored_J - before)
    assert plant.lost_J[0] > 0.1 * plant.work_J[0]
    return history, float(missing[0] / plant.work_J[0])


def constant(*speeds: float) -> Speeds:
    return lambda t: np.array(speeds)
