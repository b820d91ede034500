"""The pictures of docs/gallery.md, each drawn by the lines above it (`make gallery`)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from planner.support.files import write_text
from planner.support.package import provenance

PAGE = Path(__file__).parents[2] / "docs" / "gallery.md"
BLOCK = re.compile(r"^```python\n(.*?)^```\n\n!\[.+?\]\((.+?)\)", flags=re.DOTALL | re.MULTILINE)


def blocks() -> Iterator[tuple[str, Path]]:
    """Each block of code on the page, and the picture below it."""
    for code, picture in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        yield code, (PAGE.parent / picture).resolve()


def figure_of(code: str) -> Any:
    """The Matplotlib figure that a block draws; blocks read files of the checkout's root."""
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)
    return names["figure"]


if __name__ == "__main__":
    for code, path in blocks():
        print(path.name, flush=True)
        path.parent.mkdir(exist_ok=True)
        figure_of(code).savefig(path, dpi=80)
    note = "The pictures of [the gallery](../../docs/gallery.md), each drawn by the lines above it."
    write_text(path.parent / "README.md", f"# Gallery\n\n{note}\n\n{provenance('make gallery')}\n")
