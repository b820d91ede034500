"""README, CONTRIBUTING, the documentation and the files at the root lead where they say."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import main
from registered import restored

import planner
from planner.cli.app import COMMANDS

ROOT = Path(__file__).parents[1]
PATH = re.compile(r"(?<![\w/.])(?:planner|tests|docs|problems|results|\.ci)/[\w./-]*[\w/]")
QUOTED = re.compile(r"`([^`\n]+)`")
ROOMS = sorted(path.parent for path in (ROOT / "planner").rglob("__init__.py"))


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


TEXT, README, MAKEFILE = read("CONTRIBUTING.md"), read("README.md"), read("Makefile")
SECTIONS = dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n?)*)", TEXT, flags=re.M))
RECIPES = [name for name in SECTIONS if name.startswith(("A new", "From outside"))]
REFUSALS = re.findall(r"^```console\n(.*?)^```", read("docs/troubleshooting.md"), flags=re.S | re.M)


# -- names of files, targets and versions ----------------------------------------------------------


def test_files_that_are_named_are_there() -> None:
    found = set(PATH.findall(TEXT))
    assert len(found) > 60
    roots = {name for name in QUOTED.findall(TEXT) if re.fullmatch(r"[\w.]+\.(toml|cff|md)", name)}
    assert roots >= {"pyproject.toml", "CITATION.cff", "CHANGELOG.md"}
    told = set(re.findall(r"\]\((?!https?:)([^)#]+)|(problems/[\w-]+\.toml)", README))
    shown = set(re.findall(r"`(tests/[\w./]+)`", read("docs/promises.md")))
    assert told
    assert shown
    for name in found | roots | shown | {link or problem for link, problem in told}:
        path = ROOT / name
        assert (path.parent if path.stem == "NAME" else path).exists(), name


def test_links_lead_to_files_of_the_repository() -> None:
    """As they do where the pages are read without being built; the site alone has `toctree`."""
    pages = [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("results/**/*.md"),
    ]  # no copies of notebooks are .md
    broken = [
        f"{path.relative_to(ROOT)}: {link}"
        for path in pages
        for link in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", path.read_text(encoding="utf-8"))
        if not (path.parent / link).exists()
    ]
    assert broken == []


def test_targets_of_make_are_those_that_are_told() -> None:
    """None of them is the name of a folder that would keep make from its work."""
    lines = re.findall(r"^([a-z][a-z -]*):(?!=)", MAKEFILE.replace("\\\n", " "), flags=re.M)
    targets = {name for line in lines for name in line.split()}
    phony = re.findall(r"^\.PHONY:(.*)$", MAKEFILE.replace("\\\n", " "), flags=re.M)
    assert targets == set(" ".join(phony).split())
    told = re.findall(r"(?:^#   |^|`)make ([\w-]+)", MAKEFILE + TEXT + README, flags=re.M)
    assert set(told) <= targets


def test_every_file_says_the_same_version() -> None:
    assert tomllib.loads(read("pyproject.toml"))["project"]["version"] == planner.__version__
    assert f"\nversion: {planner.__version__}\n" in read("CITATION.cff")


def test_python_of_the_readme_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a small sample."""
    monkeypatch.chdir(ROOT)
    code = re.findall(r"```python\n(.*?)```", README, re.S)[0].replace("1000", "20")
    names: dict[str, object] = {}
    exec(compile(code, "<README>", "exec"), names)
    assert names["plan"].verified  # type: ignore[attr-defined]


def test_the_limit_of_your_own_is_kept_and_proven(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the car backs at up to 0.27 m/s."""
    monkeypatch.chdir(ROOT)
    code = re.findall(r"```python\n(.*?)```", read("docs/howto/systems.md"), re.S)[-1]
    names: dict[str, Any] = {}
    with restored():
        exec(code, names)
        plan, problem = names["plan"], names["problem"]
        usual = planner.solve(problem.changed({"limits.speed_range": None}))
    t = np.linspace(0.0, 40.0, 4001)
    assert plan.certificate.ok
    assert -0.2 - 1e-6 <= plan.u(t)[:, 0].min() < -0.19
    assert usual.u(t)[:, 0].min() < -0.25
    assert usual.objective < plan.objective < 1.1 * usual.objective


def test_the_readme_is_read_in_some_minutes() -> None:
    assert len(README.split()) <= 900


def test_the_readme_shows_what_its_python_prints() -> None:
    """Of the machines of the table below it."""
    (printed,) = re.findall(r"^    (Replay\(.*\))$", README, re.M)
    row = next(
        line for line in README.splitlines() if line.startswith("| collocation compensated |")
    )
    E = re.search(r"E median ([\d.]+) deg, 95 % ([\d.]+) deg", printed)
    assert E
    assert f"| {E[1]}, {E[2]} |" in row


# -- CONTRIBUTING ----------------------------------------------------------------------------------


def test_the_angles_to_stand_clear_of_are_those_of_the_machines() -> None:
    problem = planner.load_problem(ROOT / "problems/paper.toml")
    plan = planner.compensate(planner.solve(problem, "collocation"))
    runs = [planner.replay(plan, samples=1000), planner.replay(plan, samples=40, feedback=True)]
    told = [ceil(run.joint_1_range_deg[1]) for run in runs]
    for page in (README, read("docs/howto/bench.md")):
        found = re.search(r"tand clear.*?(\d+)°.*?(\d+)°", page, flags=re.S)
        assert found is not None
        assert [int(angle) for angle in found.groups()] == told


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
    """In each item of its list, with the lines that go on from it."""
    items = re.findall(r"^(?:\d\.|-) .*(?:\n  .*)*", SECTIONS[section], flags=re.M)
    assert items
    assert len(RECIPES) == 11
    for item in items:
        paths = [ROOT / name for name in PATH.findall(item) if "NAME" not in name]
        assert paths, item
        files = [p for path in paths for p in ([path] if path.is_file() else path.glob("*.py"))]
        there = set().union(*map(bound, files))
        for name in QUOTED.findall(item):
            if re.fullmatch(r"planner\.\w+", name) and name != "planner.plugins":
                assert hasattr(planner, name.partition(".")[2]), name
            if name.isidentifier():
                assert name in there, f"{name}, of: {item}"


def test_rooms_and_questions_are_in_their_tables() -> None:
    told = re.findall(r"^\| `planner/(\w+)", SECTIONS["The rooms"], flags=re.M)
    assert told[0] == "errors"
    assert sorted(told[1:]) == [p.name for p in ROOMS if p.parent.name == "planner"]
    rows = re.findall(r"^\| ([^|`-].*?) \| (`.*) \|$", SECTIONS["Where would I look for ..."], re.M)
    assert len(rows) >= 10
    assert all(PATH.search(answer) for _, answer in rows)


def contents(room: Path) -> Iterator[str]:
    yield from (path.stem for path in room.glob("[!_]*.py"))
    yield from (path.parent.name for path in room.glob("*/__init__.py"))


def test_a_room_opens_with_words_only_which_say_what_is_in_it() -> None:
    for room in ROOMS[1:]:
        words = ast.parse((room / "__init__.py").read_text("utf-8"))
        said = ast.get_docstring(words) or ""
        assert len(words.body) == 1 or room.name == "report", room
        assert {name for name in contents(room) if f"`{name}`" not in said} == set(), room


# -- the documentation -----------------------------------------------------------------------------


def test_every_public_name_is_in_the_reference() -> None:
    text = read("docs/reference/index.md")
    shown = set(re.findall(r"^\.\. (?:auto(?!module)\w+|py:data):: (\w+)", text, flags=re.M))
    assert shown == set(planner.__all__)


@pytest.mark.parametrize("block", REFUSALS, ids=[b.splitlines()[0][10:60] for b in REFUSALS])
def test_a_quoted_message_is_what_the_command_prints(
    block: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    command, *said = block.splitlines()
    assert command.startswith("$ planner ")
    status = main(shlex.split(command)[2:])
    printed = " ".join(capsys.readouterr().err.split())
    parts = " ".join("\n".join(said).split()).split("...")
    assert re.fullmatch(".*".join(re.escape(part.strip()) for part in parts), printed), printed
    assert status == (3 if "no plan (" in block else 2)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_examples_of_a_command_stand_on_lines_of_their_own(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main([name, "--help"])
    said = capsys.readouterr().out
    assert "\\b" not in said
    assert len(re.findall(r"^ +Examples?:$", said, flags=re.M)) == said.count("Example")
