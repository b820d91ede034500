"""Systems of users' own classes, with as few members as the base class asks for."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import pytest

import planner
from planner import Trailers
from planner.problem.tables import kinds
from planner.problem.tables.custom import OwnFile
from planner.support.user_tables import Table
from planner.systems.triangular_system import Coordinate, TangentSystem


class Skate(TangentSystem):
    """The smallest possible class: a unicycle."""

    kind = "skate"
    coordinates = Coordinate("x", "m"), Coordinate("heading", "rad"), Coordinate("y", "m")

    def slopes_expr(self, q: Any) -> list[Any]:
        return [ca.tan(q[1])]

    def drive_expr(self, q: Any) -> Any:
        return ca.cos(q[1])


class SkateTable(Table):
    """A skate."""

    kind: Literal["skate"]


class SkateFile(OwnFile):
    """Problem files for skates."""

    summary: ClassVar[str] = "skate"
    example: ClassVar[str] = """
title = "my skate"
[system]
kind = "skate"
[start]
q = { x = 0.0, heading = 0.0, y = 0.0 }
[goal]
q = { heading = 0.0, y = 1.0 }
travel = 2.0
duration = 5.0
[limits]
input = [1.0, 1.0]
"""

    system: SkateTable

    def build_system(self) -> Skate:
        return Skate()


class TwoTrailers(TangentSystem):
    """A car with two trailers by its expressions alone."""

    kind = "two-trailers"

    def __init__(self, lengths_m: tuple[float, float, float]) -> None:
        self.lengths_m = lengths_m

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        angles = (Coordinate(name, "rad") for name in ("steering", "hitch1", "hitch2", "heading"))
        return Coordinate("x", "m"), *angles, Coordinate("y", "m")

    def slopes_expr(self, q: Any) -> list[Any]:
        factors = [ca.cos(q[4]), ca.cos(q[4]) * ca.cos(q[3])]
        factors.append(factors[1] * ca.cos(q[2]))
        turns = [
            ca.tan(q[k + 1]) / (length * factors[2 - k]) for k, length in enumerate(self.lengths_m)
        ]
        return [turns[0] - turns[1], turns[1] - turns[2], turns[2], ca.tan(q[4])]

    def drive_expr(self, q: Any) -> Any:
        return ca.cos(q[4]) * ca.cos(q[3]) * ca.cos(q[2])


@pytest.fixture
def skate(monkeypatch: pytest.MonkeyPatch) -> planner.Problem:
    monkeypatch.setattr(kinds, "FILES", dict(kinds.FILES))
    planner.register_system("skate", SkateFile)
    goal = {"q": {"heading": 0.0, "y": 1.0}, "travel": 2.0, "duration": 5.0}
    return planner.Problem.from_dict(
        {
            "system": {"kind": "skate"},
            "start": {"q": {"x": 0.0, "heading": 0.0, "y": 0.0}},
            "goal": goal,
            "limits": {"input": [1.0, 1.0]},
        }
    )


@pytest.mark.parametrize("method", ["polynomial", "collocation"])
def test_a_class_of_four_members_is_planned_for_and_replayed(
    method: str, skate: planner.Problem
) -> None:
    plan = planner.solve(skate, method)
    assert plan.verified
    assert plan.certificate is not None
    assert plan.certificate.ok
    assert np.max(np.abs(planner.replay(plan, planner.Machine.ideal()).terminal_error)) < 1e-5
    assert skate.system.to_dict() == {"kind": "skate"}
    assert [i.unit for i in skate.system.inputs] == ["m/s", "rad/s"]


def test_a_name_that_is_none_is_refused(skate: planner.Problem) -> None:
    with pytest.raises(planner.InputError, match=r"start\.q .*'z'"):
        skate.changed({"start.q.z": 1.0})


def test_what_is_left_out_agrees_with_a_system_that_gives_all_of_it() -> None:
    ours, theirs = TwoTrailers((2.0, 1.5, 1.2)), Trailers([1.5, 1.2], 2.0)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.2, 1.2, (50, 6))
    u = rng.uniform(-1.0, 1.0, (50, 2))
    np.testing.assert_allclose(ours.rates(q, u), theirs.rates(q, u), rtol=1e-9, atol=1e-9)
    form = planner.chained_form(ours)
    np.testing.assert_allclose(form.z(q), planner.chained_form(theirs).z(q), rtol=1e-8)
    for i in range(1, 5):
        for given, own in zip(theirs._link(i, q), ours._link(i, q), strict=True):
            np.testing.assert_allclose(own, given, rtol=1e-9, atol=1e-12)
    back = np.array([form.q(form.z(p), ours.branch(p)) for p in q])
    np.testing.assert_allclose(back, q, atol=1e-6)
    assert ours.to_dict() == {"kind": "two-trailers", "lengths_m": [2.0, 1.5, 1.2]}
    assert ours == TwoTrailers((2.0, 1.5, 1.2)) != TwoTrailers((2.0, 1.5, 1.3))
