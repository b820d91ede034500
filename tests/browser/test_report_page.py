"""The report's page in a browser: from disk, no network, by pointer, by keys, light and dark."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compared import outside, quick_comparison, refused_comparison

import planner
from planner import Comparison
from planner.comparison.rows import Row
from planner.plan.spec import Spec
from planner.report import folders as report_folder
from planner.report import write_report
from planner.report.figures.arm import body_points

SOLVED = "polynomial"
JOINTS = "#fig-joints .panel"


@pytest.fixture(scope="module", autouse=True)
def _without_pictures() -> Iterator[None]:
    """The folder's own figures are not looked at here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_folder, "_write_figures", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, _without_pictures: None) -> Path:
    return quick_comparison().save(tmp_path_factory.mktemp("out") / "paper", report=True)


@pytest.fixture
def opened(folder: Path, new_page: Callable, tmp_path: Path) -> Callable:
    """Opens the page of the folder, or of a comparison."""

    def show(comparison: Comparison | None = None, **options: Any) -> Any:
        page = new_page(**options)
        place = comparison.save(tmp_path / "x", report=True) if comparison else folder
        page.goto((place / "report.html").as_uri())
        page.locator(".panel svg path").first.wait_for(state="attached")
        return page

    return show


def clock(page: Any) -> float:
    return float(page.locator("#clock").text_content().removesuffix(" s"))


def tip(panel: Any) -> tuple[float, dict[str, float]]:
    """Time and values that the figure shows."""
    text = panel.locator(".tip > div").text_content()
    rows = panel.locator(".tip tr").all()
    cells = [[c.text_content() for c in row.locator("td").all()] for row in rows]
    return float(text.removesuffix(" s")), {
        name: float(value.split()[0].replace("−", "-")) for name, value in cells
    }


def points_of(path: str) -> np.ndarray:
    return np.array([[float(x) for x in p.split()] for p in re.findall(r"[ML]([^ML]+)", path)])


def test_the_page_says_what_was_asked_and_what_came_out(opened: Callable, folder: Path) -> None:
    page = opened()
    text = page.locator("body").inner_text()
    assert "Which plan moves the arm from θ = (1, 1, 1)° to (30, 30, 30)° in 10 s" in text
    assert "Take polynomial: the only plan that reaches the goal and keeps every limit." in text
    page.get_by_text("The task", exact=True).click()
    text = page.locator("body").inner_text()
    assert "input u2 reaches 83 rad/s, allowed 0.6" in text
    assert "5 drawn from “prototype”" in text
    command = page.locator("#command").text_content()
    assert command.startswith("planner compare ")
    assert command.endswith(f"--out {folder} --report")
    assert f"casadi\n{planner.support.package.versions()['casadi']}" in text
    rows = page.locator("main table").first.locator("tbody tr")
    assert rows.count() == 3
    row = quick_comparison()[SOLVED]
    solved = rows.first.inner_text()
    for number in (f"{row.effort:.4g}", f"{row.travel:.4g}", "solved"):
        assert number in solved


def test_pointing_at_a_curve_shows_its_values(opened: Callable) -> None:
    page = opened()
    panel = page.locator(JOINTS).first
    assert panel.locator(".tip").is_hidden()
    panel.locator("svg").hover(position={"x": 140, "y": 80})
    t, values = tip(panel)
    assert 2 < t < 6
    plan = quick_comparison()[SOLVED].plan
    assert values[SOLVED] == pytest.approx(np.rad2deg(plan.q(t)[1]), abs=0.2)
    assert f"{SOLVED}, on the machine" in values
    inner, outer = panel.locator(".tip").bounding_box(), panel.locator("svg").bounding_box()
    assert 2 * inner["width"] > outer["width"]
    assert inner["y"] >= outer["y"] + outer["height"] - 1, "a wide box hid the figure"
    page.mouse.move(5, 5)
    assert panel.locator(".tip").is_hidden()

    panel = page.locator("#fig-z .panel").nth(1)
    panel.locator("svg").hover()
    rows = panel.locator(".tip tr").all_inner_texts()
    assert any("domain" in row and " to " in row for row in rows)


def test_keys_read_a_figure_and_set_the_clock(opened: Callable) -> None:
    page = opened()
    panel = page.locator(JOINTS).nth(2)
    panel.locator("svg").focus()
    page.keyboard.press("Home")
    assert tip(panel)[0] == 0.0
    for _ in range(5):
        page.keyboard.press("Shift+ArrowRight")
    t, values = tip(panel)
    assert t == pytest.approx(2.5, abs=0.01)
    assert f"{SOLVED} " in page.locator("#live").text_content()
    assert str(values[SOLVED]) in page.locator("#live").text_content()
    page.keyboard.press("Enter")
    assert clock(page) == pytest.approx(2.5, abs=0.01)
    page.keyboard.press("End")
    assert tip(panel)[1][SOLVED] == pytest.approx(30, abs=0.01)
    page.keyboard.press("Escape")
    assert panel.locator(".tip").is_hidden()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.tagName") == "svg"


def test_every_control_has_a_name_and_is_within_reach_of_the_tab_key(opened: Callable) -> None:
    page = opened()
    wanted = page.evaluate(
        "[...document.querySelectorAll('button, select, input, summary, [tabindex]')]"
        ".filter((e) => e.checkVisibility()).length"
    )
    page.evaluate("() => { window.seen = new Set(); }")
    page.evaluate("() => addEventListener('focusin', (e) => { window.seen.add(e.target); })")
    for _ in range(wanted + 2):
        page.keyboard.press("Tab")
    assert page.evaluate("window.seen.size") >= wanted

    for role in ("button", "checkbox", "slider", "combobox", "img"):
        found = page.get_by_role(role)
        assert found.count() > 0
        for k in range(found.count()):
            snapshot = found.nth(k).aria_snapshot()
            assert re.match(rf"- '?{role} \"", snapshot), snapshot


def test_play_moves_both_arms_on_one_clock(opened: Callable) -> None:
    page = opened()
    assert clock(page) == 0.0
    bodies = page.locator(".stage .body")
    before = [bodies.nth(k).get_attribute("d") for k in range(2)]
    page.locator("#speed").select_option("2")
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("() => parseFloat(document.getElementById('clock').textContent) > 1")
    page.get_by_role("button", name="Pause").click()
    stopped = clock(page)
    assert 1 < stopped < 10
    page.wait_for_timeout(100)
    assert clock(page) == stopped
    for k in range(2):
        assert bodies.nth(k).get_attribute("d") != before[k]
        assert f"at {stopped:.2f} seconds" in page.locator(".stage svg").nth(k).get_attribute(
            "aria-label"
        )


def test_scrubbing_shows_the_arm_of_that_time(opened: Callable) -> None:
    page = opened()
    page.locator("#scrub").focus()
    page.keyboard.press("End")
    assert clock(page) == 10.0
    for _ in range(20):
        page.keyboard.press("ArrowLeft")
    t = clock(page)
    assert t == pytest.approx(9.0, abs=0.01)
    assert page.locator("#scrub").get_attribute("aria-valuetext") == f"{t:.2f} s"
    plan = quick_comparison()[SOLVED].plan
    stage = page.locator(".stage").nth(0)  # it opens on the plan to take
    assert stage.locator("select").evaluate("(s) => s.selectedOptions[0].text") == SOLVED
    drawn = points_of(stage.locator(".body").get_attribute("d"))
    planned = body_points(plan.problem, plan.q(t))
    scale = np.linalg.norm(drawn[1] - drawn[0]) / np.linalg.norm(planned[1] - planned[0])
    rebuilt = (drawn - drawn[0]) * [1, -1] / scale
    np.testing.assert_allclose(rebuilt, planned - planned[0], atol=0.01)
    assert f"θ₁ {np.rad2deg(plan.q(t)[1]):.1f}°" in stage.locator(".readout").inner_text()


def test_plans_and_the_machine_are_shown_as_chosen(opened: Callable) -> None:
    page = opened()
    curves = page.locator(f"{JOINTS} path.curve")
    before = curves.count()
    assert page.locator("#fig-inputs .notes", has_text="peaks at").count() >= 1
    page.locator(".legend input").first.uncheck()
    assert curves.count() == before - 6  # a plan and its machine in three panels
    assert page.locator("#fig-inputs .notes", has_text="peaks at").count() == 0
    page.locator(".legend input").first.check()
    assert curves.count() == before

    right = page.locator(".stage").nth(1)
    before = right.locator(".ends").first.get_attribute("d"), right.locator("path.curve").first
    trail = before[1].get_attribute("d")
    right.locator("select").select_option(label=SOLVED)
    assert right.locator(".ends").first.get_attribute("d") == before[0]
    assert right.locator("path.curve").first.get_attribute("d") != trail

    machines = page.locator(".stage .machine-body")
    curves = page.locator(f"{JOINTS} .curve.machine")
    assert machines.nth(1).get_attribute("d")
    assert curves.count() > 0
    page.get_by_label("the machine of median error").uncheck()
    assert not machines.nth(1).get_attribute("d")
    assert curves.count() == 0


def test_a_table_shows_the_plans_that_matter_and_sorts_by_a_click(opened: Callable) -> None:
    comparison = crowd()
    page, count = opened(comparison), len(comparison.rows)
    table = page.locator(".scroll").first
    rows = table.locator("tbody tr")
    assert rows.count() == count > 3
    taken = comparison.recommended
    assert rows.count() == count > 3
    assert taken is not None
    assert taken.label in rows.first.locator("th").text_content()
    shown = sum(rows.nth(k).is_visible() for k in range(count))
    assert shown == 3
    ticks = page.locator(".legend input")
    assert sum(ticks.nth(k).is_checked() for k in range(ticks.count())) == 3
    head = table.locator("thead th", has_text="effort")
    head.locator("button").focus()
    page.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "ascending"
    assert all(rows.nth(k).is_visible() for k in range(count))
    column = table.locator("thead th").all_text_contents().index(head.text_content())
    texts = [rows.nth(k).locator("td").nth(column - 1).text_content() for k in range(count)]
    efforts = [float(match[0]) for text in texts if (match := re.match(r"[\d.]+", text))]
    assert efforts == sorted(efforts)
    assert len(set(efforts)) > 1


def test_the_map_shows_every_path_and_reads_them_at_one_time(opened: Callable) -> None:
    page = opened()
    panel = page.locator("#fig-map .panel")
    assert panel.locator("path.curve").count() == 2
    panel.locator("svg").focus()
    page.keyboard.press("End")
    rows = panel.locator(".tip tr").all_inner_texts()
    assert [row.split("\t")[-1].strip() for row in rows] == ["30, 30 deg"] * 2
    rings = panel.locator(".cross").get_attribute("d")
    assert rings.count("M") == 2
    page.locator(".legend input").first.uncheck()
    assert panel.locator("path.curve").count() == 1


def test_errors_and_effort_are_those_of_the_replays(opened: Callable) -> None:
    page = opened()
    data = json.loads(page.locator("#data").text_content())
    panels = {figure["id"]: figure["panels"][0] for figure in data["figures"]}
    across = page.locator("#fig-trade text.across").text_content()
    log = panels["trade"]["log"]
    assert across == "effort (rad²/s)" + (", log scale" if log[0] else "")
    assert page.locator("#fig-trade h3").text_content() == f"E (deg{', log scale' * log[1]})"
    across = page.locator("#fig-errors text.across").text_content()
    assert across == "E (deg)" + (", log scale" if panels["errors"]["log"] else "")
    assert any([*log, panels["errors"]["log"]]), "one of them is logarithmic, else this is idle"

    name = "polynomial:travel=middle (refused)"
    assert page.locator("#fig-trade text.name").all_text_contents().count(name) == 1
    assert page.locator("#fig-trade .dot.dashed").count() == 1
    for figure in ("z", "joints", "inputs", "errors"):
        assert page.locator(f"#fig-{figure} .curve.dashed").count() >= 1, figure
    assert name in page.locator(".legend").inner_text()

    row = quick_comparison()[SOLVED]
    errors = page.locator("#fig-errors .panel")
    errors.locator("svg").focus()
    page.keyboard.press("End")
    assert errors.locator(".tip tr").last.inner_text().endswith("100.0 %")
    points = page.locator("#fig-trade .panel")
    points.locator("svg").focus()
    page.keyboard.press("End")
    words = " ".join(points.locator(".tip").inner_text().split())
    assert f"effort {row.effort:.4g}" in words
    assert f"E 50 % {row.E_median_deg:.3g} deg" in words


def test_what_would_help_stands_under_each_refused_row(opened: Callable) -> None:
    page = opened(refused_comparison())
    row = page.locator("main table").first.locator("tbody tr").last
    assert re.search(r"Try: goal.duration = [\d.]+ or more \(tried\)", row.inner_text())
    assert page.locator("#fig-joints .curve.dashed").count() > 0, "the refused path is shown"
    assert "collocation (refused)" in page.locator(".legend").inner_text()
    assert page.locator(".stage .body").first.get_attribute("d")


CROWD = {
    "polynomial:travel=middle": (4.578, 17.8),
    "polynomial:travel=middle:points=[]": (2.24, 24.2),
    "polynomial:travel=early": (0.3758, 5.65),
    "collocation:degree=2": (0.3358, 5.72),
    "collocation:degree=3": (2.08, 0.3),
    "convex": (2.06, 0.17),
}


def crowd() -> Comparison:
    found = quick_comparison()
    rows = tuple(
        replace(
            found[SOLVED],
            spec=Spec.of_label(label),
            effort=effort,
            E_median_deg=E,
            E_p95_deg=2.2 * E,
        )
        for label, (effort, E) in CROWD.items()
    )
    return replace(found, rows=rows)


@pytest.mark.parametrize("width", [360, 1100])
def test_names_of_points_meet_neither_points_nor_bars_nor_each_other(
    width: int, opened: Callable
) -> None:
    page = opened(crowd(), width=width, height=800)
    for box in page.locator(".legend input").all():
        box.check()
    assert "E: the largest error of any joint" in page.inner_text(".question"), "before its use"
    assert page.locator("#lead").is_hidden(), "no plan prepares"
    drawn = page.locator("#fig-trade svg")
    names = [name.bounding_box() for name in drawn.locator("text.name").all()]
    dots = [dot.bounding_box() for dot in drawn.locator("circle").all()]
    bars = [bar.bounding_box() for bar in drawn.locator("path.bar").all()]
    assert len(bars) == len(CROWD)
    assert len(names) == len(dots) == len(CROWD)
    for k, name in enumerate(names):
        assert name["x"] + name["width"] <= page.viewport_size["width"]
        for other in [*dots, *bars, *names[:k]]:
            apart = [
                min(name[axis] + name[size], other[axis] + other[size])
                - max(name[axis], other[axis])
                for axis, size in (("x", "width"), ("y", "height"))
            ]
            assert min(apart) < 3, "their boxes, which are larger than their letters, cover"


def luminance(colour: str) -> float:
    parts = np.array([float(x) for x in re.findall(r"[\d.]+", colour)[:3]]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_in_both_schemes(opened: Callable, scheme: str) -> None:
    page = opened(color_scheme=scheme)

    colours = page.evaluate("""() => {
        const of = (e, what = 'color') => getComputedStyle(document.querySelector(e))[what];
        const out = {
            paper: of('body', 'backgroundColor'), body: of('body'), note: of('.note'),
            refused: of('.badge.refused'), solved: of('.badge.solved'),
            axis: of('svg text', 'fill'),
        };
        for (let k = 0; k < 9; k++) {
            document.querySelector('.swatch').className = `swatch plan-${k}`;
            out[`plan ${k}`] = of('.swatch');
        }
        return out;
    }""")
    light = {name: luminance(colour) for name, colour in colours.items()}
    paper = light.pop("paper")
    assert (paper < 0.05) == (scheme == "dark")
    for name, other in light.items():
        contrast = (max(paper, other) + 0.05) / (min(paper, other) + 0.05)
        assert contrast > (7 if name == "body" else 3 if name.startswith("plan") else 4.5), name


def test_readable_on_a_phone(opened: Callable) -> None:
    page = opened(width=360, height=700, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    cell = page.locator("tbody td").first
    assert cell.evaluate("(e) => getComputedStyle(e, '::before').content") == '"travel"'
    assert page.evaluate("parseFloat(getComputedStyle(document.body).fontSize)") >= 16
    for control in ("#play", "#scrub", "#speed"):
        assert page.locator(control).bounding_box()["height"] >= 36
    stages = page.locator(".stage svg")
    first, second = (stages.nth(k).bounding_box() for k in (0, 1))
    assert first["y"] + first["height"] <= second["y"]
    assert min(first["width"], second["width"]) > 300
    assert page.get_by_text("Scroll the picture sideways").is_visible()
    panel = page.locator(JOINTS).first
    panel.locator("svg").tap()
    assert panel.locator(".tip").is_visible()
    box = panel.locator(".tip").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 360


def test_less_motion_where_it_is_asked_for(opened: Callable) -> None:
    page = opened(reduced_motion="reduce")
    page.locator("#play").click()
    seen = page.evaluate("""async () => {
        const seen = new Set(), began = performance.now();
        while (performance.now() - began < 1300) {
            await new Promise(requestAnimationFrame);
            seen.add(document.getElementById('clock').textContent);
        }
        return seen.size;
    }""")
    assert 2 <= seen <= 4


def test_without_scripts_the_page_still_speaks(folder: Path, new_page: Callable) -> None:
    page = new_page(java_script_enabled=False)
    page.goto((folder / "report.html").as_uri())
    assert "need JavaScript" in page.locator("#figures").inner_text()
    assert page.locator("table").first.locator("tbody tr").count() == 3


def test_a_title_cannot_write_the_page(opened: Callable) -> None:
    evil = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)> $data"
    found = quick_comparison()
    problem = found.problem.changed({"title": evil})
    rows = [replace(row, spec=Spec(row.label + evil), replay=None) for row in found.rows]
    page = opened(Comparison(problem, tuple(rows), found.machine, 5, 1))
    assert page.title() == f"{evil}: comparison of plans"
    assert page.locator("h1").text_content() == evil
    assert page.locator("img:not(.mechanism)").count() == 0


def test_a_path_outside_the_domain_is_marked(opened: Callable) -> None:
    plan = outside()
    row = Row(Spec("polynomial"), False, "leaves the chart's domain", plan)
    page = opened(Comparison(plan.problem, (row,), quick_comparison().machine, 5, 1))
    assert "None of the methods found a plan" in page.locator(".verdict").inner_text()
    assert page.locator("#fig-z .mark").count() == len(plan.domain.exits_s)
    assert page.locator("#motion").is_hidden()
    assert page.locator("#fig-joints").is_hidden()


def test_obstacles_and_waypoints_are_drawn(opened: Callable) -> None:
    found = quick_comparison()
    plan = found[SOLVED].plan
    tables = {
        "obstacles": [{"centre_m": [0.8, 2.2], "radius_m": 0.3}],
        "waypoints": [
            {"theta_deg": np.rad2deg(plan.q(4.0)[1:]).tolist(), "time": 4.0},
            {"theta_deg": [20.0, "free", "free"]},
        ],
    }
    problem = found.problem.changed(tables)
    row = replace(found[SOLVED], plan=replace(plan, problem=problem), replay=None)
    page = opened(replace(found, problem=problem, rows=(row,)))
    disc = page.locator(".stage .disc").first
    assert page.locator(".stage .disc").count() == 1
    assert page.locator(".stage .stop").count() == 1
    assert page.locator(f"{JOINTS} .stop").count() == 3
    links = points_of(page.locator(".stage .ends").first.get_attribute("d"))
    unit = np.linalg.norm(links[1] - links[0])
    assert float(disc.get_attribute("r")) == pytest.approx(0.3 * unit, rel=0.01)
    page.locator("#scrub").evaluate("(e) => { e.value = 4; e.dispatchEvent(new Event('input')); }")
    tip = points_of(page.locator(".stage .body").get_attribute("d"))[-1]
    mark = points_of(page.locator(".stage .stop").get_attribute("d").split("l")[0])[0] + [0, 6]
    np.testing.assert_allclose(mark, tip, atol=0.6)


def test_a_vehicle_has_its_page(opened: Callable) -> None:
    problem = planner.load_problem(Path(__file__).parents[2] / "problems/unicycle.toml")
    plan = planner.solve(problem, "polynomial")
    row = Row(Spec("polynomial"), True, "", plan, effort=1.0)
    machine = planner.Machine.from_table(problem.machine)
    page = opened(Comparison(problem, (row,), machine, 1, 0))
    assert "x = 0 m, heading = 0°, y = 0 m to x = 2 m" in page.locator(".question").inner_text()
    assert "y 0.00 m" in page.locator(".readout").inner_text()
    assert page.locator("#fig-errors").is_hidden()


def test_a_folder_without_methods_that_found_anything(new_page: Callable, tmp_path: Path) -> None:
    found = quick_comparison()
    row = Row(Spec("convex"), False, "no travel has a plan")
    none = Comparison(found.problem, (row,), found.machine, 5, 1)
    page_file = none.save(tmp_path / "x", report=True) / "report.html"
    assert "no travel has a plan" in page_file.read_text()
    page = new_page()
    page.goto(page_file.as_uri())
    for part in ("#figures", "#motion", ".skip"):
        page.locator(part).wait_for(state="hidden")
    assert write_report(tmp_path / "x", tmp_path / "y.html").read_text() == page_file.read_text()
