"""Machines as sets of settings: presets, variations, messages."""

from __future__ import annotations

import copy
import json
import pickle
from typing import Any

import pytest
from handmade import arm_problem

from planner import InputError, Machine
from planner.problem.tables.machine_effects import EFFECTS, MachineTable


def test_ideal_has_no_effect_and_prototype_has_nearly_all() -> None:
    assert not Machine.ideal().effects
    assert len(Machine.prototype().effects) > 0.8 * len(EFFECTS)


def test_every_effect_tells_its_unit() -> None:
    words = {
        "": "",
        "s": "seconds",
        "rad/s": "rad/s",
        "rad/s^2": "rad/s^2",
        "deg": "degrees",
        "N m": "N m",
        "1/(N m)": "per N m",
        "N m/rad": "N m/rad",
        "N m s/rad": "N m s/rad",
        "kg m^2": "kg m^2",
        "kg m": "kg m",
        "m": "metres",
    }
    for name, effect in EFFECTS.items():
        description = MachineTable.model_fields[name].description or ""
        assert words[effect.unit] in description, name
        assert description.endswith((".", "(fraction).")), name


def test_effects_of_one_fidelity_say_so() -> None:
    for name, effect in EFFECTS.items():
        description = MachineTable.model_fields[name].description or ""
        assert effect.dynamic_only is ("(dynamic)" in description), name
    assert Machine.prototype().fidelity == Machine.ideal().fidelity == "quasi-static"
    moving = Machine.prototype(fidelity="dynamic")
    assert moving != Machine.prototype()
    assert Machine.from_table(moving.to_dict()) == moving
    assert moving.without("creep").nominal().only("creep_per_nm").fidelity == "dynamic"


def test_variations_leave_the_original_alone() -> None:
    machine = Machine.prototype()
    before = machine.to_dict()
    softer = machine.with_(backlash_deg=0.5, creep={"value": 0.01, "spread": 0.001})
    assert softer.effects["backlash_deg"].value == (0.5,)
    assert softer.effects["backlash_deg"].spread == (0.0,)
    assert softer.effects["creep"].spread == (0.001,)
    assert "creep" not in machine.without("creep", "delay_s").effects
    assert set(machine.only("creep", "delay_s").effects) == {"creep", "delay_s"}
    nominal = machine.nominal()
    assert set(nominal.effects) == set(machine.effects)
    assert not any(effect.varies for effect in nominal.effects.values())
    assert machine.to_dict() == before
    with pytest.raises(TypeError):
        machine.effects["creep"] = machine.effects["creep"]  # type: ignore[index]


@pytest.mark.parametrize(
    "machine",
    [
        Machine.prototype(),
        Machine.ideal(),
        Machine.ideal(fidelity="dynamic", link_inertia_kgm2=[0.1, 0.05, 0.02]),
        Machine.ideal(step_s=0.0005, velocity_limit_rad_s=[1, 2]),
        Machine.prototype(backlash_deg={"value": [1, 2], "spread": [0.1, 0]}, creep=False),
    ],
)
def test_round_trips(machine: Machine) -> None:
    assert Machine.from_table(json.loads(json.dumps(machine.to_dict()))) == machine
    assert pickle.loads(pickle.dumps(machine)) == machine
    assert copy.deepcopy(machine) == machine
    assert eval(repr(machine), {"Machine": Machine}) == machine
    assert hash(machine) == hash(copy.deepcopy(machine))


def test_repr_tells_what_differs_from_the_preset() -> None:
    assert repr(Machine.prototype()) == "Machine.prototype()"
    text = repr(Machine.prototype(backlash_deg=0.5).without("creep"))
    assert text == "Machine.prototype(creep=False, backlash_deg=0.5)"


def test_a_machine_prints_its_effects_and_hands_out_their_means() -> None:
    machine = Machine.ideal(
        backlash_deg={"value": 2.0, "spread": 0.5}, coulomb_friction_nm=[1, 2, 3]
    )
    assert [line.split() for line in str(machine).splitlines()] == [
        ["ideal", "machine,", "quasi-static"],
        ["backlash_deg", "2", "±", "0.5", "deg"],
        ["coulomb_friction_nm", "1,", "2,", "3", "N", "m"],
    ]
    assert machine.backlash_deg == 2.0
    assert machine.coulomb_friction_nm == [1, 2, 3]
    assert machine.gear_ratio_error == 0
    with pytest.raises(AttributeError, match="'backlash_deg'"):
        _ = machine.baklash_deg


@pytest.mark.filterwarnings("ignore::planner.InputWarning")  # angles of one degree
def test_a_problem_file_overrides_its_preset() -> None:
    table = {"preset": "ideal", "backlash_deg": {"value": [1.0, 2.0], "spread": 0.1}}
    problem = arm_problem([1, 1, 1], machine=table)
    assert Machine.from_table(problem.machine) == Machine.ideal(backlash_deg=table["backlash_deg"])
    again = type(problem).from_dict(problem.to_dict())
    assert again.to_dict()["machine"] == table
    assert again == problem
    ideal = Machine.from_table(arm_problem([1, 1], machine={"preset": "ideal"}).machine)
    assert ideal == Machine.ideal()
    assert Machine.from_table(arm_problem([1, 1]).machine) == Machine.prototype()


BAD: list[tuple[dict[str, Any], list[str]]] = [
    ({"backlash": 1}, ["unknown key 'machine.backlash'", "did you mean 'backlash_deg'?"]),
    ({"backlash_deg": -1}, ["'machine.backlash_deg' = -1", "must be >= 0 deg"]),
    ({"backlash_deg": 60}, ["must be <= 45 deg"]),
    ({"backlash_deg": True}, ["'machine.backlash_deg' = True", "a number", "false to switch"]),
    ({"backlash_deg": "0.5"}, ["'machine.backlash_deg' = '0.5'", "must be a number"]),
    ({"backlash_deg": [1, "a"]}, ["must hold numbers, one for each of joints 2 ... n"]),
    ({"backlash_deg": [1, 2, 3]}, ["machine.backlash_deg has 3 values", "one, or 2 for joints 2"]),
    ({"backlash_deg": {"value": 1, "spread": [1, 1, 1]}}, ["machine.backlash_deg has 3 values"]),
    ({"initial_angle_error_deg": [1, 2]}, ["has 2 values, but needs one, or 3 for joints 1"]),
    ({"backlash_deg": {"spread": 1}}, ["needs a value beside its spread"]),
    ({"backlash_deg": {"value": 1, "spred": 1}}, ["unknown key 'spred'", "'spread'"]),
    ({"backlash_deg": {"value": 1, "spread": -1}}, ["spread is a standard deviation"]),
    ({"backlash_deg": float("nan")}, ["must be a finite number"]),
    ({"velocity_limit_rad_s": [1, 2, 3]}, ["has 3 values", "one for each of 2 motors"]),
    ({"velocity_limit_rad_s": 0}, ["must be > 0 rad/s; false switches it off"]),
    ({"velocity_limit_rad_s": float("inf")}, ["must be a finite number; false switches"]),
    ({"creep": 1.5}, ["'machine.creep' = 1.5", "must be <= 1"]),
    ({"creep": [0.1]}, ["is one number for the whole machine"]),
    ({"control_period_s": {"value": 0.01, "spread": 0.001}}, ["cannot have a spread"]),
    ({"fidelity": "static"}, ["'machine.fidelity' = 'static'", "'quasi-static' or 'dynamic'"]),
    ({"motor_inertia_kgm2": -1}, ["must be >= 0 kg m^2"]),
    ({"link_inertia_kgm2": [0.1, 0.2]}, ["has 2 values, but needs one, or 3 for joints 1"]),
    ({"step_s": 0.1}, ["'machine.step_s' = 0.1", "at most 0.01"]),
    ({"step_s": 1e-9}, ["'machine.step_s' = 1e-09", "at least 1e-06"]),
    ({"control_period_s": 1e-9}, ["control_period_s", "> 1e-05", "false switches it off"]),
    ({"preset": "prototyp"}, ["'machine.preset' = 'prototyp'", "'prototype' or 'ideal'"]),
]


@pytest.mark.parametrize(("table", "parts"), BAD, ids=[str(table) for table, _ in BAD])
def test_bad_tables_give_one_line_that_names_the_key(
    table: dict[str, Any], parts: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        arm_problem([1, 1, 1], machine=table)
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_names_are_checked_in_code_too() -> None:
    with pytest.raises(InputError, match=r"'backlash'.*'backlash_deg'"):
        Machine.prototype().without("backlash")
    with pytest.raises(InputError, match="'creeep'"):
        Machine.prototype().only("creeep")
    with pytest.raises(InputError, match=r"^machine: .*'backlash'"):
        Machine.prototype(backlash=1)


def test_the_json_schema_lists_every_effect() -> None:
    properties = MachineTable.model_json_schema()["properties"]
    assert set(EFFECTS) <= set(properties)
    kinds = properties["creep"]["anyOf"]
    assert {"type": "number"} in kinds
    assert {"const": False, "type": "boolean"} in kinds
