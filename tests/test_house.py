"""Who may import whom: a file asks its own room and rooms above it, and nothing goes in a circle.

Every import counts: at the top of a file, inside a function, and those for type checkers only.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from english import readings

import planner

HOME = Path(planner.__file__).parent
BELOW = ("errors", "support", "systems", "problem", "plan", "verification", "methods")
MACHINE = (*BELOW[:5], "machine")
JUDGED = (*BELOW, "machine", "compensation", "solve")
MAY = {
    **{room: BELOW[: k + 1] for k, room in enumerate(BELOW)},
    "machine": MACHINE,
    "verification": (*MACHINE, "verification"),
    "compensation": (*BELOW, "machine"),
    "solve": (*BELOW, "machine", "compensation"),
    "reproduce": (),
    "retime": BELOW,
    "check": (*BELOW, "solve"),
    "robustness": (*JUDGED, "robustness"),
    "comparison": (*JUDGED, "comparison"),
    "sweep": (*JUDGED, "check", "retime", "robustness", "comparison", "sweep"),
    "report": (*MACHINE, "verification", "check", "robustness", "comparison", "sweep", "report"),
    "explorer": (*JUDGED, "check", "retime", "robustness", "comparison", "report", "explorer"),
    "paper": (*JUDGED, "check", "retime", "robustness", "comparison", "report", "paper"),
}
"""For each room what it may import; `cli` and the package's own face may import everything."""


def name_of(path: Path) -> str:
    parts = ["planner", *path.relative_to(HOME).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {name_of(path): path for path in sorted(HOME.rglob("*.py"))}
FACES = {"planner", "planner.report"}
"""Packages whose `__init__` hands on public names when they are first used."""
OTHERS = [name for name in FILES if name not in FACES]


@cache
def tree(name: str) -> ast.Module:
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


@cache
def nodes(name: str) -> list[ast.AST]:
    return list(ast.walk(tree(name)))


def imports(name: str) -> Iterator[str]:
    for node in nodes(name):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in FILES)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: imports name the whole path"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                if whole in FILES or node.module in FILES:
                    yield whole if whole in FILES else str(node.module)


@cache
def arrows(name: str) -> set[str]:
    return set(imports(name)) - {name}


def room(name: str) -> str:
    return name.split(".")[1] if "." in name else name


def test_a_file_imports_its_own_room_and_those_above_it() -> None:
    for name in OTHERS:
        if room(name) not in ("cli", "__main__"):
            allowed = MAY[room(name)]
            assert {other for other in arrows(name) if room(other) not in allowed} == set(), name


def test_nothing_is_imported_in_a_circle() -> None:
    left = {name: arrows(name) - FACES for name in OTHERS}
    while free := [name for name, others in left.items() if not others & left.keys()]:
        for name in free:
            del left[name]
    assert set(left) == set()


def test_a_name_with_an_underscore_stays_in_its_file() -> None:
    """That all others are imported from where they are defined, mypy sees."""
    for name in OTHERS:
        for node in nodes(name):
            if isinstance(node, ast.ImportFrom):
                assert not [alias for alias in node.names if alias.name.startswith("_")], name


def test_results_hand_themselves_to_pictures_and_their_own_room_only() -> None:
    """By name: the one way to what may not be imported."""
    for name in OTHERS:
        for node in nodes(name):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "import_function":
                assert room(ast.literal_eval(node.args[0])) in ("report", room(name)), name


def test_rooms_are_few_and_folders_small() -> None:
    rooms = [path for path in HOME.iterdir() if (path / "__init__.py").exists()]
    loose = {path.stem for path in HOME.glob("*.py")} - {"__init__", "__main__"}
    assert len(rooms) <= 14
    assert len(loose) <= 6
    for folder in {path.parent for path in FILES.values()}:
        assert len(list(folder.glob("[!_]*.py"))) <= 12, folder


def test_a_room_opens_with_words_only() -> None:
    for name in OTHERS:
        if FILES[name].name == "__init__.py":
            assert ast.get_docstring(tree(name)), name
            assert len(tree(name).body) == 1, name


def test_the_suite_uses_nothing_of_the_campaigns() -> None:
    """Their own test does; and each file of tests runs by itself: `pytest FILE` has the file's
    folder and `tests/` on its path, not the project's."""
    tests = Path(__file__).parent
    campaigns = {path.stem for path in (tests / "benchmarks").glob("*.py")}
    for path in tests.rglob("*.py"):
        if path.parent.name == "benchmarks" or path.name == "test_campaigns.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [getattr(node, "module", None) or node.names[0].name]
                assert not {name.partition(".")[0] for name in names} & {*campaigns, "tests"}, path


READS_ENGLISH = {
    "cli/app.py:_report_usage_error": "another program's message, cut",
    "cli/start.py:new": "a template in TOML",
    "errors.py:__init__": "the first line, for tables",
    "errors.py:solver_answer": "another program's message, cut",
    "plan/spec.py:of_label": "a method with options as users write it; this is its only parser",
    "report/figures/style.py:title": "a line break",
    "report/folders.py:_file_name": "letters that file names may have",
    "report/page/page.py:_name": "a line break",
    "report/page/page.py:_table": "mathematical symbols",
    "support/tables.py:_break_head": "a line break",
    "sweep/sweep_file.py:_places": "a place in the user's file",
}
"""Functions that may read a text of their own, each with what it reads or sets."""


def test_no_code_reads_its_own_english() -> None:
    """What another part needs is a field: words may change without changing what happens."""
    trees = {str(FILES[name].relative_to(HOME)): tree(name) for name in FILES}
    found = list(readings(trees))
    assert [each for each in found if each[0] not in READS_ENGLISH] == []
    assert {where for where, _ in found} == READS_ENGLISH.keys(), "an excuse is not needed"


@pytest.mark.parametrize(
    "line",
    [
        "return '(tried' in error.advice",
        "return v.label.removeprefix('joint ')",
        "why = row['why']; return re.search('no plan', why)",
        "return column.title == 'verdict'",
        "reached = words(x); return reached[4:]",
        "try: f()\n    except PlannerError as e: return str(e).splitlines()[0]",
        "i, label = pairs[0]; return 'zero' in label",
        "for part in x: return 'planner ' in part",
    ],
)
def test_each_way_of_reading_english_is_found(line: str) -> None:
    other = "def words(x) -> str:\n    return f'the plan breaks {x}'\n"
    assert len(list(readings({"a.py": ast.parse(f"{other}def g(x):\n    {line}")}))) == 1
