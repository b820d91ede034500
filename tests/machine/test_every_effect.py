"""Every effect of the machine acts on the motion, in compiled code as in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from

from planner import Machine, Plan, replay
from planner.problem.tables.machine_effects import EFFECTS

ADDED = {
    "servo_damping": 0.7,
    "velocity_limit_rad_s": 1.0,
    "torque_limit_nm": 0.5,
    "link_length_m": 0.1,
    "incline_deg": 3.0,
}
"""Effects that the prototype lacks, or that would not act on so slow a plan."""

LESS = {"value": 0.9, "spread": 0.5}

READ = {"encoder_noise_deg", "encoder_resolution_deg"}
"""Effects on what encoders read, which act with feedback only."""


@pytest.fixture(scope="module")
def plan() -> Plan:
    """1 s with a jump, both directions."""
    u = inputs(([1.8], [0.5, 0.1]), ([-1.2], [0.3]), breaks=[0.0, 0.7, 1.0])
    return plan_from(arm_problem([10, 20, 15], end=1.0), u, pieces=20)


@pytest.mark.parametrize("fidelity", ["quasi-static", "dynamic"])
def test_every_effect_acts_and_compiled_code_has_it(
    plan: Plan, fidelity: str, library: Any, use: Any
) -> None:
    machine = Machine.prototype(fidelity=fidelity, step_s=0.005, **ADDED)
    assert set(machine.effects) == set(EFFECTS), "give a new effect a value in ADDED"

    def ends(one: Machine) -> np.ndarray:
        return replay(plan, one, samples=3, seed=1, settle_s=0.1).q[:, -1]

    use(None)
    stepwise = ends(machine)
    use(library)
    compiled = ends(machine)
    assert compiled == pytest.approx(stepwise, abs=1e-12, rel=0)

    def changed(name: str) -> Machine:
        """With nine tenths of the effect's value and half of its spread."""
        setting = machine.to_dict()[name]
        old = setting if isinstance(setting, dict) else {"value": setting, "spread": 0.0}
        less = {key: (factor * np.array(old[key])).tolist() for key, factor in LESS.items()}
        return machine.with_(**{name: less if less["spread"] else less["value"]})

    here = {name for name, e in EFFECTS.items() if fidelity == "dynamic" or not e.dynamic_only}
    idle = {name for name in here if np.array_equal(ends(changed(name)), compiled)}
    assert idle == READ, "effects without arithmetic"


@pytest.mark.parametrize("fidelity", ["quasi-static", "dynamic"])
def test_an_arm_at_rest_stays_there(fidelity: str) -> None:
    """Whatever loads it: gears, shafts and velocity loops hold it at the start."""
    still = plan_from(arm_problem([10, 20, 15], end=0.5), inputs(([0.0], [0.0]), breaks=[0.0, 0.5]))
    machine = Machine.prototype(fidelity=fidelity, **ADDED).nominal()
    q = replay(still, machine.with_(coulomb_friction_nm=0.001, base_friction_nm=0.001)).q
    assert np.ptp(q, axis=1) == pytest.approx(0.0, abs=1e-6)
