"""Interval functions as machine code: same answers, compiled once, clear refusals."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner.errors import InputError
from planner.methods.collocation.method import plan_collocation
from planner.methods.collocation.transcription import derivatives as compiled
from planner.methods.collocation.transcription.transcription import transcription
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiled, "FLAGS", ("-O0", "-fPIC", "-shared"))  # compiles faster
    transcription.cache_clear()
    return tmp_path / "planner"


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The compiler's runs, noted as they happen."""
    noted: list[str] = []
    inner = compiled._compile

    def noting(compiler: str, source: str) -> bytes:
        noted.append(source)
        return inner(compiler, source)

    monkeypatch.setattr(compiled, "_compile", noting)
    return noted


@needs_compiler
def test_same_plan_and_one_library_for_every_mesh(
    paper: Problem, folder: Path, runs: list[str]
) -> None:
    plain = planner.solve(paper, "collocation", degree=2)
    fast = planner.solve(paper, "collocation", degree=2, compile=True)
    np.testing.assert_allclose(fast.q(fast.t), plain.q(plain.t), atol=1e-9)
    assert fast.objective == pytest.approx(plain.objective, rel=1e-10)
    (library,) = folder.iterdir()
    made = library.stat().st_mtime_ns
    transcription.cache_clear()  # as in another process
    for options in ({}, {"intervals": 9}, {"solver": "ipopt"}):
        again = planner.solve(paper, "collocation", degree=2, compile=True, **options)
        assert again.objective == pytest.approx(plain.objective, rel=1e-3)
    assert len(runs) == 1
    assert [file.stat().st_mtime_ns for file in folder.iterdir()] == [made]


@needs_compiler
def test_another_degree_is_another_library(paper: Problem, folder: Path, runs: list[str]) -> None:
    for degree in (1, 2):
        options = CollocationOptions(degree=degree, compile=True, refinements=0)
        plan_collocation(paper, options)
    assert len(runs) == 2
    assert len(list(folder.iterdir())) == 2


def test_no_compiler(paper: Problem, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(folder))
    with pytest.raises(InputError, match="needs a C compiler: none of cc, gcc, clang"):
        planner.solve(paper, "collocation", degree=2, compile=True)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(InputError, match="CC names 'no-such-compiler'"):
        planner.solve(paper, "collocation", degree=2, compile=True)


@needs_compiler
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("FLAGS", ("-no-such-flag",)), "refuses the generated code"),
        (("cache_folder", lambda: Path("/dev/null/planner")), "cannot make the cache folder"),
    ],
)
def test_refusals(
    paper: Problem, folder: Path, monkeypatch: pytest.MonkeyPatch, change: Any, said: str
) -> None:
    monkeypatch.setattr(compiled, *change)
    with pytest.raises(InputError, match=said):
        planner.solve(paper, "collocation", degree=2, compile=True)
    assert not folder.exists() or not list(folder.iterdir())  # nothing half-written
