"""The plan that the prototype is calibrated on; the compiled code as its source is now."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from handmade import arm_problem, smooth_plan_of

from planner import Plan, Problem
from planner.machine import compiled

SOURCES = [str(Path(compiled.__file__).with_name(n)) for n in compiled.SOURCES if n.endswith(".c")]


@pytest.fixture(scope="session")
def arm() -> Problem:
    """The paper's boundary values."""
    return arm_problem([1, 1, 1], goal=[30, 30, 30])


@pytest.fixture(scope="session")
def smooth_plan(arm: Problem) -> Plan:
    """A smooth polynomial plan from (1, 1, 1) to (30, 30, 30) degrees in 10 s, |u| < 0.25 rad/s."""
    return smooth_plan_of(arm)


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The compiled code as its source is now, whatever was installed."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    target = tmp_path_factory.mktemp("kernel") / "kernel.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    flags.append(f"-DSOURCE={compiled.source_checksum(0)}")
    words = [compiler, *flags, "-ffp-contract=off", *SOURCES, "-o", str(target), "-lm"]
    subprocess.run(words, check=True)
    found = compiled.open_library(target)
    assert found is not None
    return found


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """`use(library)`: replays, and steps of `driven.chain`, by it; None is NumPy."""

    def patch(found: Any) -> None:
        monkeypatch.setattr("planner.machine.simulate.library", lambda: found)
        monkeypatch.setattr(compiled, "library", lambda: found)

    return patch
