"""What README and the documentation tell a user to start, started as he does, page by page.

A page is walked from its top, with a shell and the files of a checkout: its Python, its blocks of
commands, and in its text the commands that name a file. What takes long runs with
`pytest -m campaign`, with few machines where no number is told.
"""

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

import planner

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent

STEP = re.compile(
    r"^```(?P<kind>\w*)\n(?P<code>.*?)^```$"
    r"|(?:(?<=\n\n)|(?<=-->\n))(?P<lines>(?:    [^\n]*\n)+)"
    r"|(?<!`)`(?P<inline>planner [^`\n]+)`",
    flags=re.DOTALL | re.MULTILINE,
)
PROGRAMS = ("planner ", "cd ", "cc ")

WALKS = {
    "readme": ["README.md"],
    "commands": [
        "docs/howto/bench.md",
        "docs/howto/before-the-motor-turns.md",
        "docs/reference/commands.md",
    ],
    **{
        name: [f"docs/{name}.md" if name in ("start", "theory") else f"docs/howto/{name}.md"]
        for name in ("start", "compare", "design", "files", "sweep", "systems", "theory", "tune")
    },
}
"""Pages that are walked with the same files. The notebooks' tests cover docs/howto/explore."""

LONG = re.compile(
    r"planner (compare|budget|sensitivity|animate|identify|log|report|check|calibrate|reproduce)"
    r"|planner (sweep|design)(?!.* --dry-run)|planner plan .*my-machine"
)
REFUSED = {
    "planner plan problems/paper.toml --method polynomial --set goal.travel=0.82",
    "planner check problems/unreachable.toml --json",
}
"""Commands that are told because they end with status 3."""
ELSEWHERE = re.compile(r"tcp://host")
"""Needs another computer."""
FEW = {"compare": "50", "budget": "50", "reproduce": "50"}
SMALLER = {
    "problems/designs/gear-ratios.toml": {
        "[0.6, 0.8, 1.0, 1.25, 1.6]": "[0.8, 1.0]",
        "kappa = [0.5, 0.7, 1.0, 1.5]": "kappa = [1.0]",
        "count = 8": "count = 2",
        "samples = 100": "samples = 20",
    },
    "problems/designs/contact-force.toml": {
        "[5, 10, 15, 20, 30, 45, 70, 100]": "[15, 30]",
        "count = 4": "count = 1",
        "samples = 100": "samples = 20",
    },
}
WRITES = re.compile(r"(?:--out|-o|--export|--figure|>) (\S+)")


def blocks(page: str) -> Iterator[list[str]]:
    """Commands that share a shell; Python is a block of its own and begins with a line break."""
    for found in STEP.finditer((ROOT / page).read_text("utf-8")):
        if found["kind"] == "python":
            yield ["\n" + found["code"]]
        lines = found["lines"] or found["inline"] or ""
        if found["kind"] == "text":  # the help of a command
            lines = found["code"].rpartition("Examples:")[2]
        told = (line.split(" #")[0].split() for line in lines.replace("\\\n", " ").splitlines())
        commands = [" ".join(words) for words in told]
        if found["inline"] and not re.search(r" \S*\w[./]\w", commands[0]):
            continue  # the name of a command or option
        yield [each for each in commands if each.startswith(PROGRAMS)]


def checkout(folder: Path) -> None:
    """What a walk needs of one, with smaller design studies."""
    shutil.copytree(ROOT / "problems", folder / "problems")
    for name, changes in SMALLER.items():
        text = (folder / name).read_text("utf-8")
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        (folder / name).write_text(text, encoding="utf-8")


def walked(pages: list[str], folder: Path, long: bool) -> Iterator[str]:
    """Start what the pages tell, once each; yields what failed.

    Of the short ones those are left out, too, that read what a long one writes.
    """
    checkout(folder)
    done: set[str] = set()
    lacking: set[str] = set()
    for page in pages:
        names: dict[str, object] = {"planner": planner}
        for block in blocks(page):
            place = folder
            for told in block:
                writes = set(WRITES.findall(told))
                reads = {*told.split()} - writes
                if told.startswith("cd "):
                    place /= told.removeprefix("cd ")
                elif told.startswith("\n"):
                    if long:
                        exec(compile(told, page, "exec"), names)
                elif not long and (
                    LONG.search(told) or any(r.startswith(w) for r in reads for w in lacking)
                ):
                    lacking |= writes
                elif told not in done and not ELSEWHERE.search(told):
                    done.add(told)
                    lacking -= writes
                    yield from started(told, place)


def started(told: str, place: Path) -> Iterator[str]:
    """Start one command; yields what is wrong with it."""
    program, name, *words = shlex.split(told)
    few = program == "planner" and name in FEW and not {"-n", "--samples"} & {*words}
    path = f"{BIN}{os.pathsep}{os.environ['PATH']}"
    end = subprocess.run(
        ["bash", "-c", told + (f" --samples {FEW[name]}" if few else "")],
        cwd=place,
        env={**os.environ, "PATH": path, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
    )
    if end.returncode != (3 if told in REFUSED else 0):
        yield f"{told}\nended with {end.returncode}: {end.stderr[-1500:]}"
    for written in WRITES.findall(told):
        if not (place / written).exists():
            yield f"{told}\ndid not write {written}"


@pytest.mark.parametrize("walk", WALKS)
def test_what_a_page_tells_to_start_runs(
    walk: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert [*walked(WALKS[walk], tmp_path, long=False)] == []


@pytest.mark.campaign
@pytest.mark.parametrize("walk", WALKS)
def test_what_a_page_tells_to_start_runs_however_long(
    walk: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert [*walked(WALKS[walk], tmp_path, long=True)] == []


def test_every_page_with_commands_is_walked() -> None:
    pages = {str(p.relative_to(ROOT)) for p in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]}
    telling = {page for page in pages if any(any(block) for block in blocks(page))}
    walks = {page for walk in WALKS.values() for page in walk}
    python = {"docs/gallery.md", "docs/howto/explore.md", "docs/troubleshooting.md"}
    assert telling == walks | python  # other tests draw the gallery, open notebooks, quote refusals
