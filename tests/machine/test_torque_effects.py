"""Every effect that loads a contact or winds up a shaft: seen by what predicts the arm's motion.

Not only the emulator computes with torques. `contact_load` predicts the loads of the contacts,
`feedback/means.py` the mean lost motion, lag and loss of rate, `run_up` the motion before a plan. A
new effect stands in `TORQUES`, with a reason for each of the three that leaves it out, or in
`NO_TORQUE`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from

import planner
from planner.machine.feedback import means
from planner.machine.feedback.run_up import run_up
from planner.machine.friction.contact_load import contact_load
from planner.problem.tables.machine_effects import EFFECTS
from planner.problem.tables.problem_file import FeedbackTable

INERTIA = "its torque is less than a hundredth of the friction's, in ten seconds"
LEVEL = "the tracker and compensated plans assume a level plane"
RATE = "it changes a rate, no torque"
SLOW = "at the run-up's speeds a joint follows it before the plan starts (REST_S)"
SMALL = "it loses rate of the drives; the tracker corrects that"
MOTOR = "a drive's own, before the first contact"
TWIST = "it acts while a shaft's twist changes; the loads are those of steady motion"
BASE = "motor 2 drives joint 1 without a contact or a soft shaft"

TORQUES: dict[str, tuple[float, dict[str, str]]] = {
    "motor_inertia_kgm2": (0.1, {"contact_load": MOTOR, "means": MOTOR, "run_up": MOTOR}),
    "servo_gain_nms_per_rad": (50.0, {"contact_load": MOTOR, "means": MOTOR, "run_up": MOTOR}),
    "servo_integral_time_s": (0.1, {"contact_load": MOTOR, "means": MOTOR, "run_up": MOTOR}),
    "torque_limit_nm": (30.0, {"contact_load": MOTOR, "means": MOTOR, "run_up": MOTOR}),
    "creep_per_nm": (0.02, {"contact_load": RATE, "run_up": SMALL}),
    "lateral_friction": (0.3, {"run_up": SMALL}),
    "friction_capacity_nm": (2.0, {"run_up": SMALL}),
    "disk_inertia_kgm2": (0.01, {"contact_load": INERTIA, "means": INERTIA, "run_up": INERTIA}),
    "axis_inertia_kgm2": (0.01, {"contact_load": INERTIA, "means": INERTIA, "run_up": INERTIA}),
    "shaft_stiffness_nm_per_rad": (20.0, {"contact_load": "it passes a torque on and makes none"}),
    "shaft_damping_nms_per_rad": (0.1, {"contact_load": TWIST, "means": TWIST, "run_up": TWIST}),
    "link_inertia_kgm2": (0.5, {"contact_load": INERTIA, "means": INERTIA}),
    "link_length_m": (0.3, {"contact_load": INERTIA, "means": INERTIA, "run_up": INERTIA}),
    "base_friction_nm": (0.3, {"contact_load": BASE, "means": BASE, "run_up": BASE}),
    "coulomb_friction_nm": (0.2, {}),
    "viscous_friction_nms_per_rad": (0.05, {"run_up": SLOW}),
    "incline_deg": (3.0, {"means": LEVEL, "run_up": LEVEL}),
    "link_moment_kgm": (0.05, {"means": LEVEL, "run_up": LEVEL}),
}
"""By effect: a value, and the places that do not depend on it, with the reason."""

NO_TORQUE = {
    "control_period_s",
    "delay_s",
    "velocity_resolution_rad_s",
    "input_gain_error",
    "input_bias_rad_s",
    "velocity_limit_rad_s",
    "acceleration_limit_rad_s2",
    "servo_bandwidth_rad_s",
    "servo_damping",
    "creep",
    "gear_ratio_error",
    "gearhead_backlash_deg",
    "backlash_deg",
    "initial_play",
    "initial_angle_error_deg",
    "encoder_noise_deg",
    "encoder_resolution_deg",
}


def loads(plan: planner.Plan, machine: planner.Machine) -> list[Any]:
    return list(vars(contact_load(plan, machine)).values())


def mean_properties(plan: planner.Plan, machine: planner.Machine) -> list[Any]:
    system, q = plan.problem.system, plan.q(np.linspace(0.0, plan.duration, 9))
    of_system = (means.shift_of, means.gearhead_play, means.lost_motion)
    found = [each(system, machine) for each in of_system]
    return [*found, means.mean_passing(system, machine, q), means.input_limit(plan, machine)]


def approach(plan: planner.Plan, machine: planner.Machine) -> list[Any]:
    found = run_up(plan, machine, FeedbackTable(run_up=True))
    assert found is not None
    return [found.t, found.q, found.u]


PLACES: dict[str, Callable[[planner.Plan, planner.Machine], list[Any]]] = {
    "contact_load": loads,
    "means": mean_properties,
    "run_up": approach,
}


@pytest.fixture(scope="module")
def plan() -> planner.Plan:
    """Three joints, disk and joint 1 at constant speeds for two seconds."""
    speeds = inputs(([0.4], [0.1]), breaks=[0.0, 2.0])
    return plan_from(arm_problem([20.0, 15.0, 10.0], 2.0), speeds, pieces=20)


def test_every_effect_is_said_to_have_a_torque_or_none() -> None:
    said = set(TORQUES)
    assert not said & NO_TORQUE
    assert said | NO_TORQUE == set(EFFECTS), "a new effect belongs in TORQUES or NO_TORQUE"
    torques = {name for name, e in EFFECTS.items() if "N m" in e.unit or "kg m" in e.unit}
    assert torques | {name for name in EFFECTS if "friction" in name} <= said


@pytest.mark.parametrize("name", TORQUES)
def test_a_torque_is_seen_wherever_it_is_not_excused(name: str, plan: planner.Plan) -> None:
    every = {key: value for key, (value, _) in TORQUES.items()}
    value, excused = TORQUES[name]
    machine = planner.Machine.ideal(fidelity="dynamic", backlash_deg=1.0, **every)
    other = machine.with_(**{name: 1.3 * value})
    for place, look in PLACES.items():
        before, after = look(plan, machine), look(plan, other)
        same = all(
            np.shape(a) == np.shape(b) and np.array_equal(a, b)
            for a, b in zip(before, after, strict=True)
        )
        assert same == (place in excused), f"{place} and {name}"
        assert place not in excused or excused[place]
