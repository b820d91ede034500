"""What must agree between the files at the root."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import planner

ROOT = Path(__file__).parents[1]


def test_every_file_says_the_same_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert project["version"] == planner.__version__
    assert f"\nversion: {planner.__version__}\n" in citation


def test_files_and_commands_that_the_readme_names_exist() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?:)([^)#]+)", readme)
    problems = re.findall(r"problems/[\w-]+\.toml", readme)
    assert problems
    for name in {*links, *problems}:
        assert (ROOT / name).exists(), f"README.md names {name}"
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", readme):
        assert re.search(rf"^[\w ]*\b{target}\b[\w ]*:", makefile, re.M), target


def test_python_of_the_readme_runs(paper: planner.Problem) -> None:
    """The lines of Python are run with a small sample, from the checkout's root."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", readme, re.S)
    assert blocks
    code = blocks[0].replace("problems/", f"{ROOT}/problems/").replace("1000", "20")
    names: dict[str, object] = {}
    exec(compile(code, "<README>", "exec"), names)
    assert names["check"].ok  # type: ignore[attr-defined]
