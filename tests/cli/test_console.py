"""Consoles that lack characters, and surroundings that lack something: told in a line, no bug."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from planner.cli import app
from planner.cli.output import fit_console, print_text, say

PROBLEMS = Path(__file__).parents[2] / "problems"
OURS = "n° 1: ∫u₁² dt ≤ 3.5·10⁻², θ₃ ± 0.2 → größe α.toml"


def open_console(monkeypatch: pytest.MonkeyPatch, encoding: str) -> list[io.BytesIO]:
    both = [io.BytesIO(), io.BytesIO()]
    for name, stream in zip(("stdout", "stderr"), both, strict=True):
        monkeypatch.setattr(sys, name, io.TextIOWrapper(stream, encoding, write_through=True))
    return both


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("ascii", "n? 1: ?u12 dt <= 3.5*10-2, ?3 +- 0.2 -> gro?e ?.toml"),
        ("cp1252", "n° 1: ?u1² dt <= 3.5·10-², ?3 ± 0.2 -> größe ?.toml"),
        ("cp437", "n° 1: ?u1² dt ≤ 3.5·10-², ?3 ± 0.2 -> größe α.toml"),
        ("utf-8", OURS),
    ],
)
def test_what_a_console_lacks_is_replaced(
    monkeypatch: pytest.MonkeyPatch, encoding: str, shown: str
) -> None:
    both = open_console(monkeypatch, encoding)
    with fit_console():
        print_text(OURS)
        say(OURS)
    for stream in both:
        assert stream.getvalue().decode(encoding).strip() == shown
    assert sys.stdout.errors == "strict"


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "shift_jis"])
def test_a_command_tells_its_result_on_any_console(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, encoding: str
) -> None:
    file = tmp_path / "größe α.toml"
    file.write_bytes((PROBLEMS / "car.toml").read_bytes())
    out, err = open_console(monkeypatch, encoding)
    words = ["compare", str(file), "--methods", "polynomial", "--samples", "1", "-v"]
    assert app.main(words) == 0
    assert b"rad" in out.getvalue()
    assert b"polynomial" in err.getvalue()
    assert app.main(["plan", str(tmp_path / "α.toml")]) == 2


def test_an_unknown_backend_of_matplotlib_is_not_asked_for() -> None:
    code = "from planner.cli.app import main; main(['methods'], last=True); import matplotlib"
    settings = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=settings, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_what_is_not_installed_is_named(
    run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def lacks() -> int:
        raise ModuleNotFoundError("No module named 'ipywidgets'", name="ipywidgets")

    monkeypatch.setattr(app, "load_command", lambda name: lacks)
    result = run("methods")
    assert (result.status, result.out) == (2, "")
    assert result.err == "planner: this needs ipywidgets, which is not installed\n"
