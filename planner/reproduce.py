"""Names that have moved to `planner.paper`, kept here for one release."""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

_NEW_HOMES = {
    "paper_problem": "planner.paper.cases",
    "Finding": "planner.paper.numbers",
    "Reproduction": "planner.paper.reproduce",
    "reproduce": "planner.paper.reproduce",
}


def __getattr__(name: str) -> Any:
    if name not in _NEW_HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn(
        f"{__name__}.{name} is {_NEW_HOMES[name]}.{name} now", DeprecationWarning, stacklevel=2
    )
    return getattr(import_module(_NEW_HOMES[name]), name)
