"""Problem files of every kind: units, defaults, limits, and what they refuse."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import InputError
from planner.problem.tables import vehicles
from planner.problem.tables.arms import JointGoal
from planner.problem.tables.kinds import FILES, json_schema
from planner.problem.tables.machine_effects import MachineTable
from planner.problem.tables.method_options import MethodsTable
from planner.problem.tables.problem_file import CompensationTable, FeedbackTable, ObstacleTable
from planner.support.user_tables import Table

ROOT = Path(__file__).parents[2]
VEHICLES = tuple(vehicles.FILES)


def shipped(kind: str) -> planner.Problem:
    return planner.load_problem(ROOT / f"problems/{kind}.toml")


def test_tables_in_place_of_a_file_are_the_problem() -> None:
    car = shipped("car")
    assert planner.load_problem(car.to_dict()) == car
    assert planner.load_problem(car.to_dict(), {"goal.x_m": 2.0}) == car.changed({"goal.x_m": 2.0})


def test_trailers_in_their_units() -> None:
    problem = shipped("trailers").changed(
        {
            "start.x_m": 2.0,
            "start.hitch_deg": [10, -20],
            "start.steering_deg": 5,
            "goal.heading_deg": 30,
            "limits.hitch_deg": [40, 50],
            "limits.heading_deg": 80,
            "limits.acceleration_m_s2": 3.0,
        }
    )
    degrees = np.deg2rad
    np.testing.assert_allclose(problem.start, [2.0, *degrees([5, 10, -20, 0]), 0.0])
    np.testing.assert_allclose(problem.goal[1:], [0, 0, 0, degrees(30), 3.0])
    assert problem.travel == 18.0
    np.testing.assert_allclose(problem.limits.joint, [np.inf, *degrees([45, 40, 50, 80]), np.inf])
    np.testing.assert_array_equal(problem.limits.input, [2.0, 1.0])
    np.testing.assert_array_equal(problem.limits.input_rate, [3.0, np.inf])
    assert problem.limits.z2_margin is None


@pytest.mark.parametrize("kind", sorted(FILES))
def test_every_kind_has_a_shipped_problem(kind: str) -> None:
    """It reads back, fits the schema, and its travel is set whatever its key."""
    import jsonschema  # slow

    problem = shipped("paper" if kind == "manipulator" else kind)
    assert problem.system.kind == kind
    data = json.loads(json.dumps(problem.to_dict()))
    assert planner.Problem.from_dict(data) == problem
    validator = jsonschema.Draft202012Validator(json_schema())
    assert validator.is_valid(data)
    assert not validator.is_valid({**data, "gaol": {}})
    assert problem.travel_key == ("goal.x_m" if kind in VEHICLES else "goal.travel")
    assert problem.with_travel(1.25).travel == 1.25
    free = problem.with_travel(None)
    assert free.travel is None
    assert np.isnan(free.goal[0])


def test_goal_and_travel_agree() -> None:
    car = shipped("car").changed({"start.x_m": 10.0})
    assert car.travel == 15.0
    assert car.goal[0] == 25.0
    arm = shipped("paper").changed({"start.phi_rad": 0.25, "goal.travel": 0.5})
    assert arm.goal[0] == arm.user_goal[0] == 0.75
    assert arm.with_travel(-1.0).goal[0] == -0.75
    assert car.with_travel(-4.0).to_dict()["goal"]["x_m"] == 6.0


@pytest.mark.parametrize(
    ("kind", "changes", "says"),
    [
        ("car", {"goal.travel": 3.0}, "goal.travel"),
        ("car", {"start.theta_deg": [1]}, "start.theta_deg"),
        ("car", {"start.steering_deg": 90}, "start.steering_deg"),
        ("car", {"system.wheelbase_m": -1.0}, "system.wheelbase_m"),
        ("car", {"limits.steering_deg": 90}, "limits.steering_deg"),
        ("car", {"limits.input_rad_s": 1.0}, "limits.input_rad_s"),
        ("car", {"limits.speed": 1.0}, "speed_m_s"),
        ("car", {"limits.z2_margin": 0.1}, "limits.z2_margin"),
        ("unicycle", {"goal.heading_deg": 36001}, "goal.heading_deg"),
        ("unicycle", {"goal.y_m": float("nan")}, "goal.y_m"),
        ("trailers", {"start.hitch_deg": [1]}, "start.hitch_deg has 1 values"),
        ("trailers", {"limits.hitch_deg": [1, 2, 3]}, "limits.hitch_deg has 3 values"),
        ("trailers", {"start.hitch_deg": [70, 0]}, "start hitch1 = 70 deg.*60 deg"),
        ("ball-gear", {"system.K": [1.0]}, "needs 2 values in K"),
        ("ball-gear", {"goal.theta_deg": [1, 2]}, "goal.theta_deg has 2 angles"),
        ("ball-gear", {"limits.input_rad_s": [1.0, 2.0, 3.0]}, "limits.input_rad_s.*has 3 values"),
        ("ball-gear", {"goal.travel": 60}, "looks like degrees"),
        ("custom", {"start.q": {"x": 0.0}}, "start.q lacks heading, y, area"),
        ("custom", {"limits.q": {"hading": 1.0}}, "did you mean 'heading'"),
        ("custom", {"goal.q": {"x": 0.0}}, "goal.q has no coordinate 'x'"),
        ("custom", {"system.units": ["m"]}, "units has 1 entries for 4"),
        ("custom", {"system.slopes": ["tan(heading)", "x"]}, "slope of area depends on x"),
        ("custom", {"system.kind": "tractor"}, "allowed: manipulator"),
    ],
)
def test_wrong_files_name_the_key(kind: str, changes: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        shipped(kind).changed(changes)


def test_a_u_turn_is_no_contradiction_in_a_file_but_no_chart_covers_it() -> None:
    problem = shipped("unicycle").changed({"goal.heading_deg": 180, "goal.x_m": 0.0})
    with pytest.raises(planner.SingularError):
        planner.solve(problem, "polynomial")


def test_none_removes_any_key() -> None:
    file = ROOT / "problems/obstacle.toml"
    changes = {"obstacles": None, "limits.joint_deg": None, "machine.backlash_deg": None}
    bare = planner.load_problem(file, changes)
    assert bare.obstacles == ()
    assert "obstacles" not in bare.to_dict()
    assert "joint_deg" not in bare.to_dict()["limits"]
    with pytest.raises(planner.InputError, match="'start'"):
        bare.changed({"start": None})


def test_every_key_that_users_set_is_described_by_the_text_below_it() -> None:
    tables = [CompensationTable, FeedbackTable, MachineTable, ObstacleTable]
    tables += [JointGoal, vehicles.PoseGoal]
    tables += [field.annotation for field in MethodsTable.model_fields.values()]
    for table in tables:
        for name, field in table.model_fields.items():
            assert field.description, f"{table.__name__}.{name}"
            assert "\n" not in field.description
    assert JointGoal.model_fields["duration"].description == "Duration in seconds, or 'free'."


def test_a_table_without_a_source_has_no_texts() -> None:
    typed: dict[str, Any] = {"Table": Table, "__name__": "typed"}
    exec("class Typed(Table):\n    a: int = 1\n    'a text'\n", typed)
    assert typed["Typed"].model_fields["a"].description is None
