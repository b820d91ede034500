"""The front and the recommendation on figures known beforehand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planner import Gear
from planner.problem.feasibility import TravelWindow
from planner.sweep.case import RESULTS
from planner.sweep.design.figures import (
    LOAD,
    DesignRow,
    Figure,
    TaskOutcome,
    able,
    best,
    judged_by,
    pareto,
    reason,
)
from planner.sweep.design.geometry import design

EFFORT, SPREAD = Figure("effort", "effort", "rad^2/s"), Figure("spread_deg", "spread", "deg")
GEAR = Gear(1.0, 1.0, 1.0, 1.0, 1.0)


def test_the_front_is_what_no_other_beats() -> None:
    values = np.array([[1.0, 5.0], [2.0, 3.0], [2.5, 3.0], [4.0, 1.0], [4.0, 1.0], [np.nan, 0.0]])
    assert pareto(values, [-1, -1]).tolist() == [True, True, False, True, True, False]
    assert pareto(values * [1, -1], [-1, 1]).tolist() == [True, True, False, True, True, False]
    assert pareto(values[:, :1], [1]).tolist() == [False, False, False, True, True, False]


def test_the_front_agrees_with_the_definition() -> None:
    values = np.random.default_rng(1).random((40, 3))
    for k, kept in enumerate(pareto(values, [-1, 1, -1])):
        cost = values * [1, -1, 1]
        beaten = [
            (cost[j] <= cost[k]).all() and (cost[j] < cost[k]).any() for j in range(40) if j != k
        ]
        assert kept == (not any(beaten))


def row(name: str, effort: float, spread: float, load: float = 0.5, solved: float = 1.0) -> Any:
    figures = {"effort": effort, "spread_deg": spread, LOAD: load, "solved a": solved}
    made = design(name, {"rho": 1.0}, GEAR, np.full(3, 1.4))
    return DesignRow(made, {**figures, "one_way": 1.0})


ROWS = [
    row("calm", 1.0, 1.0),
    row("good", 0.2, 1.1),
    row("eager", 0.18, 1.5),
    row("slips", 0.05, 1.0, load=1.2),
    row("fails", 0.01, 0.9, solved=0.5),
    DesignRow(design("none", {}, GEAR, np.full(3, 1.4), [1.0] * 3), {}),
]


def test_the_one_to_take_solves_most_holds_and_loses_least() -> None:
    kept = able(ROWS, [EFFORT, SPREAD], "solved a")
    assert [ROWS[k].design.name for k in kept] == ["calm", "good", "eager"]
    assert best(ROWS, kept, [EFFORT, SPREAD]) == 1
    assert best(ROWS, kept, [EFFORT]) == 2
    assert best(ROWS, kept, [SPREAD]) == 0
    said = reason(ROWS, 1, kept, [EFFORT, SPREAD], ["a"], 4)
    assert said.startswith("Take good. It solves 4 of 4 tasks by a, as 3 of 5 designs do whose")
    assert "effort 0.2 rad^2/s, spread 1.1 deg" in said
    assert "fails has effort 0.01 rad^2/s, but it solves fewer tasks." in said


def test_where_all_slip_the_least_loss_is_taken_and_told() -> None:
    rows = [row("x", 1.0, 1.0, load=2.0), row("y", 2.0, 2.0, load=3.0)]
    kept = able(rows, [EFFORT, SPREAD], "solved a")
    assert kept == [0, 1]
    said = reason(rows, 0, kept, [EFFORT, SPREAD], ["a"], 4)
    assert said.startswith("Take x, with larger contact forces.")
    assert "all load their contacts beyond capacity" in said


def test_where_none_solves_a_task_it_says_so() -> None:
    rows = [row("x", np.nan, np.nan, solved=0.0)]
    assert able(rows, [EFFORT], "solved a") == []
    assert reason(rows, None, [], [EFFORT], ["a"], 4) == "No design solves a task by a."
    few = [row("x", np.nan, np.nan, solved=0.25)]
    assert able(few, [EFFORT], "solved a") == []
    said = reason(few, None, [], [EFFORT], ["a"], 4)
    assert said == "No design solves half of the tasks by a or has effort otherwise."


def outcome(solved: bool, effort: float, window: TravelWindow) -> TaskOutcome:
    columns = dict.fromkeys(RESULTS, 1.0) | {"effort": effort, "peak_u1_rad_s": effort, "why": ""}
    return TaskOutcome(window, {"a": {**columns, "solved": solved}})


def test_an_unsolved_task_counts_as_worse_than_any() -> None:
    there, none = TravelWindow(0.9, 1.1, True), TravelWindow(np.nan, np.nan, True, "no")
    tasks = [outcome(True, 1.0, there), outcome(True, 3.0, there), outcome(False, 0.1, none)]
    values = {figure.key: value(tasks) for figure, value in judged_by(["a"], None)}
    assert values["effort"] == 3.0
    assert values["peak_u1_rad_s"] == 3.0
    assert values["solved a"] == pytest.approx(2 / 3)
    assert values["one_way"] == pytest.approx(2 / 3)
    assert values["window"] == pytest.approx(0.2)
    endless = [outcome(True, 1.0, TravelWindow(0.9, np.inf, True))]
    values = {figure.key: value(endless) for figure, value in judged_by(["a"], None)}
    assert values["window"] == 2.0
    worse = [tasks[0], tasks[2], tasks[2]]
    values = {figure.key: value(worse) for figure, value in judged_by(["a"], None)}
    assert np.isnan(values["effort"])
    assert values["peak_u1_rad_s"] == 1.0
