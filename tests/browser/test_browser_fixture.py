"""The browser at hand runs scripts and takes on the settings asked for."""

from __future__ import annotations

from typing import Any


def test_a_page_runs_its_script_in_the_colours_asked_for(new_page: Any) -> None:
    page = new_page(width=390, color_scheme="dark")
    page.set_content("<p id=p></p><script>p.textContent = `${innerWidth} ${1 + 1}`</script>")
    assert page.locator("#p").text_content() == "390 2"
    assert page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches") is True
