"""CONTRIBUTING.md leads where it says, and each room says what is in it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import planner

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n?)*)", TEXT, flags=re.M))
PATH = re.compile(r"(?<![\w/.])(?:planner|tests|docs|problems|results|\.ci)/[\w./-]*[\w/]")
QUOTED = re.compile(r"`([^`\n]+)`")
RECIPES = [name for name in SECTIONS if name.startswith(("A new", "From outside"))]
ROOMS = sorted(path.parent for path in (ROOT / "planner").rglob("__init__.py"))


def test_every_file_that_is_named_is_there() -> None:
    found = set(PATH.findall(TEXT))
    assert len(found) > 60
    roots = {name for name in QUOTED.findall(TEXT) if re.fullmatch(r"[\w.]+\.(toml|cff|md)", name)}
    assert roots >= {"pyproject.toml", "CITATION.cff", "CHANGELOG.md"}
    for name in found | roots:
        path = ROOT / name
        assert (path.parent if path.stem == "NAME" else path).exists(), name


def items(section: str) -> list[str]:
    """The items of a section's lists, each with the lines that go on from it."""
    return re.findall(r"^(?:\d\.|-) .*(?:\n  .*)*", SECTIONS[section], flags=re.M)


def bound(path: Path) -> set[str]:
    """Names that a file defines, assigns or imports; of other files than Python's, all words."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py" or "tests" in path.parts:
        return set(re.findall(r"\w+", text))
    out = set()
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.alias(name=name):
                out.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                out.add(name)
    return out


@pytest.mark.parametrize("section", RECIPES)
def test_what_a_recipe_names_is_in_its_files(section: str) -> None:
    assert items(section)
    for item in items(section):
        paths = [ROOT / name for name in PATH.findall(item) if "NAME" not in name]
        assert paths, item
        files = [p for path in paths for p in ([path] if path.is_file() else path.glob("*.py"))]
        there = set().union(*map(bound, files))
        for name in QUOTED.findall(item):
            if re.fullmatch(r"planner\.\w+", name) and name != "planner.plugins":
                assert hasattr(planner, name.partition(".")[2]), name
            if name.isidentifier():
                assert name in there, f"{name}, of: {item}"


def test_the_jobs_and_the_way_in_from_outside_are_told() -> None:
    assert len(RECIPES) == 9


def test_the_rooms_are_all_in_the_table() -> None:
    told = re.findall(r"^\| `planner/(\w+)", SECTIONS["The rooms"], flags=re.M)
    assert told[0] == "errors"
    assert sorted(told[1:]) == [p.name for p in ROOMS if p.parent.name == "planner"]


def test_the_targets_of_make_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"(?:^|`)make (\w+)", TEXT, flags=re.M)):
        assert re.search(rf"^[\w ]*\b{target}\b[\w ]*:", makefile, re.M), target


def contents(room: Path) -> Iterator[str]:
    yield from (path.stem for path in room.glob("[!_]*.py"))
    yield from (path.parent.name for path in room.glob("*/__init__.py"))


@pytest.mark.parametrize(
    "room", [p for p in ROOMS if p.name != "planner"], ids=lambda p: str(p.relative_to(ROOT))
)
def test_a_room_says_what_is_in_it(room: Path) -> None:
    said = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8"))) or ""
    assert {name for name in contents(room) if f"`{name}`" not in said} == set()


def test_questions_have_a_first_file() -> None:
    rows = re.findall(r"^\| ([^|`-].*?) \| (`.*) \|$", SECTIONS["Where would I look for ..."], re.M)
    assert len(rows) >= 10
    assert all(PATH.search(answer) for _, answer in rows)


def test_each_file_of_tests_runs_by_itself() -> None:
    """`pytest FILE` has the file's folder on its path and not the project's."""
    found = [path for path in (ROOT / "tests").rglob("*.py") if "\nfrom tests" in path.read_text()]
    assert found == []
