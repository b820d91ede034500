"""`planner compare`: one table, one folder, one JSON object."""

from __future__ import annotations

import errno
import os
import re
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import planner
from planner.cli.standard_output import ReaderGoneError

PAPER = Path(__file__).parents[2] / "problems/paper.toml"
QUICK = ("--samples", "3", "--set", "goal.travel=0.82", "--set", "goal.duration=2.5")
WORDS = ("compare", PAPER, "--methods", "polynomial", *QUICK)


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
    assert result.err == f"written to {out}; pictures in {out}/figures\n"
    assert {"table.md", "comparison.json", "figures", "plans"} <= {p.name for p in out.iterdir()}
    assert planner.load_plan(out / "plans/polynomial.json").verified


def test_compare_without_a_plan_tells_why_and_ends_with_3(run: Callable) -> None:
    result = run(*WORDS)
    assert result.status == 3
    assert "polynomial" in result.out
    assert "input u2" in result.out
    assert re.search(r"Try: goal.duration = 80\d.* or more \(tried\)", " ".join(result.out.split()))
    advice = "no method has a plan; what would help stands after 'Try', more by: planner check "
    assert result.err == f"{advice}{PAPER} --set goal.travel=0.82 --set goal.duration=2.5\n"


def test_same_seed_same_numbers(run: Callable) -> None:
    rows = [run(*WORDS, "--seed", seed, "--json").json["rows"] for seed in ("1", "1", "2")]
    for row in rows:
        assert row[0]["solved"] is False
        for name in ("took_s", "solve_time_s"):
            row[0].pop(name)
    assert rows[0] == rows[1]
    assert rows[0] != rows[2]


def test_a_disk_that_fills_leaves_the_table_on_the_screen_and_no_folder(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    result = run(*WORDS, "--out", tmp_path / "new/run")
    assert result.status == 2
    assert "no: input u2 reaches" in result.out
    assert "No space left on device" in result.err
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_saving_leaves_no_folder(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["planner.report.folders"], "_write_plans", interrupted)
    result = run(*WORDS, "--out", tmp_path / "run", "--json")
    assert result.status == 130
    assert result.json["status"] == "interrupted"
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_keeps_what_is_done_and_says_so(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, second = sys.modules["planner.comparison.compare"], "polynomial:travel=middle"
    solve = module.solve_and_check

    def pressed(problem: Any, method: str, **options: Any) -> Any:
        if "travel" in options:
            signal.raise_signal(signal.SIGINT)
        return solve(problem, method, **options)

    monkeypatch.setattr(module, "solve_and_check", pressed)
    monkeypatch.setattr(sys.modules["planner.report.folders"], "_write_figures", lambda *_: None)
    words = ("compare", PAPER, "--methods", f"polynomial,{second}", *QUICK, "--set", "limits={}")
    result = run(*words, "--out", tmp_path / "run", "--json")
    assert result.status == 130
    assert [row["label"] for row in result.json["rows"]] == ["polynomial"]
    assert (result.json["complete"], result.json["exit_status"]) == (False, 130)
    assert "interrupted: partial result" in result.err
    assert "Partial: interrupted" in (tmp_path / "run/table.md").read_text()


def test_ctrl_c_in_the_budgets_keeps_the_comparison(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def pressed(*words: Any, **options: Any) -> Any:
        if asked:
            signal.raise_signal(signal.SIGINT)
        asked.append(words)
        return planner.error_budget(*words, **{**options, "samples": 3, "base": 2})

    monkeypatch.setattr("planner.cli.compare.error_budget", pressed)
    monkeypatch.setattr(sys.modules["planner.report.folders"], "_write_figures", lambda *_: None)
    words = ("compare", PAPER, "--methods", "polynomial,polynomial:travel=middle", *QUICK)
    result = run(*words, "--budget", "--out", tmp_path / "run", "--json")
    assert result.status == result.json["exit_status"] == 130
    assert len(result.json["rows"]) == 2
    assert list(result.json["budgets"]) == ["polynomial"]
    assert result.json["complete"] is False
    assert "interrupted: partial result" in result.err
    assert {"table.md", "budget"} <= {p.name for p in (tmp_path / "run").iterdir()}


def test_the_command_of_the_worst_machine_replays_it(run: Callable) -> None:
    row = run(*WORDS, "--json").json["rows"][0]
    words = shlex.split(row["worst_command"])
    assert words[words.index("--sample") + 1] == str(row["worst"])
    again = run(*words[1:], "--json").json
    assert again["samples"] == 1
    assert again["rows"][0]["E_median_deg"] == pytest.approx(
        max(row["replay"]["E_p95_deg"], again["rows"][0]["E_median_deg"])
    )
    assert again["rows"][0]["worst"] == row["worst"]


def test_pairs_and_worst_machines_are_printed(run: Callable) -> None:
    words = ("compare", PAPER, "--methods", "polynomial:travel=middle,polynomial", "-n", "3")
    result = run(*words, "--set", "machine.step_s=0.01")
    assert "polynomial against the others, machine by machine" in result.out
    assert result.out.count("--sample ") == 2
    assert max(len(line) for line in result.out.splitlines() if "--sample" not in line) <= 100


def test_a_reader_of_the_table_who_leaves_does_not_take_the_folder_away(
    run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`planner compare ... --out out | head -1`."""

    def gone(*_: Any) -> None:
        raise ReaderGoneError

    monkeypatch.setattr("planner.cli.compare.print_text", gone)
    out = tmp_path / "run"
    assert run(*WORDS, "--set", "limits={}", "--out", out).status == 0
    assert {"table.md", "comparison.json", "figures", "plans"} <= {p.name for p in out.iterdir()}
