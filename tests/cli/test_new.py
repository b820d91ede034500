"""`planner new`: files that can be solved as they are, and that name every key."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.problem.tables.kinds import FILES
from planner.problem.tables.method_options import MethodsTable
from planner.systems.manipulator import prototype_ratios

KEY = re.compile(r"^#(?=[a-zA-Z_0-9]+ = )", re.MULTILINE)
PLACE = re.compile(r"(?ms)^#   (?=(\[\[|theta_deg|q =|time =|centre_m|radius_m))")
METHOD = {"manipulator": "collocation"}


New = Callable[..., str]


@pytest.fixture
def new(run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> New:
    """The text of a new file with every key."""
    monkeypatch.chdir(tmp_path)

    def text(kind: str, *words: str | int) -> str:
        assert run("new", "new.toml", "--system", kind, "--full", "--force", *words).status == 0
        return Path("new.toml").read_text()

    return text


def keys(model: Any) -> set[str]:
    return {field.alias or name for name, field in model.model_fields.items()}


@pytest.mark.parametrize("kind", FILES)
def test_a_new_file_solves_and_names_every_key(kind: str, run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "mine.toml"
    result = run("new", path, "--system", kind, "--full")
    assert result.status == 0
    assert result.out == ""
    assert result.err == f"written to {path}; next: planner check {shlex.quote(str(path))}\n"
    problem = planner.load_problem(path)
    assert planner.solve(problem, METHOD.get(kind, "polynomial")).verified
    text = path.read_text()
    assert f"planner check {shlex.quote(str(path))} " in text
    sections = re.split(r"^\[", text, flags=re.MULTILINE)[1:]
    said = {part.partition("]")[0]: part for part in sections}
    for name, field in FILES[kind].model_fields.items():
        if name in ("system", "start", "goal", "limits", "machine", "feedback", "compensation"):
            for key in keys(field.annotation):
                assert re.search(rf"(?m)^(# ?)?{key}( =|: not set)", said[name]), (name, key)
    for name, field in MethodsTable.model_fields.items():
        for key in keys(field.annotation):
            assert re.search(rf"(?m)^(# ?){key}( =|: not set)", said[f"method.{name}"]), key


def test_a_new_file_can_be_read_whatever_its_name(run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "two\nlines.toml"
    assert run("new", path).status == 0
    assert planner.load_problem(path).source == str(path)


@pytest.mark.parametrize("kind", FILES)
def test_keys_without_their_mark_are_valid_and_mostly_change_nothing(kind: str, new: New) -> None:
    text = new(kind)
    bare, every = tomllib.loads(text), tomllib.loads(KEY.sub("", text.replace("#gear", "##gear")))
    if kind == "manipulator":  # the rule belongs to the geometry, not to K
        del every["system"]["k_g_rule"]
    full = planner.Problem.from_dict(every)
    plain = planner.Problem.from_dict(bare)
    assert full.methods == plain.methods
    machine = planner.Machine.from_table(full.machine).to_dict()
    assert machine == planner.Machine.from_table(plain.machine).to_dict()


@pytest.mark.parametrize("kind", FILES)
def test_places_on_the_way_are_valid_too(kind: str, new: New) -> None:
    text = new(kind)
    problem = planner.Problem.from_dict(tomllib.loads(PLACE.sub("", text)))
    assert len(problem.waypoints) == 1
    assert problem.waypoints[0].time_s is not None
    assert len(problem.obstacles) == ("theta_deg" in text)
    tables = {name for name in FILES[kind].model_fields if name not in ("title", "method")}
    assert all(f"[{name}]" in text for name in tables)


def test_the_gear_of_a_new_file_is_that_of_its_ratios(new: New) -> None:
    text = new("manipulator")
    given = planner.Problem.from_dict(tomllib.loads(text)).system
    geared = text.replace("#gear", "gear").replace("#k_g_rule", "k_g_rule")
    geared = re.sub(r"(?m)^(K|k_g) = .*$", "", geared)
    arm = planner.Problem.from_dict(tomllib.loads(geared)).system
    assert isinstance(arm, planner.Manipulator)
    assert isinstance(given, planner.Manipulator)
    np.testing.assert_allclose(arm.K, given.K, rtol=1e-4)
    assert f"k_g = {arm.k_g:.4f}, as disks do" in text
    assert arm.k_g**2 == pytest.approx(given.k_g, rel=1e-3)  # the misprint


def test_what_is_there_is_replaced_by_force(run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("years of work")
    made = run("new", path, "--force", "--json").json
    assert made == {"written": str(path), "system": "manipulator", "exit_status": 0}
    assert planner.load_problem(path).name == "my manipulator"


def test_every_system_has_its_line_in_plain_characters(new: New) -> None:
    lines = [file.summary for file in FILES.values()]
    assert all(line.isascii() and 0 < len(line) < 90 for line in lines)
    assert all(new(kind).isascii() for kind in FILES)
    assert max(len(line) for line in new("custom").splitlines()) <= 100


@pytest.mark.parametrize(
    ("kind", "joints"), [("manipulator", 2), ("manipulator", 4), ("ball-gear", 4)]
)
def test_a_file_for_other_joints_solves(
    kind: str, joints: int, run: Callable, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    assert run("new", path, "--system", kind, "--joints", joints).status == 0
    problem = planner.load_problem(path)
    assert problem.system.size == joints + 1
    assert problem.to_dict()["system"]["K"] == prototype_ratios(joints)
    assert np.rad2deg(problem.goal[1:]) == pytest.approx([30] * joints)
    assert planner.solve(problem, METHOD.get(kind, "polynomial")).verified


@pytest.mark.parametrize("joints", range(2, 9))
def test_a_file_for_any_number_of_joints_is_valid_with_all_its_keys(joints: int, new: New) -> None:
    for kind in ("manipulator", "ball-gear"):
        text = new(kind, "--joints", joints)
        places = tomllib.loads(PLACE.sub("", text.replace('"free"\n', "10.0\n")))
        places["goal"]["duration"] = 10.0  # which a waypoint with a time asks for
        assert len(planner.Problem.from_dict(places).waypoints[0].q) == joints + 1
        assert f"link_lengths = [{', '.join(['1.0'] * joints)}]" in text


def test_the_file_of_three_joints_is_the_shipped_one(new: New) -> None:
    for kind in ("manipulator", "ball-gear"):
        shipped = tomllib.loads(new(kind))
        assert tomllib.loads(new(kind, "--joints", 3)) == shipped
        brief = tomllib.loads(new(kind, "--brief"))
        assert planner.Problem.from_dict(brief) == planner.Problem.from_dict(
            {key: table for key, table in shipped.items() if key in brief}
        )


@pytest.mark.parametrize("kind", FILES)
def test_a_new_file_is_short_and_says_where_the_rest_is(
    kind: str, run: Callable, tmp_path: Path
) -> None:
    run("new", tmp_path / "new.toml", "--system", kind)
    text = (tmp_path / "new.toml").read_text()
    assert len(text.splitlines()) < 70
    assert f"planner new OTHER --system {kind} --full\n" in text
    assert not re.search(r"(?m)^\[(method|machine|feedback|compensation)", text)
    planner.Problem.from_dict(tomllib.loads(text))


def test_the_margin_of_z2_is_not_set_but_explained(new: New) -> None:
    text = new("manipulator")
    assert "z2_margin" not in tomllib.loads(text)["limits"]
    assert "z2 is negative where theta2 is" in text
    arm = planner.Problem.from_dict(tomllib.loads(text)).system
    q = np.deg2rad(np.random.default_rng(0).uniform(-85, 85, (500, 4)))
    z2 = planner.chained_form(arm).z(q)[:, 1]
    assert np.array_equal(np.sign(z2), -np.sign(q[:, 2]))
