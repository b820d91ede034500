"""`planner new`: files that can be solved as they are, and that name every key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import planner
from planner.cli.start import problem_text
from planner.problem.tables.kinds import FILES
from planner.problem.tables.method_options import MethodsTable

KEY = re.compile(r"^#(?=[a-zA-Z_0-9]+ = )", re.MULTILINE)
PLACE = re.compile(r"(?ms)^#   (?=(\[\[|theta_deg|q =|time =|centre_m|radius_m))")
METHOD = {"manipulator": "collocation"}


def keys(model: Any) -> set[str]:
    return {field.alias or name for name, field in model.model_fields.items()}


@pytest.mark.parametrize("kind", FILES)
def test_a_new_file_solves_and_names_every_key(kind: str, run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    result = run("new", path, "--system", kind)
    assert result.status == 0
    assert result.out == ""
    assert result.err == f"written to {path}; next: planner check {path}\n"
    problem = planner.load_problem(path)
    assert planner.solve(problem, METHOD.get(kind, "polynomial")).verified
    text = path.read_text()
    assert f"planner check {path}" in text
    sections = re.split(r"^\[", text, flags=re.MULTILINE)[1:]
    said = {part.partition("]")[0]: part for part in sections}
    for name, field in FILES[kind].model_fields.items():
        if name in ("system", "start", "goal", "limits", "machine", "feedback", "compensation"):
            for key in keys(field.annotation):
                assert re.search(rf"(?m)^(# ?)?{key}( =|: not set)", said[name]), (name, key)
    for name, field in MethodsTable.model_fields.items():
        for key in keys(field.annotation):
            assert re.search(rf"(?m)^(# ?){key}( =|: not set)", said[f"method.{name}"]), key


@pytest.mark.parametrize("kind", FILES)
def test_keys_without_their_mark_are_valid_and_mostly_change_nothing(
    kind: str, tmp_path: Path
) -> None:
    text = problem_text(kind)
    bare, every = tomllib.loads(text), tomllib.loads(KEY.sub("", text.replace("#gear", "##gear")))
    if kind == "manipulator":  # the rule belongs to the geometry, not to K
        del every["system"]["k_g_rule"]
    full = planner.Problem.from_dict(every)
    plain = planner.Problem.from_dict(bare)
    assert full.methods == plain.methods
    machine = planner.Machine.from_table(full.machine).to_dict()
    assert machine == planner.Machine.from_table(plain.machine).to_dict()


@pytest.mark.parametrize("kind", FILES)
def test_places_on_the_way_are_valid_too(kind: str) -> None:
    problem = planner.Problem.from_dict(tomllib.loads(PLACE.sub("", problem_text(kind))))
    assert len(problem.waypoints) == 1
    assert problem.waypoints[0].time_s is not None
    assert len(problem.obstacles) == ("theta_deg" in problem_text(kind))
    tables = {name for name in FILES[kind].model_fields if name not in ("title", "method")}
    assert all(f"[{name}]" in problem_text(kind) for name in tables)


def test_the_gear_of_a_new_file_is_one() -> None:
    text = problem_text("manipulator").replace("#gear", "gear").replace("#k_g_rule", "k_g_rule")
    text = re.sub(r"(?m)^(K|k_g) = .*$", "", text)
    assert planner.Problem.from_dict(tomllib.loads(text)).system.size == 4


def test_what_is_there_is_kept_unless_forced(run: Callable, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("years of work")
    result = run("new", path)
    assert result.status == 2
    assert "is there already; name another file, or replace it with --force" in result.err
    assert path.read_text() == "years of work"
    assert run("new", path, "--force", "--json").json == {
        "written": str(path),
        "system": "manipulator",
        "exit_status": 0,
    }
    assert planner.load_problem(path).name == "my manipulator"


def test_refusals_of_new(run: Callable, tmp_path: Path) -> None:
    wrong = run("new", tmp_path / "x.toml", "--system", "tank")
    assert wrong.status == 2
    assert "no system 'tank'; allowed: manipulator" in wrong.err
    nowhere = run("new", tmp_path / "none/x.toml")
    assert nowhere.status == 2
    assert "there is no folder" in nowhere.err
    assert list(tmp_path.iterdir()) == []


def test_every_system_has_its_line_in_plain_characters() -> None:
    lines = [file.summary for file in FILES.values()]
    assert all(line.isascii() and 0 < len(line) < 90 for line in lines)
    assert all(problem_text(kind).isascii() for kind in FILES)
    assert max(len(line) for line in problem_text("custom").splitlines()) <= 100
