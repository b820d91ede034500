"""`planner sensitivity`: matrix, heat maps, machine; plans and problems; bad input."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = PROBLEMS / "paper.toml"


def test_table_and_sums(run: Callable[..., Any]) -> None:
    result = run("sensitivity", PAPER, "--no-machine")
    assert result.status == 0
    assert "gain u2" in result.out
    assert "0.5 deg" in result.out
    assert "total 1.15 deg" in result.words
    assert "0.9582 deg" in result.words
    assert "Nominal machine" not in result.out
    for word in ("Passive block: response of", "Floor: the part", "total by at most 17 %"):
        assert word in result.words
    assert "planner compare" in result.words.split("Next, compensate")[1]
    assert "collocation compensated,desensitised compensated" in result.words


@pytest.mark.parametrize(
    ("spec", "next_"),
    [
        ("polynomial:points=auto", "polynomial compensated:points=auto,desensitised compensated"),
        ("collocation compensated", "collocation compensated,desensitised compensated"),
        ("collocation:end=machine", "collocation:end=machine,desensitised"),
    ],
)
def test_the_next_command_is_about_the_plan_that_was_asked_for(
    run: Callable[..., Any], spec: str, next_: str
) -> None:
    """It dropped the options, and told to compensate what is compensated."""
    result = run("sensitivity", PAPER, "--no-machine", "--method", spec)
    assert spec in result.words.split("error", 1)[0]
    assert result.words.replace("'", "").endswith(f"--methods {next_}")
    assert ("Next, compensate" in result.words) == spec.startswith("polynomial")


def test_json_of_a_saved_plan_matches_the_library(run: Callable[..., Any], tmp_path: Path) -> None:
    plan = planner.solve(planner.load_problem(PAPER), "collocation")
    plan.save(tmp_path / "plan.json")
    data = run("sensitivity", tmp_path / "plan.json", "--json").json
    other = run("sensitivity", tmp_path / "plan.json", "--method", "sinusoid")
    assert (other.status, "--method: for a problem" in other.err) == (2, True)
    found = planner.sensitivity(plan)
    np.testing.assert_allclose(data["matrix"], found.terminal)
    assert data["passive_block_deg"] == pytest.approx(found.passive_block_deg())
    gain = next(p for p in data["parameters"] if p["parameter"] == "gain u1")
    assert gain["floor"] == ["theta2"]
    assert gain["response_deg"]["theta2"] == pytest.approx(0.29)
    effects = {p["effect"] for p in data["machine"]["parameters"]}
    assert {"backlash_deg", "delay_s", "control_period_s", "gear_ratio_error"} <= effects
    assert data["along"]["t_s"][0] == 0
    np.testing.assert_allclose(data["along"]["matrix"][-1], found.terminal)
    play = next(p for p in data["machine"]["parameters"] if p["effect"] == "backlash_deg")
    assert np.shape(play["along_deg_per_unit"]) == (len(data["machine"]["t_s"]), 3)


def test_folder(run: Callable[..., Any], tmp_path: Path) -> None:
    result = run("sensitivity", PAPER, "--out", tmp_path / "s", "--json")
    assert result.json["written"] == str(tmp_path / "s")
    names = {p.name for p in (tmp_path / "s").iterdir() if not p.name.startswith(".")}
    assert names == {"sensitivity.json", "matrix.csv", "plan.json", "heat-map.png", "along.png",
                     "machine.png"}  # fmt: skip
    for name in ("heat-map.png", "along.png", "machine.png"):
        assert (tmp_path / "s" / name).read_bytes().startswith(b"\x89PNG")
    rows = list(csv.reader((tmp_path / "s" / "matrix.csv").read_text().splitlines()))
    np.testing.assert_allclose(np.array(rows)[1:, 1:].astype(float), result.json["matrix"])


def test_spread_comes_from_the_table(run: Callable[..., Any]) -> None:
    quiet = ("sensitivity", PAPER, "--no-machine", "--json", "--set")
    data = run(*quiet, "method.desensitised.gain=0.02").json
    twice = next(p for p in data["parameters"] if p["parameter"] == "gain u1")
    assert twice["response_deg"]["theta2"] == pytest.approx(0.58)


def test_methods_side_by_side(run: Callable[..., Any], tmp_path: Path) -> None:
    """The polynomial is refused here for its speed, and is a whole motion all the same."""
    methods = ("--methods", "polynomial,polynomial:points=[[5.0,0.5]],collocation")
    result = run("sensitivity", PAPER, *methods, "--out", tmp_path / "s", "--json")
    plans = result.json["plans"]
    assert list(plans) == ["polynomial", "collocation"]
    blocks = {label: plan["passive_block_deg"] for label, plan in plans.items()}
    assert blocks["polynomial"] == pytest.approx(blocks["collocation"], rel=0.01)
    assert "every plan" in result.json["sentence"]
    assert list(result.json["refused"]) == ["polynomial", "polynomial:points=[[5.0,0.5]]"]
    kept = planner.load_plan(tmp_path / "s" / "plans" / "collocation.json")
    assert planner.sensitivity(kept).passive_block_deg() == pytest.approx(blocks["collocation"])
    rows = list(csv.DictReader((tmp_path / "s" / "sensitivities.csv").read_text().splitlines()))
    assert float(rows[0]["total_deg"]) == pytest.approx(plans["polynomial"]["total_deg"])
    assert (tmp_path / "s" / "sensitivities.png").read_bytes().startswith(b"\x89PNG")
    shown = run("sensitivity", PAPER, *methods).out
    assert "polynomial: refused, input u2" in shown
    assert "polynomial:points=[[5.0,0.5]]: no plan, " in shown


def test_what_cannot_stand_side_by_side(run: Callable[..., Any], tmp_path: Path) -> None:
    for words, says in (
        (["--methods", "collocation + feedback"], "only replays have feedback"),
        (["--methods", "collocation", "--pareto", "effort"], "--methods: without effect"),
        (["--methods", "collocation", "-m", "convex"], "--method: without effect"),
        (["--methods", "collocation", "--no-machine"], "--machine: without effect"),
        (["--points", "20", "--seed", "1"], "--points and --seed: without effect"),
        (["--methods", "polynomial:points=[[5.0,0.5]]"], "no plan can be executed"),
    ):
        result = run("sensitivity", PAPER, *words)
        assert (result.status, says in result.err) == (2, True), result.err


def test_trade_off(run: Callable[..., Any], tmp_path: Path) -> None:
    problem = tmp_path / "two.toml"
    problem.write_text(
        "[system]\nkind = 'manipulator'\njoints = 2\nK = [0.87]\nk_g = 0.67\n"
        "[start]\ntheta_deg = [0, 0]\n"
        "[goal]\ntheta_deg = [20, 40]\nduration = 10.0\n[limits]\ninput_rad_s = [0.5, 0.5]\n"
        "[method.desensitised]\nintervals = 16\n[machine]\nstep_s = 0.01\n"
    )
    words = ("sensitivity", problem, "--pareto", "effort", "--points", "3", "-n", "5")
    first = run(*words, "--out", tmp_path / "curve", "--json")
    assert first.status == 0
    assert first.json["points"][0]["machine"]["samples"] == 5
    assert (tmp_path / "curve" / "trade-off.png").read_bytes().startswith(b"\x89PNG")
    head, *rows = (tmp_path / "curve" / "trade-off.csv").read_text().splitlines()
    assert len(rows) == len(first.json["points"])
    assert {"machine_95_deg", "compensated_95_deg", "floor_deg"} <= set(head.split(","))
    assert sum(row.startswith("knee,") for row in rows) == 1
    assert {"duration", "reversals", "errors_alone_95_deg"} <= set(head.split(","))
    again = run(*words, "--out", tmp_path / "curve")
    assert (again.status, "knee " in again.out) == (0, True)
    kept = planner.load_plan(tmp_path / "curve" / "knee.json")
    knee = first.json["points"][first.json["knee"]]
    assert planner.sensitivity(kept).total_deg() == pytest.approx(knee["total_deg"])
    assert first.json["knee_file"] == str(tmp_path / "curve" / "knee.json")
    assert "planner export" in again.words
    assert "Floor: the part" in again.words
    table = again.out.split("\n\n")[1]
    assert "…" not in table  # heads and numbers are whole
    assert max(map(len, table.splitlines())) <= 80
