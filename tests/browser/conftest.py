"""Pages in a real headless Chromium; tests that ask for one are skipped where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def find_browser() -> str | None:
    """The program, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


NewPage = Callable[..., "Page"]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium as installed on this machine, without a window."""
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright (extra: dev)")
    program = find_browser()
    if program is None:
        pytest.skip("needs Chromium; on Debian and Ubuntu: apt install chromium")
    with api.sync_playwright() as session:
        chromium = session.chromium.launch(executable_path=program, args=FLAGS, headless=True)
        yield chromium
        chromium.close()


@pytest.fixture
def new_page(browser: Browser) -> Iterator[NewPage]:
    """Opens pages: `new_page(width=, height=, strict=, **options of playwright's new_context)`.

    A strict page (the default) fails its test if a script of the page failed or logged an error, or
    if the page asked for anything over a network.
    """
    contexts: list[Any] = []
    faults: list[str] = []

    def note(request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:", "about:")):
            faults.append(f"asked for {request.url}")

    def open_page(width: int = 1200, height: int = 900, strict: bool = True, **options: Any) -> Any:
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        context.set_default_timeout(10_000)
        contexts.append(context)
        page = context.new_page()
        if strict:
            page.on("pageerror", lambda error: faults.append(str(error)))
            page.on("console", lambda m: faults.append(m.text) if m.type == "error" else None)
            page.on("request", note)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert faults == []
