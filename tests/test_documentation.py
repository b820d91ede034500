"""The documentation: nothing public is left out, and every quoted message is really printed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

import planner
from planner.cli.app import COMMANDS, main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def blocks(name: str, language: str) -> list[str]:
    text = (DOCS / name).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.S | re.M)


def squeezed(text: str) -> str:
    return " ".join(text.split())


def test_every_public_name_is_in_the_reference() -> None:
    text = (DOCS / "reference" / "index.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"^\.\. (?:auto(?!module)\w+|py:data):: (\w+)", text, flags=re.M))
    assert shown == set(planner.__all__)


def test_no_folder_keeps_make_from_its_work() -> None:
    text = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    targets = {
        name
        for line in re.findall(r"^([a-z][a-z ]*):(?!=)", text, flags=re.M)
        for name in line.split()
    }
    told = set(re.findall(r"^#   make (\w+)", text, flags=re.M))
    assert told <= targets
    assert targets == set(" ".join(re.findall(r"^\.PHONY:(.*)$", text, flags=re.M)).split())


REFUSALS = blocks("troubleshooting.md", "console")


@pytest.mark.parametrize("block", REFUSALS, ids=[b.splitlines()[0][10:60] for b in REFUSALS])
def test_a_quoted_message_is_what_the_command_prints(
    block: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    command, *said = block.splitlines()
    assert command.startswith("$ planner ")
    status = main(shlex.split(command)[2:])
    printed = squeezed(capsys.readouterr().err)
    pattern = ".*".join(re.escape(part.strip()) for part in squeezed("\n".join(said)).split("..."))
    assert re.fullmatch(pattern, printed), printed
    assert status == (3 if "no plan (" in block else 2)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_examples_of_a_command_stand_on_lines_of_their_own(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main([name, "--help"])
    said = capsys.readouterr().out
    assert "\\b" not in said
    examples = re.findall(r"^ +Examples?:$", said, flags=re.M)
    assert len(examples) == said.count("Example")
