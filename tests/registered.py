"""What plugins register, and a limit that is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np
import pytest

from planner import METHODS, TriangularSystem
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.tables import kinds as plugins
from planner.problem.tables.kinds import FILES, REQUIREMENTS
from planner.problem.tables.method_options import MethodsTable


def _tables() -> tuple[Any, ...]:
    limits = {file.model_fields["limits"].annotation for file in FILES.values()}
    return (MethodsTable, *limits)


def _dicts() -> list[dict[str, Any]]:
    return [FILES, METHODS, REQUIREMENTS, *(table.model_fields for table in _tables())]  # type: ignore[list-item]


def registries() -> list[list[str]]:
    """What is registered, and what each table then knows, in order."""
    return sorted(list(registry) for registry in _dicts())


@contextmanager
def restored() -> Iterator[pytest.MonkeyPatch]:
    """Registries and plugins as they were, afterwards."""
    tables = _tables()
    kept = [(registry, dict(registry)) for registry in _dicts()]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plugins, "_plugins", plugins._Plugins())
        try:
            yield patch
        finally:
            # Their order too, which answers list; items that are put back come last.
            changed = [(now, before) for now, before in kept if [*now.items()] != [*before.items()]]
            for table, before in changed:
                table.clear()
                table.update(before)
            for model in (*tables, *FILES.values()) if changed else ():
                model.model_rebuild(force=True)  # type: ignore[union-attr]


@dataclass(frozen=True)
class Bump(Requirement):
    """exp(−((q₂ − at)/width)²) ≤ 1/2: a small region that the first angle avoids."""

    at: float
    width: float

    key, reads = "bump", frozenset({"q"})
    row_fields = ("at", "width")
    table = list[float], "Where it is and how wide.", [0.5, 0.1]

    @classmethod
    def of(cls, value: Any, system: TriangularSystem) -> Self:
        return cls(*map(float, value))

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("bump", "", -np.inf, 0.5, 0.5),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [ca.exp(-(((point.q[1] - self.at) / self.width) ** 2))]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        return [np.exp(-(((point.q[1] - self.at) / self.width) ** 2))]
