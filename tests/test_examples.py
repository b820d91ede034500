"""Examples of the documentation run, and every public name has one."""

from __future__ import annotations

import doctest
import inspect
import json
import re
from inspect import isfunction
from pathlib import Path

import pytest

import planner

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "reference" / "index.md"
EXAMPLES = re.findall(
    r"^```pycon\n(.*?)^```", REFERENCE.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
)


def test_the_examples_of_the_reference_print_what_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "problems").symlink_to(ROOT / "problems")
    monkeypatch.chdir(tmp_path)
    text = "\n".join(EXAMPLES)
    test = doctest.DocTestParser().get_doctest(text, {}, "reference", str(REFERENCE), 0)
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    assert runner.run(test, out=said.append).failed == 0, "".join(said)


def test_every_public_name_has_an_example_that_is_run() -> None:
    """In the reference, the gallery, or a notebook; other tests run these two."""
    text = "\n".join(EXAMPLES) + (ROOT / "docs" / "gallery.md").read_text("utf-8")
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        text += "".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    text += (ROOT / "tests" / "plugin" / "planner_tricycle.py").read_text("utf-8")
    functions = [getattr(planner, n) for n in planner.__all__ if re.search(rf"\b{n}\b", text)]
    text += " ".join(  # what they return has been seen
        str(inspect.signature(each).return_annotation) for each in functions if isfunction(each)
    )
    missing = [name for name in planner.__all__ if not re.search(rf"\b{name}\b", text)]
    assert missing == []
