"""The page of a comparison and the comparison read back, without a browser."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import main
from compared import quick_comparison

import planner
from planner.report import folders as report_folder
from planner.report import load_comparison, write_report
from planner.report.charts.scripts import stylesheet
from planner.report.figures.style import readable_name
from planner.report.page.page import report_page
from planner.report.page.series import page_data
from planner.report.panels import PLAN_FIGURES

PAPER = Path(__file__).parents[2] / "problems/paper.toml"


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_folder, "_write_figures", lambda *_: None)
        yield quick_comparison().save(tmp_path_factory.mktemp("out") / "paper")


@pytest.fixture
def copied(saved: Path, tmp_path: Path) -> Path:
    shutil.copytree(saved, tmp_path / "copy")
    return tmp_path / "copy"


def test_a_comparison_comes_back_from_its_folder(saved: Path) -> None:
    there, back = quick_comparison(), load_comparison(saved)
    assert back.problem == there.problem
    assert back.machine == there.machine
    assert (back.samples, back.seed) == (there.samples, there.seed)
    assert back.headline == there.headline
    assert repr(back.differences) == repr(there.differences)  # NaN does not equal itself
    for old, new in zip(there.rows, back.rows, strict=True):
        for key in ("label", "method", "solved", "why", "domain_ok"):
            assert getattr(new, key) == getattr(old, key)
        for key in (
            "effort",
            "travel",
            "peak_u",
            "path_length",
            "terminal_error_max_deg",
            "E_median_deg",
            "E_p95_deg",
        ):
            np.testing.assert_array_equal(getattr(new, key), getattr(old, key))
        if old.plan is not None:
            np.testing.assert_array_equal(new.plan.u(3.3), old.plan.u(3.3))


def test_the_replays_are_kept_to_a_millionth_of_a_degree(saved: Path) -> None:
    data = json.loads((saved / "replays.json").read_text())
    row = quick_comparison()["polynomial"]
    np.testing.assert_allclose(data["polynomial"]["E_deg"], row.replay.index_E_deg, atol=1e-6)
    median = data["polynomial"]["median"]
    assert np.sort(row.replay.index_E_deg)[2] == row.replay.index_E_deg[median["number"]]
    np.testing.assert_allclose(median["q"][-1], row.replay.q[median["number"], -1], atol=1e-8)


def test_the_page_asks_for_nothing_from_outside(saved: Path, tmp_path: Path) -> None:
    text = write_report(saved, tmp_path / "page.html").read_text()
    assert text.startswith("<!doctype html>")
    assert set(re.findall(r"https?://[^\"'`\s<)]*", text)) <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"<(link|iframe|object|embed)\b|\bsrc=(?!.data:)|@import|url\((?!#)", text)
    assert "default-src 'none'" in text
    assert len(text) < 1_000_000


def test_curves_of_the_page_are_those_of_the_plans(saved: Path) -> None:
    replays = json.loads((saved / "replays.json").read_text())
    data = page_data(load_comparison(saved), replays)
    json.dumps(data, allow_nan=False)
    assert [plan["refused"] for plan in data["plans"]] == [True, False]
    figures = {figure["id"]: figure["panels"] for figure in data["figures"]}
    assert list(figures) == [*PLAN_FIGURES, "trade", "errors"]
    plan = quick_comparison()["polynomial"].plan
    t = np.array(data["plans"][1]["t"])
    drawn = next(s for s in figures["inputs"][1]["series"] if s["plan"] == 1)["y"]
    np.testing.assert_allclose(drawn[5:-5], plan.u(t)[5:-5, 1], rtol=2e-2, atol=1e-3)
    assert figures["inputs"][1]["limits"] == [-0.6, 0.6]
    assert figures["inputs"][1]["notes"][0]["value"] == pytest.approx(83, abs=0.5)
    assert [panel["title"] for panel in figures["z"]] == ["z₂", "z₂", "z₃", "z₄"]
    (flat,) = figures["map"]
    assert [series["plan"] for series in flat["series"]] == [0, 1]
    across, up = (np.array(flat["series"][1][key]) for key in "xy")
    np.testing.assert_allclose(across, np.rad2deg(plan.q(t)[:, 1]), atol=0.1)
    np.testing.assert_allclose(up, np.rad2deg(plan.q(t)[:, 2]), atol=0.1)
    assert flat["region"] == [[0.0, 90.0], [0.0, 90.0]]
    assert figures["z"][0]["band"]["high"][0] == 0, "rounding, -1e-34, is shown as what it is"


def test_feedback_has_its_machine_and_no_second_plan(tmp_path: Path) -> None:
    found = quick_comparison()
    row = found["polynomial"]
    assert row.replay is not None
    steady = replace(row, spec=replace(row.spec, feedback=True), effort=2.0)
    both = replace(found, rows=(*found.rows, steady), complete=False)
    text = report_page(both, dict(report_folder.replay_data(both)), both.to_dict())
    data = page_data(both, report_folder.replay_data(both))
    names = [plan["label"] for plan in data["plans"]]
    assert names == ["polynomial:travel=middle", "polynomial", "polynomial + feedback"]
    assert [plan["closed"] for plan in data["plans"]] == [False, False, True]
    assert data["plans"][2]["colour"] == data["plans"][1]["colour"]
    figures = {figure["id"]: figure["panels"] for figure in data["figures"]}
    drawn = [(s["plan"], s.get("machine", False)) for s in figures["joints"][0]["series"]]
    assert drawn == [(0, False), (1, False), (0, True), (1, True), (2, True)]
    assert [s["plan"] for s in figures["inputs"][0]["series"]] == [0, 1]
    assert [p["plan"] for p in figures["trade"][0]["points"]] == [0, 1, 2]
    assert figures["trade"][0]["points"][2]["x"] == 2
    assert "Partial: interrupted" in text
    assert "Plan against plan, machine by machine" in text
    assert "The worst machine of each plan, alone" in text
    assert "95 % interval" in text


def test_an_older_folder_without_replays_has_a_page_too(copied: Path) -> None:
    (copied / "replays.json").unlink()
    text = write_report(copied).read_text()
    assert '"id":"errors"' not in text
    assert '"id":"joints"' in text


def test_folders_that_are_none(copied: Path, tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match=r"is not the folder of a comparison.*No such"):
        write_report(tmp_path / "none")
    (copied / "plans/polynomial.json").unlink()
    with pytest.raises(planner.InputError, match=r"polynomial\.json"):
        write_report(copied)
    path = copied / "comparison.json"
    data = json.loads(path.read_text())
    for damage, says in (
        ({"version": 99}, "version 99"),
        ({"rows": [{"label": "x"}]}, "is damaged"),
        ({"rows": None}, "is damaged"),
    ):
        path.write_text(json.dumps({**data, **damage}))
        with pytest.raises(planner.InputError, match=says):
            write_report(copied)
    path.write_text("[]")
    with pytest.raises(planner.InputError, match="must hold one JSON object"):
        write_report(copied)
    assert not (copied / "report.html").exists()


def test_report_command(copied: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["report", str(copied), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["written"] == str(copied / "report.html")
    assert captured.err == f"written to {copied / 'report.html'}; open it in a browser\n"
    assert main(["report", str(copied), "--out", str(tmp_path / "none/x.html")]) == 0
    assert (tmp_path / "none/x.html").is_file()
    assert main(["report", str(tmp_path)]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_compare_with_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["planner.report.folders"], "_write_figures", lambda *_: None)
    words = ["compare", str(PAPER), "--methods", "polynomial", "--samples", "2", "--report"]
    changes = ["--set", "goal.travel=0.82", "--set", "goal.duration=2.5", "--set", "limits={}"]
    assert main(words) == 2
    assert "--report needs a folder: add --out FOLDER" in capsys.readouterr().err
    assert main([*words, *changes, "--out", str(tmp_path / "x")]) == 0
    assert (tmp_path / "x/report.html").exists()
    assert "report.html" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "shown"),
    [("theta1", "θ₁"), ("u2", "u₂"), ("phi12", "φ₁₂"), ("steering_rate", "steering rate")],
)
def test_names_on_the_page(name: str, shown: str) -> None:
    assert readable_name(name) == shown


def test_the_page_of_an_arm_shows_its_mechanism(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = write_report(copied).read_text()
    assert "Mechanism</h2>" in page
    assert 'src="data:image/svg+xml;base64,' in page
    monkeypatch.setattr("planner.report.page.page.mechanism_svg", lambda _: "")
    assert "Mechanism</h2>" not in write_report(copied).read_text()


def test_what_one_asks_first_is_drawn_first_and_not_covered() -> None:
    assert list(PLAN_FIGURES)[:2] == ["joints", "inputs"]
    assert "sticky" not in stylesheet("planner.report.page", "page.css")
