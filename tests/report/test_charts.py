"""The page and the explorer draw with the same scripts, fed in the same shape."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from compared import outside, quick_comparison

import planner
from planner.explorer.screen import Screen
from planner.explorer.state import State
from planner.report import charts
from planner.report.charts.panels import CHARTS, SCRIPTS, STYLE, band, near, source
from planner.report.folders import replay_data
from planner.report.page.page import report_page
from planner.report.page.series import page_data

PROBLEM = Path(__file__).parents[2] / "problems/paper.toml"


def test_every_script_is_in_the_page_and_in_the_explorer() -> None:
    widget = pytest.importorskip("planner.explorer.widget", reason="needs the extra 'notebook'")
    page = report_page(quick_comparison(), {}, {})
    folder = Path(charts.__file__).parent
    assert {path.name for path in folder.glob("*.js")} == set(SCRIPTS)
    for name in SCRIPTS:
        assert source(CHARTS, name) in page
        assert source(CHARTS, name) in widget.Explorer._esm
    assert source(CHARTS, STYLE) in page
    assert source(CHARTS, STYLE) in widget.Explorer._css


def test_no_name_is_defined_twice_where_scripts_are_joined() -> None:
    widget = pytest.importorskip("planner.explorer.widget", reason="needs the extra 'notebook'")
    for text in (report_page(quick_comparison(), {}, {}), widget.Explorer._esm):
        names = re.findall(r"^(?:function|class|const|let) (\w+)", text, re.MULTILINE)
        assert len(names) > 20
        assert sorted(names) == sorted(set(names))


def test_panels_have_one_shape() -> None:
    found = quick_comparison()
    page = [p for f in page_data(found, replay_data(found))["figures"] for p in f["panels"]]
    problem = planner.load_problem(PROBLEM, {"goal.travel": 0.82})
    screen = Screen(State.of(problem, "polynomial", 2))
    explorer = [*screen.picture()["panels"], screen.errors()]
    allowed = {"kind", "title", "unit", "series", "band", "limits", "floor", "zero", "ends"}
    allowed |= {"stops", "marks", "view", "notes", "note"}  # those that `panels` names
    for panel in (p for p in (*page, *explorer) if p and p["kind"] == "time"):
        assert panel.keys() - {"id", "handles"} <= allowed
        for series in panel["series"]:
            assert {"plan", "y"} <= series.keys() <= {"plan", "y", "t", "name", "colour", "machine"}


def test_a_limit_is_drawn_on_the_side_that_is_near() -> None:
    assert near(np.array([0.0, 70.0]), 80.0) == [80.0]
    assert near(np.array([-70.0, 70.0]), 80.0) == [-80.0, 80.0]
    assert near(np.array([np.nan, 10.0]), 80.0) == []
    assert near(np.array([10.0]), np.inf) == []


def test_the_band_marks_where_its_edge_is_crossed() -> None:
    plan = outside()
    t = np.linspace(0, plan.duration, 50)
    found = band(plan, t, name="there")
    assert [t for t, _ in found["marks"]] == list(plan.domain.exits_s)
    assert found["band"]["name"] == "there"
