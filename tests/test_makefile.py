"""Every target of the Makefile is started as a user does; what takes long, with noted programs."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from planner.cli.app import COMMANDS

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")

ROOT = Path(__file__).parents[1]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
TARGETS = re.findall(r"^#   make ([\w-]+)", MAKEFILE, flags=re.M)
SCRIPTS = sorted(set(re.findall(r"/python (tests/\S+\.py)", MAKEFILE)))
PROGRAMS = ("python", "planner", "ruff", "mypy")
FILES = ("Makefile", "pyproject.toml", "setup.py", "planner", "tests", "problems", "notebooks")
STAMPS = (".run", ".dev", ".docs", ".notebook")
NOTE = """#!/bin/sh
[ "$1" = -c ] || echo "${0##*/} $*" >> noted
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """One that was prepared, so that nothing is installed."""
    for name in FILES:
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / ".venv").mkdir()
    for stamp in STAMPS:
        (tmp_path / ".venv" / stamp).touch()
    return tmp_path


def note_programs(checkout: Path) -> None:
    """In place of doing anything."""
    (checkout / ".venv/bin").mkdir()
    for name in PROGRAMS:
        program = checkout / ".venv/bin" / name
        program.write_text(NOTE)
        program.chmod(0o755)


def make(checkout: Path, target: str, **settings: str) -> subprocess.CompletedProcess[str]:
    # A `make test` that runs this test must not hand its flags on.
    kept = {key: os.environ[key] for key in os.environ.keys() - {"MAKEFLAGS", "MAKELEVEL"}}
    words = ["make", "--no-print-directory", target]
    return subprocess.run(
        words, cwd=checkout, env=kept | settings, capture_output=True, text=True, check=False
    )


def noted(checkout: Path) -> Iterator[list[str]]:
    for line in (checkout / "noted").read_text().splitlines():
        yield shlex.split(line)


@pytest.mark.parametrize("target", sorted({*TARGETS, "lint"} - {"clean"}))
def test_a_target_starts_what_there_is(target: str, checkout: Path) -> None:
    note_programs(checkout)
    ended = make(checkout, target)
    assert ended.returncode == 0, ended.stderr
    commands = [*noted(checkout)]
    assert commands
    for program, *words in commands:
        if program == "planner":
            assert words[0] in COMMANDS
        for word in words:
            if re.fullmatch(r"(tests|problems|notebooks)/[\w./-]+", word):
                assert (ROOT / word).exists(), word


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("target", "writes", "statuses"),
    [("compare", "out/compare/comparison.json", {0}), ("results-check", "", {0, 2})],
)
def test_a_target_does_its_work(
    target: str, writes: str, statuses: set[int], checkout: Path
) -> None:
    """The pages of results may be of older code, which is the status 2 of make."""
    for path in Path(sys.prefix).iterdir():
        if path.name not in STAMPS:
            (checkout / ".venv" / path.name).symlink_to(path)
    (checkout / "results").symlink_to(ROOT / "results")
    ended = make(checkout, target)
    assert ended.returncode in statuses, ended.stderr
    assert ended.stdout
    assert (checkout / writes).exists()


@pytest.mark.campaign
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_of_a_target_loads(script: str) -> None:
    code = "import runpy, sys; sys.path[0] = sys.argv[2]; runpy.run_path(sys.argv[1], run_name='_')"
    path = ROOT / script
    words = [sys.executable, "-c", code, str(path), str(path.parent)]
    ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_clean_removes_what_make_has_made_alone(checkout: Path) -> None:
    note_programs(checkout)
    made = [checkout / name for name in (".venv", "out", "build", "mine/__pycache__")]
    for folder in made:
        (folder / "x").mkdir(parents=True)
    before = {path.name for path in checkout.iterdir()}
    assert make(checkout, "clean").returncode == 0
    assert not [path for path in made if path.exists()]
    assert {path.name for path in checkout.iterdir()} == before - {".venv", "out", "build"}
