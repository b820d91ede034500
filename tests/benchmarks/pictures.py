"""Pictures of the report's page: light, dark, and on a phone.

python tests/benchmarks/pictures.py         # writes results/report/*.png; needs Chromium
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

import planner
from planner.report.result_folder import folder
from planner.support.files import write_bytes, write_text
from planner.support.package import provenance

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "browser"))

from conftest import FLAGS, find_browser  # noqa: E402

VIEWS: dict[str, tuple[int, str, float]] = {
    "light": (1100, "light", 4.0),
    "dark": (1100, "dark", 6.0),
    "phone": (390, "light", 3.0),
}
SHOWN_PX = 2400
"""Height of a picture: answer, motion and numbers; the whole page has 6,000 pixels."""

HEAD = """# The report's page

`planner compare problems/paper.toml --feedback --out out/paper --report` writes it. It begins with
the plan to take, because of what, and at what price; the motion opens on that plan beside
collocation's. The pictures show how the page begins, for 200 machines; all figures over time
follow below.

{provenance}

| light | dark | phone |
| --- | --- | --- |
| ![light](light.png) | ![dark](dark.png) | ![phone](phone.png) |
"""


def main() -> int:
    """Compare, write the page, look at it three times."""
    os.chdir(ROOT)
    problem = planner.load_problem("problems/paper.toml")
    found = planner.compare(problem, samples=200, seed=0, feedback=True)
    program = find_browser()
    if program is None:
        print("needs Chromium", file=sys.stderr)
        return 1
    page = found.save("out/report", report=True).resolve() / "report.html"
    with folder("results/report") as target, sync_playwright() as session:
        browser = session.chromium.launch(executable_path=program, args=FLAGS)
        for name, view in VIEWS.items():
            write_bytes(target / f"{name}.png", picture(browser, page, *view))
        browser.close()
        write_text(target / "README.md", HEAD.format(provenance=provenance("make report")))
    return 0


def picture(browser: Any, path: Path, width: int, scheme: str, t: float) -> bytes:
    """The beginning of the page with the motion's clock at t, in few colours."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    page.goto(path.as_uri())
    page.locator("#scrub").evaluate(
        "(e, t) => { e.value = t; e.dispatchEvent(new Event('input')); }", t
    )
    shot = Image.open(io.BytesIO(page.screenshot(full_page=True))).convert("RGB")
    context.close()
    shot = shot.crop((0, 0, shot.width, min(shot.height, SHOWN_PX)))
    small = shot.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    stream = io.BytesIO()
    small.save(stream, "PNG", optimize=True)
    return stream.getvalue()


if __name__ == "__main__":
    sys.exit(main())
