"""Problems that many tests start from."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from registered import registries

import planner

ROOT = Path(__file__).parents[1]

settings.register_profile("planner", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("planner")


@pytest.fixture(autouse=True)
def _own_ctrl_c() -> None:
    """Each test starts with Python's own SIGINT.

    A suite in the background of a script begins with Ctrl-C ignored, in all its processes, and
    whatever waits for one would hang.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a test may have ended as a process does


@pytest.fixture(scope="module", autouse=True)
def _nothing_stays_registered() -> Iterator[None]:
    """What a test registers and leaves would change answers of tests that run after it."""
    before = registries()
    yield
    assert registries() == before, "registered, and not taken back: use registered.restored()"


@pytest.fixture(scope="session")
def paper() -> planner.Problem:
    """The paper's example as shipped."""
    return planner.load_problem(ROOT / "problems/paper.toml")


@pytest.fixture(scope="session")
def unlimited(paper: planner.Problem) -> planner.Problem:
    """The paper's example without any limit."""
    return paper.changed({"limits": {}})
