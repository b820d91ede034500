"""The command that makes a result again."""

from __future__ import annotations

import shlex
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from compared import ROOT

import planner
from planner import Comparison, Machine
from planner.comparison.comparison import command
from planner.comparison.rows import Row
from planner.plan.spec import Spec
from planner.support.files import toml_value

PAPER = ROOT / "problems/paper.toml"


def empty(problem: planner.Problem, machine: Machine | None = None) -> Comparison:
    rows = (Row(Spec.of_label("polynomial:points=[[5.0, -0.2]]"), False, "not run"),)
    machine = Machine.from_table(problem.machine) if machine is None else machine
    return Comparison(problem, rows, machine, samples=7, seed=11)


def words(text: str | None) -> list[str]:
    assert text is not None
    return shlex.split(text)


def values(settings: list[str]) -> dict[str, Any]:
    """By key, as the command reads them."""
    return {key: toml_value(value) for key, _, value in (s.partition("=") for s in settings)}


def changes(parts: list[str]) -> list[str]:
    return [value for key, value in pairwise(parts) if key == "--set"]


def test_an_unchanged_problem_needs_no_settings() -> None:
    parts = words(command(empty(planner.load_problem(PAPER)), "out dir"))
    assert parts[:3] == ["planner", "compare", str(PAPER)]
    assert parts[3:] == [
        "--methods", "polynomial:points=[[5.0, -0.2]]",
        "--samples", "7", "--seed", "11", "--out", "out dir",
    ]  # fmt: skip


def test_methods_are_named_with_their_feedback_in_the_order_of_the_rows() -> None:
    comparison = empty(planner.load_problem(PAPER))
    first, last = (Row(Spec(name), True, "") for name in ("polynomial", "collocation"))
    closed = [replace(row, spec=replace(row.spec, feedback=True)) for row in (first, last)]
    for rows, named in (
        ((first, last, closed[1]), "polynomial,collocation + feedback"),
        ((first, closed[0], last), "polynomial + feedback,collocation"),
    ):
        parts = words(command(replace(comparison, rows=rows)))
        assert parts[3:6] == ["--methods", named, "--samples"]


def test_changes_become_settings_that_give_the_problem_back() -> None:
    changed = {
        "goal.duration": 12.5,
        "limits.input_rad_s": [0.4, 0.3],
        "method.polynomial.points": [[5.0, -0.2]],
        "method.polynomial.travel": "middle",
        "method.polynomial.allow_singular": True,
    }
    problem = planner.load_problem(PAPER, changed)
    given = values(changes(words(command(empty(problem)))))
    assert given.keys() == changed.keys()
    assert planner.load_problem(PAPER, given) == problem


def test_another_machine_becomes_settings_too() -> None:
    problem = planner.load_problem(PAPER)
    machine = Machine.from_table(problem.machine).with_(backlash_deg=0.25).without("creep")
    settings = changes(words(command(empty(problem, machine))))
    assert settings == ["machine.creep=false", "machine.backlash_deg=0.25"]


def test_the_spread_of_a_machine_survives() -> None:
    problem = planner.load_problem(PAPER, {"machine.backlash_deg": {"value": 0.5, "spread": 0.1}})
    settings = changes(words(command(empty(problem))))
    assert planner.load_problem(PAPER, values(settings)) == problem


def test_no_command_is_given_when_none_would_do(tmp_path: Path, unlimited: planner.Problem) -> None:
    assert command(empty(unlimited)) is None
    gone = replace(planner.load_problem(PAPER), source=str(tmp_path / "gone.toml"))
    assert command(empty(gone)) is None
    assert "Made from Python" in empty(gone).markdown()
