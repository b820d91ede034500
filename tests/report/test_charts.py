"""The page and the explorer draw with the same scripts, fed in the same shape."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compared import outside, quick_comparison

import planner
from planner.explorer.screen import Screen
from planner.explorer.state import State
from planner.machine.friction.contact_load import contact_load
from planner.report import charts
from planner.report.charts.scripts import CHARTS, SCRIPTS, STYLE, source
from planner.report.figures.style import COLOURS, METHOD_COLOURS, PALETTE, colour_numbers, curves
from planner.report.folders import replay_data
from planner.report.page.page import report_page
from planner.report.page.series import page_data
from planner.report.panels import (
    PLAN_FIGURES,
    Panel,
    PlanCurves,
    PlanFigure,
    Series,
    TimePanel,
    merge,
    near_limits,
)

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


DEFAULT_LABELS = (
    "polynomial:points=auto",
    *(f"{name} compensated" for name in ("polynomial", "sinusoid", "collocation")),
)


def test_a_method_has_one_colour_in_pictures_on_the_page_and_in_the_explorer() -> None:
    widget = pytest.importorskip("planner.explorer.widget", reason="needs the extra 'notebook'")
    assert set(METHOD_COLOURS) == {*planner.METHODS, *DEFAULT_LABELS}
    assert len(set(METHOD_COLOURS.values())) == len(METHOD_COLOURS) == len(PALETTE)
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
    (plan,) = Screen(State.from_problem(problem, "collocation", 0)).picture()["plans"]
    assert plan["colour"] == METHOD_COLOURS["collocation"]


def test_colours_of_what_is_drawn_together_differ_and_feedback_keeps_its_plans() -> None:
    labels = ["polynomial:travel=middle", "mine", "polynomial", "collocation:degree=2"]
    labels += ["collocation compensated:rest=true", "2: convex", "polynomial + feedback"]
    numbers = colour_numbers(labels, {"2: convex": "convex"})
    assert numbers[labels[0]] == METHOD_COLOURS["polynomial"]
    assert numbers[labels[3]] == METHOD_COLOURS["collocation"]
    assert numbers[labels[4]] == METHOD_COLOURS["collocation compensated"]
    assert numbers[labels[5]] == METHOD_COLOURS["convex"]
    assert numbers["polynomial + feedback"] == numbers["polynomial"]
    assert len(set(numbers.values())) == len(labels) - 1
    assert len(colour_numbers([str(k) for k in range(12)])) == 12


def test_a_plan_that_its_compensated_one_follows_is_drawn_wide_and_pale() -> None:
    plan = next(iter(quick_comparison().plans.values()))
    under, over, alone = curves({"a:b=1": plan, "a compensated:b=1": plan, "c": plan})
    assert (under.followed, over.followed, alone.followed) == (True, False, False)
    assert under.look["linewidth"] > 2 * over.look["linewidth"]
    assert under.look["alpha"] < 0.5
    assert over.look == {**alone.look, "color": over.colour}


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
    screen = Screen(State.from_problem(problem, "polynomial", 2))
    explorer = [*screen.picture()["panels"], screen.errors()["error"]]
    allowed = {"id", "kind", "title", "unit", "series", "band", "limits", "floor", "zero", "ends"}
    allowed |= {"stops", "marks", "view", "notes", "note"}  # those that `panels` names
    for panel in (p for p in (*page, *explorer) if p and p["kind"] == "time"):
        assert panel.keys() - {"handles"} <= allowed
        for series in panel["series"]:
            assert {"plan", "y"} <= series.keys() <= {"plan", "y", "t", "name", "colour", "machine"}
    flat = [p for p in (*page, *explorer) if p and p["kind"] == "plane"]
    assert {p["id"] for p in flat} >= {"map", "plane"}
    allowed = {"id", "kind", "title", "unit", "series", "names", "ends", "view", "key"}
    for panel in flat:
        assert panel.keys() - {"handles"} <= allowed | {
            "region",
            "limits",
            "poses",
            "discs",
            "tips",
            "note",
        }
        assert all(series.keys() == {"plan", "x", "y"} for series in panel["series"])


def test_a_limit_is_drawn_on_the_side_that_is_near() -> None:
    assert near_limits(np.array([0.0, 70.0]), 80.0) == [80.0]
    assert near_limits(np.array([-70.0, 70.0]), 80.0) == [-80.0, 80.0]
    assert near_limits(np.array([np.nan, 10.0]), 80.0) == []
    assert near_limits(np.array([10.0]), np.inf) == []


def test_the_band_marks_where_its_edge_is_crossed() -> None:
    plan = outside()
    (z2, *_) = PLAN_FIGURES["z"].panels([PlanCurves(0, plan, np.linspace(0, plan.duration, 50))])
    assert [t for t, _ in z2.marks] == list(plan.domain.exits_s)


def test_a_figure_is_one_entry_and_is_drawn_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    def speeds(drawn: Sequence[PlanCurves]) -> list[Panel]:
        one = [Series(s.number, np.gradient(s.q[:, 1], s.t)) for s in drawn]
        return [TimePanel("speed", "speed of theta1", "rad/s", one)]

    speed = PlanFigure("speed", speeds, "Speeds", "How fast the first joint turns.")
    monkeypatch.setitem(PLAN_FIGURES, "speed", speed)
    found = quick_comparison()
    (panel,) = next(f["panels"] for f in page_data(found, {})["figures"] if f["id"] == "speed")
    assert [series["plan"] for series in panel["series"]] == [0, 1]
    page = report_page(found, {}, {})
    assert '<figure id="fig-speed" hidden>' in page
    assert "<b>Speeds.</b> How fast the first joint turns." in page
    picture = found.figures()["speed"]
    assert picture.get_suptitle().startswith("Speeds: ")
    assert len(picture.axes[0].lines) == 2
    problem = planner.load_problem(PROBLEM, {"goal.travel": 0.82})
    panels = Screen(State.from_problem(problem, "polynomial", 0)).picture()["panels"]
    assert "speed" in [panel["id"] for panel in panels]


def test_a_figure_is_of_the_machine_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    def loads(drawn: Sequence[PlanCurves]) -> list[TimePanel]:
        shares = [contact_load(s.plan, s.machine).share[0] for s in drawn]
        series = [Series(s.number, 0 * s.t + y) for s, y in zip(drawn, shares, strict=True)]
        return [TimePanel("load", "largest load of a contact", "", series)]

    monkeypatch.setitem(PLAN_FIGURES, "load", PlanFigure("load", loads, "Load", "Of a contact."))
    found = quick_comparison()

    def in_picture_and_on_page(comparison: planner.Comparison) -> list[float]:
        (ax,) = comparison.figures()["load"].axes
        data = page_data(comparison, {})["figures"]
        (panel,) = next(figure["panels"] for figure in data if figure["id"] == "load")
        return [line.get_ydata()[0] for line in ax.lines] + [s["y"][0] for s in panel["series"]]

    assert in_picture_and_on_page(replace(found, machine=planner.Machine.ideal())) == [0.0] * 4
    assert min(in_picture_and_on_page(found)) > 0.05
    for preset in ("prototype", "ideal"):
        problem = planner.load_problem(PROBLEM, {"goal.travel": 0.82, "machine.preset": preset})
        panels = Screen(State.from_problem(problem, "polynomial", 0)).picture()["panels"]
        (panel,) = (panel for panel in panels if panel["id"] == "load")
        assert (panel["series"][0]["y"][0] > 0.05) == (preset == "prototype")


@pytest.mark.parametrize("columns", [False, True])
def test_a_panel_s_view_holds_in_pictures_and_on_the_page(
    columns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = {0: (-1.0, 2.0), 1: (0.0, 3.0)}

    def speeds(drawn: Sequence[PlanCurves]) -> list[TimePanel]:
        return [
            TimePanel("speed", "speed", "", [Series(s.number, 9 * s.t)], view=views[s.number])
            for s in drawn
        ]

    speed = PlanFigure("speed", speeds, "Speeds", "Far above the view.", columns=columns)
    monkeypatch.setitem(PLAN_FIGURES, "speed", speed)
    found = quick_comparison()
    panels = next(f["panels"] for f in page_data(found, {})["figures"] if f["id"] == "speed")
    assert [tuple(panel["view"]) for panel in panels] == list(views.values())
    limits = [ax.get_ylim() for ax in found.figures()["speed"].axes]
    assert limits == (
        [(-1.0, 3.0)] * 2 if columns else list(views.values())
    )  # a row shares its axis


def test_panels_of_one_id_and_unit_become_one() -> None:
    plan = quick_comparison()["polynomial"].plan
    drawn = [PlanCurves(0, plan, np.linspace(0, plan.duration, 50))]
    (one,) = merge(PLAN_FIGURES["inputs"].panels(drawn))
    assert [(s.name, s.colour) for s in one.series] == [("u1", 0), ("u2", 1)]
    assert one.limits == [-0.6, 0.6]
    views = [panel.view for panel in PLAN_FIGURES["inputs"].panels(drawn)]
    assert one.view == (min(v[0] for v in views), max(v[1] for v in views))
    car = planner.solve(planner.load_problem(PROBLEM.with_name("car.toml")), "polynomial")
    drawn = [PlanCurves(0, car, np.linspace(0, car.duration, 50))]
    ids = [panel.id for panel in merge(PLAN_FIGURES["joints"].panels(drawn))]
    assert ids == ["joints", "joints m"]


def test_several_plans_to_a_free_goal_have_no_common_end_on_the_map() -> None:
    plan = planner.solve(planner.load_problem(PROBLEM.with_name("tip.toml")))
    drawn = [PlanCurves(k, plan, np.linspace(0, plan.duration, 50)) for k in range(2)]
    (one,), (both,) = (PLAN_FIGURES["map"].panels(some) for some in (drawn[:1], drawn))
    np.testing.assert_allclose(one.ends[1], np.rad2deg(plan.q(plan.duration)[1:3]), atol=1e-9)
    assert both.ends == one.ends[:1]
