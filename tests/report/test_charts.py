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
from planner.report.figures.style import COLOURS, METHODS, PALETTE, colour_numbers, curves
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
    rules = [line for line in source(CHARTS, STYLE).splitlines() if "$" not in line]
    assert len(rules) > 50
    for line in rules:
        assert line in page
        assert line in widget.Explorer._css


def test_a_method_has_one_colour_in_pictures_on_the_page_and_in_the_explorer() -> None:
    widget = pytest.importorskip("planner.explorer.widget", reason="needs the extra 'notebook'")
    assert set(METHODS) == {*planner.METHODS, "compensated"}
    assert len(set(METHODS.values())) == len(METHODS) < len(PALETTE)
    found = quick_comparison()
    numbers = {plan["label"]: plan["colour"] for plan in page_data(found, {})["plans"]}
    assert {k: COLOURS[n] for k, n in numbers.items()} == {
        c.label: c.colour for c in curves(found.plans)
    }
    for text in (report_page(found, {}, {}), widget.Explorer._css):
        for k, (_, light, dark) in enumerate(PALETTE):
            assert re.findall(rf"--plan-{k}: (#\w+);", text) == [light, dark]
            assert f".charts .plan-{k} {{ color: var(--plan-{k}); }}" in text
    problem = planner.load_problem(PROBLEM)
    (plan,) = Screen(State.of(problem, "collocation", 0)).picture()["plans"]
    assert plan["colour"] == METHODS["collocation"]


def test_colours_of_what_is_drawn_together_differ_and_feedback_keeps_its_plans() -> None:
    labels = ["polynomial:travel=middle", "mine", "polynomial", "collocation:degree=2"]
    labels += ["collocation compensated:rest=true", "2: convex", "polynomial + feedback"]
    numbers = colour_numbers(labels)
    assert numbers[labels[0]] == METHODS["polynomial"]
    assert numbers[labels[3]] == METHODS["collocation"]
    assert numbers[labels[4]] == METHODS["compensated"]
    assert numbers[labels[5]] == METHODS["convex"]
    assert numbers["polynomial + feedback"] == numbers["polynomial"]
    assert len(set(numbers.values())) == len(labels) - 1
    assert len(colour_numbers([str(k) for k in range(12)])) == 12


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
