"""`planner sweep` on the command line."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from planner.report.figures.design import draw_sweep
from planner.sweep.results import read

PROBLEMS = Path(__file__).parents[2] / "problems"
STUDY = PROBLEMS / "designs/gear-ratios.toml"
SWEEP = """
title = "too short"
problem = "paper.toml"
methods = ["polynomial", "piecewise"]
[grid]
"goal.duration" = [0.05, 0.06, 0.07]
"""


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copy(PROBLEMS / "paper.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "short.toml"
    path.write_text(SWEEP, encoding="utf-8")
    return path


def test_it_runs_exports_and_goes_on(run: Callable[..., Any], file: Path) -> None:
    result = run("sweep", file, "--workers", "1", "--json", "--export", "out.csv")
    assert result.status == 0
    assert result.json["ran"] == 6
    assert result.json["statuses"] == {"infeasible": 6}
    assert result.json["db"] == "short.sqlite"
    assert result.json["written"].endswith("out.csv")
    assert len((file.parent / "out.csv").read_text().splitlines()) == 7
    again = run("sweep", file, "--workers", "1", "--db", "short.sqlite")
    assert again.status == 0
    assert "were there  6" in again.out
    counts = " ".join(again.out.split())
    assert "polynomial 0 of 3 solved, 3 infeasible" in counts
    assert "piecewise 0 of 3 solved, 3 infeasible" in counts
    assert result.json["methods"]["piecewise"] == {"solved": 0, "cases": 3}


def test_one_picture_shows_what_each_method_solves(run: Callable[..., Any], file: Path) -> None:
    file.write_text(SWEEP.replace("0.07]", "30.0]"), encoding="utf-8")
    result = run("sweep", file, "--workers", "1", "--figure", "goals.png", "--json")
    assert result.json["methods"]["polynomial"] == {"solved": 1, "cases": 3}
    assert result.json["recommended"] == "polynomial"
    assert (file.parent / "goals.png").read_bytes().startswith(b"\x89PNG")
    columns, records = read(file.parent / "short.sqlite")
    drawn = draw_sweep(columns, records, "short: take one")
    assert drawn.get_suptitle() == "short: take one"
    bars, efforts = drawn.axes
    assert "polynomial: 1 of 3" in [text.get_text() for text in bars.texts]
    marks = {line.get_label(): line.get_xydata() for line in efforts.lines}
    solved = [r for r in records if r["solved"]]
    methods = [r["method"] for r in solved]
    assert {label: len(marks[label]) for label in methods} == dict.fromkeys(methods, 1)
    refused = [len(marks[f"{label}: refused"]) for label in ("polynomial", "piecewise")]
    assert sum(refused) + len(solved) == len(records)
    one = next(r for r in solved if r["method"] == "polynomial")
    assert marks["polynomial"].tolist() == [[30.0, one["effort"]]]
    assert efforts.get_xlabel() == "goal.duration"


def test_a_picture_of_another_kind_is_refused_before_the_work(
    run: Callable[..., Any], file: Path
) -> None:
    result = run("sweep", file, "--figure", "goals.gif")
    assert (result.status, "must end in .png" in result.err) == (2, True)
    assert not (file.parent / "short.sqlite").exists()


def test_a_dry_run_counts_and_writes_nothing(run: Callable[..., Any], file: Path) -> None:
    result = run("sweep", file, "--dry-run")
    assert result.status == 0
    assert "3 points x 2 methods = 6" in result.out
    assert run("sweep", file, "--dry-run", "--json").json["runs"] == 6
    assert sorted(p.name for p in file.parent.iterdir()) == ["paper.toml", "short.toml"]


@pytest.mark.parametrize("command", ["sweep short.toml", f"design {STUDY}"])
def test_workers_and_a_cluster_exclude_each_other(
    command: str, run: Callable[..., Any], file: Path
) -> None:
    before = sorted(file.parent.rglob("*"))
    result = run(*command.split(), "--workers", "1", "--cluster", "tcp://127.0.0.1:1")
    assert result.status == 2
    assert "not both" in result.err
    assert sorted(file.parent.rglob("*")) == before


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("hidden", [False, True])
def test_after_ctrl_c_it_says_where_the_finished_cases_are(
    run: Callable[..., Any], file: Path, monkeypatch: pytest.MonkeyPatch, hidden: bool
) -> None:
    """Before there is a database, in a case, and after the last; also where an error hides it."""

    def press(*_: Any, **__: Any) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            if hidden:
                raise ImportError("initialization failed") from None
            raise

    for name, words, says in (
        ("planner.cli.sweep.run_sweep", [], "interrupted, nothing written"),
        ("planner.sweep.run._pool", [], "short.sqlite; the same command runs the rest"),
        ("planner.cli.sweep.export", ["--export", "x.csv"], "short.sqlite written before"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(name, press)
            result = run("sweep", file, "--workers", "1", *words)
        assert result.status == 130
        assert says in result.err
