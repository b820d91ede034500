"""The explorer in a real browser on a real Jupyter server: sliders move the picture."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from lab_server import lab_server

# CI and `make explorer` run these: server, kernels and browser take as long as 150 other tests.
pytestmark = pytest.mark.campaign

ROOT = Path(__file__).parents[2]
SOURCE = """import planner
problem = planner.load_problem("paper.toml", {"goal.travel": 0.82})
explorer = planner.explore(problem, "polynomial", samples=5)
explorer"""
SLOW = """import planner
search = {"start": "wander", "starts": 4000, "attempts": 4000}
problem = planner.load_problem("obstacle.toml", {"method.collocation": search})
planner.explore(problem, "polynomial", samples=2, time_limit_s=300)"""  # the page ends it
TURNING = """import planner
problem = planner.load_problem("crossing.toml", {"compensation.on": True, "machine.step_s": 0.01})
planner.explore(problem, "polynomial", samples=20)"""

LEFT = {
    "restarted": "jupyterapp.commands.execute('notebook:restart-kernel');",
    "died": "kernel.requestExecute({code: 'import os; os._exit(1)'});",
}
"""How a kernel leaves its page, in a notebook of that name."""

READY = """() => {
    const kernel = window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel;
    return kernel?.connectionStatus === "connected" && "jupyter.widget" in kernel._targetRegistry;
}"""
"""The page hears the kernel, and the part of it that shows widgets does.

A notebook is called idle before that: what is run then is lost, or its widget is, of which the page
says "Exception opening new comm" and shows a line of text for ever.
"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    # Imported when they are used: they take seconds.
    nbformat = pytest.importorskip("nbformat", reason="needs the extra 'dev'")
    pytest.importorskip("anywidget", reason="needs the extra 'notebook'")
    pytest.importorskip("jupyterlab", reason="needs the extra 'notebook'")
    folder = tmp_path_factory.mktemp("jupyter")
    for name in ("paper", "obstacle", "crossing"):
        shutil.copy(ROOT / "problems" / f"{name}.toml", folder)
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    sources = {"try": SOURCE, "slow": SLOW, "turning": TURNING}
    for name, source in {**sources, **dict.fromkeys(LEFT, SOURCE)}.items():
        cells = [nbformat.v4.new_code_cell(source)]
        whole = nbformat.v4.new_notebook(cells=cells, metadata=kernel)
        nbformat.write(whole, folder / f"{name}.ipynb")
    with lab_server(folder) as found:
        yield found


@pytest.fixture(scope="module")
def loaded(browser: Any, address: str) -> Iterator[Callable[[str], Any]]:
    """The page of a notebook that was run; it is loaded once, which takes seconds."""
    pages: dict[str, Any] = {}

    def load(name: str) -> Any:
        page = browser.new_context().new_page()
        page.set_default_timeout(60_000)
        page.goto(f"{address}doc/tree/{name}.ipynb")
        page.wait_for_function(READY)
        # Not by its key, which on a busy machine comes before the cell hears it.
        page.evaluate("jupyterapp.commands.execute('notebook:run-all-cells')")
        page.wait_for_selector(".px[data-kind], .jp-OutputArea-output pre")
        failure = page.locator(".jp-OutputArea-output pre")
        assert failure.count() == 0, failure.all_text_contents()
        return page

    yield lambda name: pages.get(name) or pages.setdefault(name, load(name))
    for page in pages.values():
        page.context.close()


@pytest.fixture
def show(loaded: Callable[[str], Any]) -> Callable[..., Any]:
    """Shows an explorer with the settings it began with: `show(name, width=, second=)`."""

    def shown(name: str, width: int = 1500, second: bool = False) -> Any:
        """Without the second plan, which each setting plans anew, unless a test is about it."""
        page = loaded(name)
        page.set_viewport_size({"width": width, "height": 1500})
        if pressed(page, "second") != second:
            page.locator("[data-button=second]").click()
        settled(page)
        number = page.locator(".px").get_attribute("data-number")
        page.locator("[data-button=reset]").click()
        page.wait_for_selector(f".px[data-open='0']:not([data-number='{number}'])")
        return page

    return shown


def pressed(page: Any, button: str) -> bool:
    return bool(page.locator(f"[data-button={button}]").get_attribute("aria-pressed") == "true")


def settled(page: Any) -> None:
    """Wait until nothing is open any more."""
    page.wait_for_selector(".px[data-open='0']")


def drawn(page: Any, panel: str) -> str:
    return str(page.locator(f"[data-panel={panel}] svg").inner_html())


def slide(page: Any, control: str, value: float) -> None:
    """Move a slider as a hand does, and wait for the picture."""
    number = int(page.locator(".px").get_attribute("data-number"))
    page.locator(f"[data-control='{control}']").evaluate(
        "(e, v) => { e.value = v; e.dispatchEvent(new Event('input', {bubbles: true})) }", value
    )
    page.wait_for_function(f"Number(document.querySelector('.px').dataset.number) > {number}")


def number(page: Any, control: str) -> Any:
    """The field of a slider's number."""
    return page.locator(f"[data-number='{control}']")


def drag(page: Any, panel: str, place: int, right: int, down: int) -> None:
    """Drag a handle of a figure."""
    handle = page.locator(f"[data-panel={panel}] .handle").nth(place)
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=4)
    page.mouse.up()


def code(page: Any) -> str:
    if not pressed(page, "code"):
        page.locator("[data-button=code]").click()
    page.wait_for_function("document.querySelector('.px-texts textarea')?.value.includes('import')")
    return str(page.locator(".px-texts textarea").input_value())


def picture(page: Any, name: str, otherwise: Path) -> None:
    """A screenshot, into $PLANNER_SCREENSHOTS where that is set."""
    path = Path(os.environ.get("PLANNER_SCREENSHOTS", otherwise)) / f"{name}.png"
    page.locator(".px").screenshot(path=path)
    assert path.stat().st_size > 20_000


def test_sensitivities_are_bars_that_follow_the_weight(show: Any, tmp_path: Path) -> None:
    page = show("try")
    page.locator("[data-control='method']").select_option("desensitised")
    settled(page)
    page.locator("[data-button=tuning]").click()
    blocks = page.locator(".px-tuning .px-error")
    assert blocks.count() > 5

    def bars() -> dict[str, float]:
        return {
            block.locator(".px-name").text_content(): float(
                block.locator(".px-bar").first.text_content().split()[0]
            )
            for block in blocks.all()
        }

    calm = bars()
    slide(page, "method.desensitised.effort", 999)
    settled(page)
    cheap = bars()
    assert max(cheap[name] / calm[name] for name in calm if calm[name]) > 1.2, "less is weighed"
    assert page.locator(".px-tuning .px-before").count() == len(calm)
    shade = page.locator(".px-grid").evaluate("e => getComputedStyle(e).opacity")
    assert shade == "1", "grey only while planning"
    page.locator("[data-button=keep]").click()
    page.wait_for_selector(".px-bar:has-text('kept 1')")
    for width in (700, 1500):  # a longer text beside a bar made it shorter
        page.set_viewport_size({"width": width, "height": 1500})
        places = page.locator(".px-bar .px-place")
        assert len(set(places.evaluate_all("all => all.map((e) => e.offsetWidth)"))) == 1
    page.locator("[data-button=drop]").click()
    picture(page, "tuning", tmp_path)
    page.locator("[data-button=tuning]").click()
    assert blocks.count() == 0


def milliseconds(page: Any, values: range) -> float:
    """Median time from a slider's movement to the new picture."""
    times = []
    for value in values:
        slide(page, "goal.travel", value)
        times.append(float(page.locator(".px").get_attribute("data-picture-ms")))
        settled(page)
    return median(times)


def test_the_explorer_follows_sliders_pointer_and_buttons(show: Any, tmp_path: Path) -> None:
    page = show("try")
    assert page.locator(".px").get_attribute("data-kind") == "verification failed"
    assert "input u2 reaches" in page.locator(".px-words").text_content()
    panels = ["z2", "z", "joints", "inputs", "plane", "map", "error"]
    before = {name: drawn(page, name) for name in panels}
    slide(page, "goal.travel", 420)  # of 1000: 0.827 rad
    settled(page)
    assert page.locator(".px .panel svg").count() == len(panels)
    for name in panels:
        assert drawn(page, name) != before[name], name
    polynomial = milliseconds(page, range(380, 420, 16))

    page.locator("[data-control='method.polynomial.points']").select_option("one")
    page.wait_for_selector("[data-control='method.polynomial.points:0:1']")
    settled(page)
    assert page.locator(".px").get_attribute("data-kind") == "verification failed"
    still = drawn(page, "z2")
    drag(page, "z2", 0, 12, 10)
    settled(page)
    assert drawn(page, "z2") != still
    points = re.search(r"'method.polynomial.points': \[\[([\d.]+), (-[\d.]+)\]\]", code(page))
    assert float(points[1]) > 5.1
    assert number(page, "method.polynomial.points:0:0").input_value() == points[1]

    page.locator("[data-button=file]").click()
    page.wait_for_function("document.querySelector('.px-texts textarea').value.includes('[goal]')")
    picture(page, "refused", tmp_path)

    page.locator("[data-control=method]").select_option("collocation")
    page.wait_for_selector(".px[data-kind=verified]")
    follows = "document.querySelector('.px-texts textarea').value.includes('--method collocation')"
    page.wait_for_function(follows)
    collocation = milliseconds(page, range(380, 420, 16))
    page.wait_for_selector(".px[data-kind=verified]")
    picture(page, "verified", tmp_path)
    print(f"slider to picture: {polynomial:.0f} ms polynomial, {collocation:.0f} ms collocation")


def rows(page: Any) -> list[list[str]]:
    """The rows of the table of plans."""
    lines = page.locator(".px-table tbody tr").all()
    return [[cell.inner_text() for cell in line.locator("th, td").all()] for line in lines]


def test_two_plans_stand_in_every_figure_and_any_curve_can_be_kept(
    show: Any, tmp_path: Path
) -> None:
    page = show("try", second=True)
    assert page.locator(".px").get_attribute("data-kind") == "verification failed", "it stays"
    mine, other = rows(page)
    assert mine[0].split()[0] == "polynomial"
    assert "verification failed" in mine[0]
    assert other[0] == "collocation"
    assert all(float(number) >= 0 for number in other[1:])
    assert float(other[1]) < float(mine[1]), "least effort"
    titles = page.locator(".px-table thead th").all_text_contents()
    assert [title.split()[0] for title in titles][:2] == ["plan", "effort"]
    for panel in ("z2", "z", "joints", "inputs", "plane", "map", "error"):
        assert page.locator(f"[data-panel={panel}] .curve.beside").count() > 0, panel
    assert page.locator("[data-panel=joints] .entry").count() == 3, "the table names the others"

    kept = page.locator("[data-panel=z2] .curve.beside-1")
    before = page.locator("[data-panel=z2] .curve:not(.beside)").get_attribute("d")
    page.locator("[data-button=keep]").click()
    assert kept.get_attribute("d") == before
    choose(page, "collocation")
    settled(page)
    assert page.locator(".px").get_attribute("data-kind") == "verified"
    words = [row[0] for row in rows(page)]
    assert words[:2] == ["collocation", "polynomial"]
    assert re.match(r"kept \d: polynomial", words[2])
    assert rows(page)[2][1:] == mine[1:]
    page.locator("[data-button=reset]").click()
    settled(page)
    picture(page, "two-plans", tmp_path)
    page.locator("[data-button=drop]").click()
    assert kept.count() == 0
    assert len(rows(page)) == 2


def test_machine_and_feedback_are_switched_beside_the_figures(show: Any) -> None:
    page = show("try")
    choose(page, "collocation")  # the polynomial's inputs leave feedback no room
    settled(page)
    assert page.locator(".px .curve.beside").count() == 0
    assert page.locator("[data-panel=joints] .curve.machine").count() == 0
    page.locator("[data-button=machine]").click()
    assert page.locator("[data-panel=joints] .curve.machine").count() == 3
    alone = float(rows(page)[0][5])
    page.locator("[data-button=feedback]").click()
    settled(page)
    assert pressed(page, "feedback")
    assert float(rows(page)[0][5]) < 0.2 * alone, "E"
    assert "feedback=True" in code(page)
    page.locator("[data-button=machine]").click()
    assert page.locator("[data-panel=joints] .curve.machine").count() == 0


def test_where_a_compensated_plan_waits_is_shaded_on_light_and_on_dark(
    loaded: Any, tmp_path: Path
) -> None:
    page = loaded("turning")
    page.set_viewport_size({"width": 1500, "height": 1500})
    choose(page, "collocation")
    page.wait_for_selector(".px[data-kind=verified]")
    settled(page)
    held = page.locator(".px [data-panel=inputs] rect.hold")
    assert held.count() > 0
    assert held.first.bounding_box()["width"] > 10
    assert "the plan waits" in page.locator(".px [data-panel=inputs] .notes").text_content()
    picture(page, "compensated", tmp_path)
    page.evaluate(
        "jupyterapp.commands.execute('apputils:change-theme', {theme: 'JupyterLab Dark'})"
    )
    page.wait_for_selector("[data-jp-theme-light=false]", state="attached")
    paper, ink = (
        sum(
            map(
                int,
                re.findall(
                    r"\d+", page.locator(".px").evaluate(f"(e) => getComputedStyle(e).{name}")
                )[:3],
            )
        )
        for name in ("backgroundColor", "color")
    )
    assert paper < 200 < 500 < ink
    page.wait_for_timeout(300)  # the theme fades in
    picture(page, "dark", tmp_path)
    page.evaluate(
        "jupyterapp.commands.execute('apputils:change-theme', {theme: 'JupyterLab Light'})"
    )
    page.wait_for_selector("[data-jp-theme-light=true]", state="attached")


def test_keys_belong_to_the_explorer_and_not_to_the_notebook(show: Any) -> None:
    page = show("try")
    page.locator("[data-control='start.theta_deg:1']").focus()
    field, moved = number(page, "start.theta_deg:1"), []
    for key in ("ArrowRight", "ArrowLeft", "PageUp", "PageDown", "Home", "End"):
        page.keyboard.press(key)
        moved.append(field.input_value())
    assert moved == ["1.5", "1", "6", "1", "-89", "89"]
    page.locator("[data-control='system.K:0']").focus()
    page.keyboard.press("ArrowLeft")
    assert number(page, "system.K:0").input_value() == "0.860125"
    page.keyboard.press("ArrowRight")
    assert number(page, "system.K:0").input_value() == "0.870125"
    settled(page)
    page.keyboard.press("x")
    page.locator("[data-control=method]").focus()
    page.keyboard.press("x")
    page.wait_for_timeout(200)  # the notebook would cut its cell
    assert page.locator(".px").count() == 1


def test_numbers_are_typed_beside_every_slider(show: Any) -> None:
    page = show("try")
    sliders = page.locator(".px input[type=range]")
    assert sliders.count() == page.locator(".px input[type=number]").count() > 10
    shown = [slider for slider in sliders.all() if slider.is_visible()]
    assert min(slider.bounding_box()["width"] for slider in shown) >= 160
    field = number(page, "goal.theta_deg:0")
    field.fill("45")
    before = int(page.locator(".px").get_attribute("data-number"))
    field.press("Enter")  # with the field still in focus
    page.wait_for_function(f"Number(document.querySelector('.px').dataset.number) > {before}")
    settled(page)
    exact = number(page, "goal.travel")
    exact.fill("0.82123456")
    exact.press("Tab")
    settled(page)
    said = code(page)
    assert "'goal.theta_deg': [45.0, 30.0, 30.0]" in said
    assert "'goal.travel': 0.82123456" in said
    assert float(page.locator("[data-control='goal.theta_deg:0']").input_value()) == pytest.approx(
        1000 * (45 + 89) / 178
    )
    field.fill("")
    field.press("Tab")
    assert field.input_value() == "45", "what is no number is taken back"


def test_the_arm_takes_start_and_goal_by_dragging(show: Any) -> None:
    page = show("try")
    before = drawn(page, "plane")
    drag(page, "plane", 3, 0, -25)  # the first elbow of the goal, up
    settled(page)
    assert drawn(page, "plane") != before
    goal = float(number(page, "goal.theta_deg:0").input_value())
    assert goal > 30
    assert goal % 0.5 == 0, "round, as the slider's steps are"
    assert number(page, "goal.theta_deg:1").input_value() == "30"
    drag(page, "plane", 2, 0, -10)  # the tip of the start
    settled(page)
    assert float(number(page, "start.theta_deg:2").input_value()) > 1


def test_code_and_file_open_below_their_buttons_and_are_copied(show: Any) -> None:
    page = show("try")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    text = code(page)
    button, area = (
        page.locator(place).bounding_box() for place in ("[data-button=code]", ".px-texts textarea")
    )
    assert 0 < area["y"] - (button["y"] + button["height"]) < 20
    page.locator("[data-button=copy]").click()
    assert page.locator("[data-button=copy]").text_content() == "Copied"
    assert page.evaluate("navigator.clipboard.readText()") == text
    page.locator("[data-button=file]").click()
    page.wait_for_function("document.querySelector('.px-texts textarea').value.includes('[goal]')")
    assert page.locator("[data-button=copy]").text_content() == "Copy"
    page.locator("[data-button=file]").click()
    assert page.locator(".px-texts textarea").count() == 0


def test_the_facts_are_read_in_full(show: Any) -> None:
    page = show("try", width=900)
    facts = page.locator(".px-facts")
    facts.evaluate("(e) => { e.textContent = 'a reservation about the plan, '.repeat(20) }")
    assert facts.evaluate(
        "(e) => e.scrollWidth <= e.clientWidth && e.scrollHeight <= e.clientHeight"
    )


def test_a_screen_reader_tells_every_control_from_the_others(show: Any) -> None:
    page = show("try")
    names = page.locator(".px [data-control], .px [data-switch], .px [data-number]").evaluate_all(
        "(all) => all.map((e) => e.getAttribute('aria-label'))"
    )
    assert "Start: θ₁" in names
    assert "Goal: θ₁" in names
    assert len(set(names)) == len(names)
    assert not [name for name in names if "_" in name.replace("k_g", "")]


def test_on_a_phone_the_verdict_comes_before_the_sliders(show: Any, tmp_path: Path) -> None:
    page = show("try", width=420)
    verdict = page.locator(".px-verdict").bounding_box()
    side, chart = (page.locator(f".px-{part}").bounding_box() for part in ("side", "grid"))
    assert verdict["y"] < side["y"] < chart["y"]
    words = page.locator(".px-words")
    assert words.evaluate("(e) => e.scrollHeight <= e.clientHeight + 1"), "read in full"
    page.set_viewport_size({"width": 420, "height": 2900})  # all of it in one picture
    picture(page, "phone", tmp_path)


def test_the_table_of_plans_fits_narrow_pages(show: Any) -> None:
    page = show("try", second=True)
    settled(page)
    page.locator("[data-button=keep]").click()
    for width in (900, 600):
        page.set_viewport_size({"width": width, "height": 1500})
        page.wait_for_timeout(300)
        table = page.locator(".px-table")
        assert table.locator("tbody tr").count() == 3
        assert table.evaluate("e => e.scrollWidth <= e.clientWidth"), width
    page.locator(".px-table button").click()  # for the tests after this one


def choose(page: Any, method: str) -> None:
    page.locator("[data-control=method]").select_option(method)


def busy(page: Any, seconds: int) -> None:
    """Wait until it says that it has planned for so long."""
    said = "document.querySelector('.px-verdict').textContent"
    page.wait_for_function(rf"/planning, ([{seconds}-9]|\d\d) s/.test({said})")


def test_no_verdict_stands_beside_other_settings_and_stop_works(show: Any, tmp_path: Path) -> None:
    page = show("slow")
    root, verdict = page.locator(".px"), page.locator(".px-verdict")
    assert page.locator("[data-button=stop]").is_hidden()
    assert verdict.text_content() == "refused: verification failed"
    assert page.locator("[data-control^='method.polynomial']").count() > 0
    choose(page, "collocation")
    assert verdict.text_content().startswith("planning"), "at once, not when the answer is there"
    assert root.get_attribute("data-kind") is None
    busy(page, 1)
    assert page.locator("[data-control^='method.polynomial']").count() == 0
    assert page.locator("[data-control^='method.collocation']").count() > 0
    assert page.locator(".px-words").text_content() == ""
    assert page.locator(".px-facts").text_content() == ""
    page.wait_for_function("getComputedStyle(document.querySelector('.px-grid')).opacity < 0.5")
    picture(page, "planning", tmp_path)
    page.locator("[data-button=stop]").click()
    page.wait_for_selector(".px[data-kind=stopped], .px[data-kind=verified]", timeout=100_000)
    said = page.locator(".px-words").text_content()
    assert "the Stop button ended" in said
    assert "time limit" not in said
    assert page.locator("[data-button=stop]").is_hidden()


def test_new_settings_end_a_search_that_is_under_way(show: Any) -> None:
    page = show("slow")
    choose(page, "collocation")
    busy(page, 1)
    choose(page, "polynomial")
    page.wait_for_selector(".px[data-kind='verification failed']", timeout=100_000)


def test_reset_ends_a_search_that_is_under_way(show: Any) -> None:
    page = show("slow")
    slide(page, "goal.duration", 500)
    choose(page, "collocation")
    busy(page, 1)
    page.locator("[data-button=reset]").click()
    page.wait_for_selector(".px[data-stage=reset], .px[data-stage=judge]", timeout=100_000)


def test_what_is_asked_comes_first_and_the_solver_is_folded(show: Any) -> None:
    page = show("try")
    names = page.locator(".px-group summary").all_text_contents()
    assert names == ["System", "Start", "Goal", "Method", "Limits", "Solver", "Machine"]
    folded = page.locator(".px-group:not([open]) summary").all_text_contents()
    assert folded == ["Solver", "Machine"]
    before = drawn(page, "plane")
    slide(page, "start.theta_deg:1", 600)
    settled(page)
    assert drawn(page, "plane") != before
    assert number(page, "start.theta_deg:1").input_value() == "18", "of 17.8, the nearest round one"


def test_words_move_nothing_and_break_at_spaces_only(show: Any) -> None:
    page = show("try", width=1100)
    place = page.locator(".px-grid").bounding_box()
    long = page.locator(".px-words").text_content()
    assert len(long) > 100
    broken = page.evaluate("""() => {
        const text = document.querySelector('.px-words').firstChild, range = document.createRange();
        const words = [...text.data.matchAll(/\\S+/g)];
        return words.filter((word) => {
            range.setStart(text, word.index);
            range.setEnd(text, word.index + word[0].length);
            return new Set([...range.getClientRects()].map((r) => r.top)).size > 1;
        }).map((word) => word[0]);
    }""")
    assert broken == []
    choose(page, "collocation")
    page.wait_for_selector(".px[data-kind=verified]")
    settled(page)
    assert page.locator(".px-words").text_content() == ""
    assert page.locator(".px-grid").bounding_box() == place


def test_axes_are_named_clear_of_their_numbers_at_any_duration(show: Any) -> None:
    page = show("try")
    slide(page, "goal.duration", 430)
    settled(page)
    for panel in page.locator(".px .panel").all():
        name = panel.locator("svg text.across")
        assert name.text_content() in ("time (s)", "x (link lengths)", "θ₁ (deg)")
        box = name.bounding_box()
        for other in panel.locator("svg text:not(.across)").all():
            near = other.bounding_box()
            apart = near["x"] > box["x"] + box["width"] or near["x"] + near["width"] < box["x"]
            assert apart or near["y"] + near["height"] <= box["y"] + 1, other.text_content()


def test_pointing_reads_values_and_marks_the_time_in_the_other_figures(show: Any) -> None:
    page = show("try")
    joints = page.locator("[data-panel=joints]")
    joints.locator("svg").hover(position={"x": 180, "y": 90})
    head, *rows = joints.locator(".tip").inner_text().splitlines()
    assert 0 < float(head.removesuffix(" s")) < 10
    assert [row.split()[0] for row in rows] == ["θ₁", "θ₂", "θ₃"]
    inner, outer = joints.locator(".tip").bounding_box(), joints.locator("svg").bounding_box()
    assert outer["y"] <= inner["y"] < outer["y"] + 40
    for other in ("plane", "map", "inputs"):
        assert page.locator(f"[data-panel={other}] .cursor").get_attribute("d")
    chart = page.locator("[data-panel=map]")
    chart.locator("svg").focus()
    page.keyboard.press("End")
    words = chart.locator(".tip").inner_text().split()
    assert words == ["10.00", "s", "θ₁", "30", "deg", "θ₂", "30", "deg"]
    assert page.locator("[data-panel=joints] .cursor").get_attribute("d")

    assert page.locator("[data-panel=plane] .notes").inner_text().startswith("from 0 s to 10 s")
    assert "outside the chart" in page.locator("[data-panel=map] .notes").inner_text()
    poses = page.locator("[data-panel=plane] .pose")
    colours = poses.evaluate_all("(all) => all.map((pose) => pose.style.stroke)")
    assert len(set(colours)) == len(colours) == 10
    assert page.locator("[data-panel=map] path.below").count() == 1


def test_the_mechanism_is_shown_beside_the_sliders_and_follows_them(
    show: Any, tmp_path: Path
) -> None:
    page = show("try")
    assert page.locator(".px-mechanism").is_hidden()
    page.locator("[data-button=mechanism]").click()
    image = page.locator(".px-mechanism img")
    image.wait_for()
    page.wait_for_function("document.querySelector('.px-mechanism img').naturalWidth > 0")
    first = image.get_attribute("src")
    slide(page, "system.K:0", 700)
    page.wait_for_function(
        "(before) => document.querySelector('.px-mechanism img').src !== before", arg=first
    )
    settled(page)
    assert page.locator(".px-verdict").text_content() == "refused: verification failed"
    page.set_viewport_size({"width": 1500, "height": 2000})
    picture(page, "mechanism", tmp_path)
    page.locator("[data-button=mechanism]").click()
    assert page.locator(".px-mechanism").is_hidden()


def with_kernel(page: Any, script: str) -> None:
    """Start what need not end: a dialog, a cell."""
    kernel = "jupyterapp.shell.currentWidget.sessionContext.session.kernel"
    page.evaluate(f"() => {{ const kernel = {kernel}; {script} }}")


@pytest.mark.parametrize("how", LEFT)
def test_after_a_restart_of_the_kernel_the_page_says_so_and_running_the_cell_mends_it(
    how: str, loaded: Callable[[str], Any], tmp_path: Path
) -> None:
    """Nobody hears the page any more, and it went on planning for ever."""
    page = loaded(how)
    page.set_viewport_size({"width": 1500, "height": 1500})
    settled(page)
    root = page.locator(".px")
    verdict = page.locator(".px-verdict").text_content()
    shown = drawn(page, "z2")
    with_kernel(page, LEFT[how])
    page.locator(".jp-Dialog .jp-mod-accept").click()
    page.wait_for_selector(".px[data-kernel=gone]")
    if how == "restarted":
        picture(page, how, tmp_path)
    moved = "(e) => { e.value = 500; e.dispatchEvent(new Event('input', {bubbles: true})) }"
    page.locator("[data-control='goal.duration']").evaluate(moved)
    page.wait_for_timeout(500)
    assert root.get_attribute("data-kernel") == "gone"
    assert drawn(page, "z2") == shown
    assert page.locator(".px-verdict").text_content() == verdict
    assert page.locator(".px-kernel").is_visible()
    page.wait_for_function(READY)
    with_kernel(page, "jupyterapp.commands.execute('notebook:run-all-cells');")
    page.wait_for_selector(".px:not([data-kernel])")
    settled(page)
    slide(page, "goal.travel", 420)
    settled(page)
    assert page.locator(".px").count() == 1
    assert drawn(page, "z2") != shown


def test_while_another_cell_runs_the_page_says_that_the_kernel_is_silent(show: Any) -> None:
    page = show("try")
    verdict, shown = page.locator(".px-verdict").text_content(), drawn(page, "z2")
    # Compiled code keeps the lock: newer kernels hear the page beside a cell of Python.
    code = "import ctypes; ctypes.PyDLL(None).sleep(14)"
    with_kernel(page, f"kernel.requestExecute({{code: '{code}'}});")
    number = page.locator(".px").get_attribute("data-number")
    closed = "file" if pressed(page, "code") else "code"
    page.locator(f"[data-button={closed}]").click()  # its answer brings no verdict
    page.wait_for_selector(".px[data-kernel=silent]")
    page.wait_for_selector(f".px[data-open='0']:not([data-kernel]):not([data-number='{number}'])")
    assert page.locator(".px-verdict").text_content() == verdict
    assert page.locator(".px-kernel").text_content() == ""
    assert drawn(page, "z2") == shown
