"""`planner compare`: one table, one folder, one JSON object."""

from __future__ import annotations

import re
import shlex
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import planner

PAPER = Path(__file__).parents[2] / "problems/paper.toml"
SETS = ("--set", "goal.travel=0.82", "--set", "goal.duration=2.5", "--set", "machine.step_s=0.01")
QUICK = ("--samples", "3", *SETS)
WORDS = ("compare", PAPER, "--methods", "polynomial", *QUICK)


@pytest.mark.usefixtures("without_pictures")
def test_compare_as_json_and_folder(run: Callable, tmp_path: Path) -> None:
    out = tmp_path / "new/run"
    result = run(*WORDS, "--set", "limits={}", "--seed", "7", "--out", out, "--json")
    assert result.status == 0
    data = result.json
    assert data["written"] == str(out)
    assert (data["samples"], data["seed"]) == (3, 7)
    assert [row["label"] for row in data["rows"]] == ["polynomial"]
    assert data["exit_status"] == 0
    assert data["rows"][0]["solved"] is True
    first, second = result.err.splitlines()
    assert first == f"written to {out}; pictures in {out}/figures"
    assert second.endswith(f": planner report {out}")
    assert {"table.md", "comparison.json", "plans"} <= {p.name for p in out.iterdir()}
    assert planner.load_plan(out / "plans/polynomial.json").verified


def test_compare_without_a_plan_tells_why_and_ends_with_3(run: Callable) -> None:
    result = run(*WORDS)
    assert result.status == 3
    assert "polynomial" in result.out
    assert "input u2" in result.out
    assert re.search(r"Try: goal.duration = 80\d.* or more \(tried\)", " ".join(result.out.split()))
    advice = "no method has a plan; see the changes after 'Try', or run: planner check "
    assert result.err == f"{advice}{PAPER} {' '.join(SETS)}\n"


TWO = ("compare", PAPER, "--methods", "polynomial,polynomial:travel=middle", *QUICK)


def test_ctrl_c_while_saving_leaves_no_folder(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planner.Plan, "save", lambda *_: signal.raise_signal(signal.SIGINT))
    result = run(*WORDS, "--set", "limits={}", "--out", tmp_path / "run", "--json")
    assert result.status == 130
    assert result.json["status"] == "interrupted"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("without_pictures")
def test_ctrl_c_keeps_what_is_done_and_says_so(
    run: Callable, law: Callable, tmp_path: Path
) -> None:
    calls = []

    def pressed(plan: Callable[[], planner.Plan]) -> planner.Plan:
        calls.append(plan)
        if len(calls) == 2:
            signal.raise_signal(signal.SIGINT)
        return plan()

    law(pressed)
    result = run(*TWO, "--set", "limits={}", "--out", tmp_path / "run", "--json")
    assert result.status == result.json["exit_status"] == 130
    assert [row["label"] for row in result.json["rows"]] == ["polynomial"]
    assert result.json["complete"] is False
    assert "interrupted: partial result" in result.err
    assert "Partial: interrupted" in (tmp_path / "run/table.md").read_text()


@pytest.mark.usefixtures("without_pictures")
def test_ctrl_c_leaves_an_earlier_complete_result_in_its_place(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*TWO, "--set", "limits={}", "--out", tmp_path / "run")
    assert run(*words).status == 0
    before = {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    replays = []

    def pressed(*words: Any, **options: Any) -> Any:
        replays.append(words)
        if len(replays) == 2:
            signal.raise_signal(signal.SIGINT)
        return planner.replay(*words, **options)

    monkeypatch.setattr("planner.comparison.compare.run_replay", pressed)
    result = run(*words)
    assert result.status == 130
    assert f"written to {tmp_path}/run-partial; {tmp_path}/run keeps the complete" in result.err
    assert "Partial: interrupted" in (tmp_path / "run-partial/table.md").read_text()
    assert {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("name", ["run", "run-partial"])
def test_ctrl_c_while_drawing_keeps_the_data(
    name: str, run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside the complete result of an earlier run, if there is one."""

    def pressed(*_: Any) -> None:
        signal.raise_signal(signal.SIGINT)

    out, words = tmp_path / name, (*WORDS, "--set", "limits={}", "--out", tmp_path / "run")
    if name == "run-partial":
        monkeypatch.setattr("planner.report.folders._write_figures", lambda *_: None)
        assert run(*words).status == 0
    monkeypatch.setattr("planner.report.folders._write_figures", pressed)
    result = run(*words, "--report", "--json")
    assert result.status == result.json["exit_status"] == 130
    assert result.json["complete"] is False
    assert result.json["written"] == str(out)
    assert str(out) in result.err
    assert planner.load_comparison(out).complete
    assert {p.name for p in out.iterdir()} >= {"table.md", "replays.json", "plans"}
    assert not (out / "report.html").exists()


@pytest.mark.usefixtures("without_pictures")
def test_ctrl_c_in_the_budgets_keeps_the_comparison(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    real = planner.error_budget

    def pressed(*words: Any, **options: Any) -> Any:
        if asked:
            signal.raise_signal(signal.SIGINT)
        asked.append(words)
        return real(*words, **{**options, "samples": 3, "base": 2})

    monkeypatch.setattr("planner.robustness.budget.error_budget", pressed)
    result = run(*TWO, "--budget", "--out", tmp_path / "run", "--json")
    assert result.status == result.json["exit_status"] == 130
    assert len(result.json["rows"]) == 2
    assert list(result.json["budgets"]) == ["polynomial"]
    assert result.json["complete"] is False
    assert "interrupted: partial result" in result.err
    assert (tmp_path / "run/table.md").exists()
    assert (tmp_path / "run/budget/budget.md").exists()


def test_the_command_of_the_worst_machine_replays_it(run: Callable) -> None:
    row = run(*WORDS, "--json").json["rows"][0]
    words = shlex.split(row["worst_command"])
    assert words[words.index("--sample") + 1] == str(row["worst"])
    again = run(*words[1:], "--json").json
    assert again["samples"] == 1
    most = max(row["replay"]["E_p95_deg"], again["rows"][0]["E_median_deg"])
    assert again["rows"][0]["E_median_deg"] == pytest.approx(most)
    assert again["rows"][0]["worst"] == row["worst"]


def test_pairs_and_worst_machines_are_printed(run: Callable) -> None:
    words = ("compare", PAPER, "--methods", "polynomial,polynomial:travel=middle", *QUICK)
    result = run(*words)
    assert "polynomial against the others, machine by machine" in result.out
    assert result.out.count("--sample ") == 2
    assert max(len(line) for line in result.out.splitlines() if "--sample" not in line) <= 80


@pytest.mark.usefixtures("without_pictures")
def test_a_machine_of_a_file_is_named_by_it(run: Callable, tmp_path: Path) -> None:
    file, out = tmp_path / "mine.toml", tmp_path / "run"
    file.write_text('[machine]\npreset = "prototype"\nbacklash_deg = 0.5\nstep_s = 0.01\n')
    words = ("compare", PAPER, "--methods", "polynomial:travel=middle", *QUICK[:-2])
    result = run(*words, "--machine", file, "--set", "machine.creep=0.01", "--out", out)
    assert f"(from {file}," in " ".join((out / "table.md").read_text().split())
    (command,) = (line for line in result.out.splitlines() if "--sample" in line)
    assert f"--machine {file}" in command
    assert command.count("--set") == 3
    assert "--set machine.creep=0.01" in command
    worst = run(*shlex.split(command)[1:], "--json").json
    assert worst["machine"]["backlash_deg"] == 0.5
    assert worst["machine"]["creep"] == 0.01
    loaded = planner.report.load_comparison(out)
    assert loaded.machine.source == str(file)
