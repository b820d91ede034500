"""The folder of a comparison: complete, or not there."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from compared import quick_comparison

import planner
from planner.report import folders as report_folder
from planner.report import write_report
from planner.report.panels import PLAN_FIGURES

DRAWN = (*PLAN_FIGURES, "arm", *report_folder.REPLAY_FIGURES)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return quick_comparison().save(tmp_path_factory.mktemp("out") / "paper")


def test_everything_is_written(saved: Path) -> None:
    names = {str(p.relative_to(saved)) for p in saved.rglob("*") if p.is_file()}
    assert names - {".planner"} == {
        "table.md",
        "table.csv",
        "differences.md",
        "differences.csv",
        "machines.csv",
        "comparison.json",
        "replays.json",
        "problem.toml",
        "plans/polynomial-travel=middle.refused.json",
        "plans/polynomial.json",
        *(f"figures/{name}.png" for name in DRAWN),
    }
    for name in DRAWN:
        assert (saved / f"figures/{name}.png").read_bytes().startswith(b"\x89PNG")


def test_data_holds_what_is_needed_to_repeat(saved: Path) -> None:
    data = json.loads((saved / "comparison.json").read_text())
    assert (data["format"], data["version"]) == ("planner-comparison", 1)
    assert (data["samples"], data["seed"]) == (5, 1)
    assert " --set 'limits.input_rad_s=[0.6, 0.6]' " in data["command"]
    assert data["command"].endswith(f" --out {saved}")
    source = quick_comparison().problem.source
    assert (saved / "problem.toml").read_text() == Path(source).read_text()


def test_saved_plans_load_and_say_whether_they_were_refused(saved: Path) -> None:
    good = planner.load_plan(saved / "plans/polynomial.json")
    assert (good.verified, planner.verify(good).ok) == (True, True)
    bad = planner.load_plan(saved / "plans/polynomial-travel=middle.refused.json")
    assert (bad.verified, bad.status) == (False, "verification_failed")


@pytest.mark.parametrize("error", [RuntimeError("half-way"), KeyboardInterrupt()])
def test_a_failure_half_way_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    def fail(*args: object) -> None:
        raise error

    monkeypatch.setattr(report_folder, "_write_figures", fail)
    with pytest.raises(type(error)):
        quick_comparison().save(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_half_way_keeps_the_earlier_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_folder, "_write_figures", lambda *args: None)
    quick_comparison().save(tmp_path / "out")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def fail(*args: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(report_folder, "_write_plans", fail)
    with pytest.raises(planner.InputError, match="No space left"):
        quick_comparison().save(tmp_path / "out")
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_a_folder_of_someone_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(planner.InputError, match="holds files"):
        quick_comparison().save(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_partial_comparison_leaves_a_complete_one_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_folder, "_write_figures", lambda *args: None)
    complete = quick_comparison()
    partial = replace(complete, rows=complete.rows[:1], complete=False)
    out, beside = tmp_path / "out", tmp_path / "out-partial"
    assert partial.save(out) == out  # nothing is there
    assert complete.save(out) == out  # a partial result is replaced
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}
    for _ in range(2):
        assert partial.save(out) == beside
        assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
    assert json.loads((beside / "comparison.json").read_text())["complete"] is False
    assert complete.save(beside) == beside


def test_the_page_of_an_earlier_run_does_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_folder, "_write_figures", lambda *args: None)
    out = quick_comparison().save(tmp_path / "out")
    (out / "notes.txt").write_text("mine")
    write_report(out)
    assert (out / "report.html").exists()
    quick_comparison().save(out)
    assert not (out / "report.html").exists()
    assert (out / "notes.txt").read_text() == "mine"
