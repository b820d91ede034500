"""`planner budget`: tables, folder, JSON, plan files."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import planner

PAPER = Path(__file__).parents[2] / "problems/paper.toml"
IDEAL = ("--set", "machine.preset=ideal", "--set", "machine.backlash_deg=3",
         "--set", "machine.delay_s={ value = 0.01, spread = 0.002 }", "--set", "limits={}",
         "--set", "goal.duration=4.0")  # fmt: skip
SMALL = ("--samples", "6", "--base", "4", "--set", "machine.step_s=0.01")


def test_folder_and_json(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "budget"
    words = ("--methods", "polynomial:travel=middle", *SMALL, "--seed", "2", *IDEAL)
    result = run("budget", PAPER, *words, "--out", out, "--json")
    assert result.status == 0
    label, data = "polynomial:travel=middle", json.loads((out / "budget.json").read_text())
    read = planner.report.load_budgets(out)[label]
    assert {label: read.to_dict()} == result.json["budgets"]
    assert read.plan.verified
    assert data["budgets"][label].pop("plan_file") == "plans/polynomial-travel=middle.json"
    assert data["budgets"] == result.json["budgets"]
    assert list(data["budgets"]) == [label]
    typed = ["budget", PAPER, *words, "--out", out, "--json"]
    assert shlex.split(data["command"]) == ["planner", *map(str, typed)]
    names = {p.name for p in out.iterdir()} - {".planner"}
    figure = "budget-polynomial-travel=middle.png"
    assert names == {"budget.md", "budget.csv", "budget.json", "plans", figure}
    text = (out / "budget.md").read_text()
    assert f"## `{label}`" in text
    assert "seed 2" in text
    rows = (out / "budget.csv").read_text().splitlines()
    assert len(rows) == 1 + len(data["budgets"][label]["costs"]) == 1 + 2


def test_damaged_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match=r"budget\.json"):
        planner.report.load_budgets(tmp_path)
    head = {"format": "planner-budget", "version": 1}
    for data, words in [({}, "is not a budget"), ({**head, "budgets": {"a": {}}}, "is damaged")]:
        (tmp_path / "budget.json").write_text(json.dumps(data))
        with pytest.raises(planner.InputError, match=words):
            planner.report.load_budgets(tmp_path)


def test_of_a_plan_file_with_another_machine(
    run: Callable, tmp_path: Path, unlimited: planner.Problem
) -> None:
    quick = unlimited.changed({"goal.travel": 0.828, "goal.duration": 2.0})
    planner.solve(quick, "polynomial").save(tmp_path / "plan.json")
    changes = ("--set", "machine.preset=ideal", "--set", "machine.backlash_deg=3")
    result = run("budget", tmp_path / "plan.json", *SMALL, *changes)
    assert result.status == 0
    assert max(len(line) for line in result.out.splitlines()) <= 80
    lines = [line for line in result.out.splitlines() if line.startswith("backlash ")]
    assert len(lines) == 1
    for other in ("goal.duration=5", "feedback.run_up=false"):  # they would change nothing
        assert run("budget", tmp_path / "plan.json", *SMALL, "--set", other).status == 2


def test_without_a_plan_that_can_be_executed(run: Callable) -> None:
    words = ("--set", "goal.travel=0.7854", "--set", "limits={}")
    result = run("budget", PAPER, "--methods", "polynomial", *SMALL, *words)
    assert result.status == 3
    assert "leaves the chart's domain" in result.err


@pytest.mark.parametrize("command", [("budget",), ("compare", "--budget")])
def test_without_salib_it_ends_before_the_work(
    command: tuple[str, ...], run: Callable, law: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "SALib.analyze", None)
    law(lambda plan: pytest.fail("planned before it looked"))
    result = run(command[0], PAPER, "--methods", "polynomial", *command[1:])
    assert result.status == 2
    assert "install it with: pip install " in result.err
    assert "[budget]'" in result.err
