"""The explorer in a real browser on a real Jupyter server: sliders move the picture."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from lab_server import lab_server

ROOT = Path(__file__).parents[2]
SOURCE = """import planner
problem = planner.load_problem("paper.toml", {"goal.travel": 0.82})
explorer = planner.explore(problem, samples=5)
explorer"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    # Imported when they are used: they take seconds.
    nbformat = pytest.importorskip("nbformat", reason="needs the extra 'dev'")
    pytest.importorskip("anywidget", reason="needs the extra 'notebook'")
    pytest.importorskip("jupyterlab", reason="needs the extra 'notebook'")
    folder = tmp_path_factory.mktemp("jupyter")
    shutil.copy(ROOT / "problems" / "paper.toml", folder)
    cells = [nbformat.v4.new_code_cell(SOURCE)]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=kernel), folder / "try.ipynb")
    with lab_server(folder) as found:
        yield found


@pytest.fixture
def page(new_page: Any, address: str) -> Any:
    opened = new_page(width=1500, height=1100, strict=False)
    opened.set_default_timeout(60_000)
    opened.goto(f"{address}doc/tree/try.ipynb")
    opened.locator(".jp-CodeCell .cm-content").first.click()
    opened.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]", state="attached")
    opened.keyboard.press("Shift+Enter")
    opened.wait_for_selector(".px[data-kind], .jp-OutputArea-output pre")
    failure = opened.locator(".jp-OutputArea-output pre:not(.px-words)")
    assert failure.count() == 0, failure.all_text_contents()
    return opened


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


def drag_first_point(page: Any, right: int, down: int) -> None:
    handle = page.locator("[data-panel=z2] .handle")
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y + down, steps=4)
    page.mouse.up()


def code(page: Any) -> str:
    page.locator("[data-button=code]").click()
    page.wait_for_function("document.querySelector('.px-texts textarea')?.value.includes('import')")
    return str(page.locator(".px-texts textarea").input_value())


def picture(page: Any, name: str, otherwise: Path) -> None:
    """A screenshot, into $PLANNER_SCREENSHOTS where that is set."""
    path = Path(os.environ.get("PLANNER_SCREENSHOTS", otherwise)) / f"{name}.png"
    page.locator(".px").screenshot(path=path)
    assert path.stat().st_size > 20_000


def milliseconds(page: Any, values: range) -> float:
    """Median time from a slider's movement to the new picture."""
    times = []
    for value in values:
        slide(page, "goal.travel", value)
        times.append(float(page.locator(".px").get_attribute("data-picture-ms")))
        settled(page)
    return median(times)


def test_the_explorer_follows_sliders_pointer_and_buttons(page: Any, tmp_path: Path) -> None:
    settled(page)
    assert page.locator(".px").get_attribute("data-kind") == "verification failed"
    assert "input u2 reaches" in page.locator(".px-words").text_content()
    panels = ["z2", "z", "joints", "inputs", "plane", "error"]
    before = {name: drawn(page, name) for name in panels}
    slide(page, "goal.travel", 420)  # of 1000: 0.827 rad
    settled(page)
    assert page.locator(".px .panel svg").count() == len(panels)
    for name in panels:
        assert drawn(page, name) != before[name], name
    polynomial = milliseconds(page, range(380, 420, 8))

    page.locator("[data-control='method.polynomial.points']").select_option("one")
    page.wait_for_selector("[data-control='method.polynomial.points:0:1']")
    settled(page)
    assert page.locator(".px").get_attribute("data-kind") == "verification failed"
    still = drawn(page, "z2")
    drag_first_point(page, 12, 10)
    settled(page)
    assert drawn(page, "z2") != still
    points = re.search(r"'method.polynomial.points': \[\[([\d.]+), (-[\d.]+)\]\]", code(page))
    assert points is not None
    assert float(points[1]) > 5.1
    shown = page.locator("[data-control='method.polynomial.points:0:0'] + output").text_content()
    assert float(shown.split()[0]) == pytest.approx(float(points[1]), rel=1e-3)

    page.locator("[data-button=file]").click()
    page.wait_for_function("document.querySelector('.px-texts textarea').value.includes('[goal]')")
    picture(page, "refused", tmp_path)

    page.locator("[data-control=method]").select_option("collocation")
    page.wait_for_selector(".px[data-kind=verified]")
    follows = "document.querySelector('.px-texts textarea').value.includes('--method collocation')"
    page.wait_for_function(follows)
    collocation = milliseconds(page, range(380, 420, 8))
    page.wait_for_selector(".px[data-kind=verified]")
    picture(page, "verified", tmp_path)
    print(f"slider to picture: {polynomial:.0f} ms polynomial, {collocation:.0f} ms collocation")
