"""What a sweep file may say, and the message when it says something else."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from command import main

import planner
from planner import Sweep

Tables = dict[str, Any]
GOOD = """
problem = "paper.toml"
methods = ["polynomial", "polynomial:travel=middle"]
[set]
"goal.duration" = 20
[grid]
"goal.travel" = [0.80, 0.82, "free"]
"limits.z2_margin" = { from = 0.001, to = 0.01, count = 2 }
"""


def test_a_file_gives_points_and_methods(written: Callable[[str], Path]) -> None:
    sweep = Sweep.load(written(GOOD))
    assert sweep.keys == ("goal.travel", "limits.z2_margin")
    assert len(sweep.points) == 6
    assert len(sweep) == 12
    assert sweep.points[0] == {"goal.travel": 0.8, "limits.z2_margin": 0.001}
    assert sweep.points[5] == {"goal.travel": "free", "limits.z2_margin": 0.01}
    assert [m.options for m in sweep.methods] == [{}, {"travel": "middle"}]
    assert sweep.base.duration == 20


def test_nested_tables_say_the_same_as_dotted_keys(written: Callable[[str], Path]) -> None:
    nested = GOOD.replace('"goal.travel"', "goal.travel").replace(
        '"goal.duration"', "goal.duration"
    )
    assert Sweep.load(written(nested)).to_dict() == Sweep.load(written(GOOD)).to_dict()


def test_its_tables_give_it_back(written: Callable[[str], Path]) -> None:
    sweep = Sweep.load(written(GOOD))
    again = Sweep.from_dict(sweep.to_dict())
    assert again.points == sweep.points
    assert again.base == sweep.base


def test_python_objects_are_as_good_as_tables(paper: planner.Problem) -> None:
    sweep = Sweep.from_dict(
        {
            "problem": paper,
            "methods": ("polynomial",),
            "grid": {"goal.travel": np.linspace(0.8, 0.82, 3), "limits.joint_deg": (80, 81)},
        }
    )
    assert len(sweep) == 6
    assert type(sweep.points[0]["goal.travel"]) is float
    assert sweep.base == paper


def test_rows_keep_together_and_combine_with_the_grid(tables: Tables) -> None:
    rows = [{"goal.travel": 0.8, "limits.joint_deg": 70}, {"goal.travel": 0.81}]
    sweep = Sweep.from_dict({**tables, "cases": rows, "grid": {"goal.duration": [9.0, 10.0]}})
    assert sweep.points == (
        {"goal.travel": 0.8, "limits.joint_deg": 70, "goal.duration": 9.0},
        {"goal.travel": 0.8, "limits.joint_deg": 70, "goal.duration": 10.0},
        {"goal.travel": 0.81, "goal.duration": 9.0},
        {"goal.travel": 0.81, "goal.duration": 10.0},
    )


def test_a_value_that_only_clashes_with_others_is_left_to_its_case(tables: Tables) -> None:
    grid = {"start.theta_deg": [[1, 1, 1], [85, 1, 1]]}  # beyond limits.joint_deg = 80
    assert len(Sweep.from_dict({**tables, "grid": grid})) == 2


ENDS, EVEN = {"from": 0, "to": 1, "count": 2}, {"uniform": [0, 1]}
SAMPLE = {"count": 4, "goal.travel": {"uniform": [0.8, 0.82]}}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"grids": {}}, "unknown key 'grids'.*did you mean 'grid'"),
        ({"methods": []}, "'methods' = \\[\\]: must be a list of at least 1"),
        ({"methods": ["polynomail"]}, "did you mean 'polynomial'"),
        ({"methods": ["polynomial", "polynomial"]}, "named twice"),
        ({"methods": ["polynomial:point=1"]}, "did you mean 'points'"),
        ({"problem": "nowhere.toml"}, "no file nowhere.toml; the name is relative to"),
        ({"problem": {}}, "missing key 'system.kind'"),
        ({"grid": {}}, "nothing varies"),
        ({"grid": {"goal.travel": []}}, "'grid.goal.travel' = \\[\\]: must be a list of at"),
        ({"grid": {"goal.travel": 0.8}}, "'grid.goal.travel' = 0.8: must be a list"),
        ({"grid": {"goal.travell": [0.8]}}, "unknown key 'goal.travell'.*did you mean 'travel'"),
        ({"grid": {"gaol.travel": [0.8]}}, "unknown key 'gaol'.*did you mean 'goal'"),
        ({"grid": {"goal.travel.x": [0.8]}}, "cannot set 'goal.travel.x': 'travel' is not a table"),
        ({"grid": {"goal.travel": [0.8, float("nan")]}}, "'goal.travel' = nan.*finite number"),
        ({"grid": {"goal.travel": [0.8, "some"]}}, "'goal.travel' = 'some': must be 'free' or"),
        ({"grid": {"goal.travel": [0.8, 45.0]}}, "45 looks like degrees"),
        ({"grid": {"goal.duration": [10, -1]}}, "'goal.duration' = -1"),
        ({"grid": {"goal.travel": [0.8, 0.8]}}, "'goal.travel' has the value 0.8 twice"),
        ({"grid": {"system.kind": ["manipulater"]}}, "did you mean 'manipulator'"),
        ({"grid": {"system": [5]}}, "missing key 'system.kind'"),
        ({"grid": {"goal": [{"travel": 1}], "goal.travel": [1]}}, "one contains the other"),
        ({"grid": {"machine.backlash_deg": [0.0, 1.0]}}, "add \\[replay\\] samples"),
        ({"grid": {"method.collocation.degree": [2]}}, "'collocation' is not one of the methods"),
        ({"grid": {"method.polynomial.travle": ["auto"]}}, "did you mean 'travel'"),
        ({"grid": {"goal.travel": {"from": 1, "to": 2}}}, "missing key 'grid.goal.travel.count'"),
        ({"grid": {"goal.travel": {"from": 1, "to": 1, "count": 2}}}, "are the same"),
        ({"grid": {"goal.travel": {**ENDS, "spacing": "log"}}}, "two ends of the same sign"),
        ({"set": {"goal.travell": 1}}, "unknown key 'goal.travell'"),
        ({"cases": [{"goal.travel": 0.8}, {"goal.travell": 0.8}]}, "unknown key 'goal.travell'"),
        ({"cases": [{"goal.duration": 1.0}]}, "'goal.duration' varies in two of"),
        ({"sample": {"count": 4}}, "names no key to draw"),
        ({"sample": {**SAMPLE, "cuont": 4}}, "unknown key 'cuont'; did you mean 'count'"),
        ({"sample": {"goal.travel": {"uniform": [0, 1]}}}, "missing key 'sample.count'"),
        ({"sample": {**SAMPLE, "count": 0}}, "'sample.count' = 0: must be at least 1"),
        ({"sample": {**SAMPLE, "seed": -1}}, "'sample.seed' = -1: must be at least 0"),
        ({"sample": {"count": 4, "goal.travel": {"uniform": [1, 0]}}}, "must be the lower"),
        ({"sample": {"count": 4, "goal.travel": {"uniform": [0, 99]}}}, "looks like degrees"),
        ({"sample": {"count": 4, "goal.travel": {"unifrom": [0, 1]}}}, "did you mean 'uniform'"),
        ({"sample": {"count": 4, "goal.travel": {**EVEN, "normal": [0, 1]}}}, "exactly one of"),
        ({"sample": {"count": 4, "goal.travel": {"log_uniform": [0, 1]}}}, "must be positive"),
        ({"count": 4}, "'count' is outside of all tables: put it under \\[sample\\]"),
        ({"samples": 4}, "'samples' is outside of all tables: put it under \\[replay\\]"),
        ({"limits.z2_margin": EVEN}, "put it under \\[set\\] .* or \\[sample\\]"),
        ({"goal": {"travel": EVEN}}, "'goal' is outside of all tables: put it under"),
        ({"grid": {"goal.travel": EVEN}}, "'grid.goal.travel' is drawn at random: put it under"),
        ({"grid": {"count": 20}}, "'grid.count' belongs under \\[sample\\]"),
        ({"grid": {"seed": 1}}, "'grid.seed' belongs under \\[sample\\] or \\[replay\\]"),
        ({"set": {"samples": 100}}, "'set.samples' belongs under \\[replay\\]"),
        ({"sample": {"count": 4, "goal.travel": 0.8}}, "a single value: put it under \\[set\\]"),
        ({"sample": {"count": 4, "goal.travel": [0.8, 0.9]}}, "put it under \\[grid\\]"),
        ({"sample": {"count": 4, "goal.travel": {**ENDS, "count": 3}}}, "under \\[grid\\]"),
        ({"replay": {"samples": -1}}, "'replay.samples' = -1: must be at least 0"),
        ({"grid": {f"limits.{k}": {**ENDS, "count": 2000} for k in "ab"}}, "4000000 points are"),
    ],
)  # fmt: skip
def test_bad_descriptions_are_named(tables: Tables, changes: Tables, says: str) -> None:
    with pytest.raises(planner.InputError, match=says) as info:
        Sweep.from_dict({**tables, **changes})
    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("goal.durration", "20.0", "did you mean 'duration'"),
        ("goal.duration", "[10, 20]", "values to vary belongs under \\[grid\\]"),
    ],
)
def test_a_wrong_change_names_the_sweep_file(
    written: Callable[[str], Path], key: str, value: str, says: str
) -> None:
    path = written(GOOD.replace('"goal.duration" = 20', f'"{key}" = {value}'))
    with pytest.raises(planner.InputError, match=says) as info:
        Sweep.load(path)
    assert str(info.value).startswith(f"{path} [set]: ")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("problem = ", "not valid TOML"),
        ("", "missing key 'problem'"),
        (GOOD.replace("0.82,", "nan,"), "'goal.travel' = nan"),
    ],
)
def test_bad_files_are_named(written: Callable[[str], Path], text: str, says: str) -> None:
    path = written(text)
    with pytest.raises(planner.InputError, match=says) as info:
        Sweep.load(path)
    assert str(path) in str(info.value)


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match=r"none\.toml"):
        Sweep.load(tmp_path / "none.toml")
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(planner.InputError, match="not a text file"):
        Sweep.load(tmp_path / "x.toml")


SHIPPED = sorted((Path(__file__).parents[2] / "problems/sweeps").glob("*.toml"))


@pytest.fixture
def schema(capsys: pytest.CaptureFixture[str]) -> Any:
    assert main(["schema", "sweep"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_shipped_sweeps_are_good(path: Path, schema: Any) -> None:
    assert len(Sweep.load(path)) > 1
    jsonschema.validate(tomllib.loads(path.read_text(encoding="utf-8")), schema)


def test_the_schema_refuses_what_the_program_refuses(tables: Tables, schema: Any) -> None:
    jsonschema.validate({**tables, "sample": SAMPLE}, schema)
    for bad in (
        {"grids": {}},
        {"sample": {**SAMPLE, "count": 0}},
        {"sample": {"count": 3, "a.b": 1}},
        {"sample": {"count": 3, "cuont": EVEN}},
        {"sample": {"count": 3, "a.b": {**EVEN, "normal": [0, 1]}}},
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**tables, **bad}, schema)
