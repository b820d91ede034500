"""The front and the recommendation, on figures known beforehand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

import planner

Known = Callable[..., planner.DesignStudy]
Tasks = list[Mapping[str, Any] | None]

CALM, GOOD, EAGER, SLIPS, FAILS = (f"rho = {rho}" for rho in ("1", "1.01", "1.02", "1.03", "1.04"))


def results(effort: float | None, spread: float, load: float = 0.5, **more: float) -> Any:
    return {"effort": effort, "end_spread_deg": spread, "contact_load": load, **more}


DESIGNS: list[Tasks] = [
    [results(1.0, 1.0)] * 4,
    [results(0.2, 1.1)] * 4,
    [results(0.18, 1.5)] * 4,
    [results(0.05, 1.0, load=1.2)] * 4,
    [results(0.01, 0.9)] * 3 + [None],
]


def test_left_alone_it_ranks_by_what_a_builder_gets_and_pays(
    known: Known, quick: dict[str, Any]
) -> None:
    """Effort would take the second, whose motor gives twice the power for a worse end."""

    def task(effort: float, end: float, torque: float, power: float, load: float) -> Any:
        paid = {"motor_torque_nm": torque, "motor_power_w": power}
        return results(effort, 1.0, load, end_p95_deg=end, **paid)

    plain, geared = task(0.4, 2.5, 0.4, 0.10, 0.3), task(0.06, 2.8, 1.0, 0.20, 0.7)
    del quick["front"]
    study = known([[plain], [geared]])
    keys = ["end_deg", "motor_torque_nm", "motor_power_w", "contact_load"]
    assert [figure.key for figure in study.front_by] == keys
    assert study.recommended is study.rows[0]
    assert known([[plain], [geared]], front=["effort"]).recommended is not None
    by_effort = known([[plain], [geared]], front=["effort"])
    assert by_effort.recommended is by_effort.rows[1]


def test_a_task_counts_as_reached_by_the_compensated_plan(
    known: Known, quick: dict[str, Any]
) -> None:
    """The second has less of everything, but one of its plans cannot be compensated."""
    del quick["front"]
    paid = {"end_p95_deg": 2.5, "motor_torque_nm": 0.4, "motor_power_w": 0.1}
    some, less = results(1.0, 1.0, **paid), results(0.5, 0.5, 0.2, **dict.fromkeys(paid, 0.1))
    study = known([[some] * 4, [less, less, less, None]], compensated=True, tasks=TWO_TASKS)
    assert study.front_by[0].key == "compensated_end_deg"
    assert study.rows[1]["solved polynomial"] == 1.0
    assert study.recommended is study.rows[0]
    assert "solves 2 of 2 tasks by polynomial compensated" in study.reason
    assert "s of them for the compensated plans" in study.markdown()
    assert set(study.seconds) == {"polynomial", "polynomial compensated"}


TWO_TASKS = {"pairs": [{"start_deg": [10, 10], "goal_deg": goal} for goal in ([30, 30], [30, 29])]}


def test_the_front_is_what_no_other_beats(known: Known) -> None:
    draws = np.random.default_rng(1).random((40, 3))
    draws[1] = draws[0]
    draws[2, 0] = np.nan
    rows = [[results(None if np.isnan(e) else e, s, domain_margin=m)] for e, s, m in draws]
    study = known(rows, front=["effort", "spread_deg", "margin"])
    cost = draws * [1, 1, -1]
    for k, row in enumerate(study.rows):
        beaten = [(c <= cost[k]).all() and (c < cost[k]).any() for c in cost]
        assert row.on_front == (not any(beaten) and k != 2), "none is as good, and better in one"
    assert np.isnan(study.rows[2]["effort"])
    assert study.recommended in study.front


def test_the_one_to_take_solves_most_holds_and_loses_least(known: Known) -> None:
    study = known(DESIGNS)
    assert [row.design.name for row in study.front] == [CALM, GOOD, EAGER]
    assert study.recommended is study[GOOD]
    said = study.reason
    assert said.startswith(
        f"Take {GOOD}. It solves 4 of 4 tasks by polynomial, as 3 of 5 designs do whose contacts do"
        " not slip. Of these, this design is nearest to the best effort and spread (fewest percent"
        " worse, added up): effort 0.2 rad^2/s, spread 1.1 deg. Its contacts are loaded to 0.5 of"
    )
    assert f"{FAILS} has effort 0.01 rad^2/s, but it solves fewer tasks." in said
    alone = known(DESIGNS, front=["effort"])
    assert alone.recommended is alone[EAGER]
    assert "Of these, this design has the best effort: effort 0.18 rad^2/s" in alone.reason
    assert known(DESIGNS, front=["spread_deg"]).recommended.design.name == CALM  # type: ignore[union-attr]


def test_a_design_that_is_better_and_slips_is_told(known: Known) -> None:
    said = known(DESIGNS[:4]).reason
    assert f"{SLIPS} has effort 0.05 rad^2/s, but its contacts would slip (loaded to 1.2)." in said


def test_the_mechanism_as_it_is_is_told(known: Known) -> None:
    study = known([[results(1.0, 1.0)], [results(0.5, 1.0)]], present=True, grid={"rho": [1.2]})
    assert "The mechanism as it is: effort 1 rad^2/s, spread 1 deg." in study.reason


def test_where_all_slip_the_least_loss_is_taken_and_told(known: Known) -> None:
    study = known([[results(1.0, 1.0, load=2.0)] * 2, [results(2.0, 2.0, load=3.0)] * 2])
    assert study.recommended is study.rows[0]
    assert study.reason.startswith(f"Take {CALM}, with larger contact forces.")
    assert "all load their contacts beyond capacity" in study.reason


def test_where_the_best_of_a_figure_is_nothing_the_others_decide(known: Known) -> None:
    study = known([[results(2.0, 0.0)], [results(1.0, 0.0)], [results(0.5, 0.1)]])
    assert study.recommended is study.rows[1]


def test_where_few_tasks_are_solved_it_says_so(known: Known) -> None:
    study = known([[results(1.0, 1.0), None, None, None]])
    assert study.recommended is None
    assert study.reason.startswith(
        "No design has values of effort and spread, which need half of the tasks solved by"
        " polynomial: no plan of any kind exists"
    )


def test_an_unsolved_task_counts_as_worse_than_any(known: Known, quick: dict[str, Any]) -> None:
    names = ("effort", "duration_s", "domain_margin", "peak_u1_rad_s", "peak_u2_rad_s")
    names += ("contact_torque_nm", "contact_load", "E_median_deg", "end_p95_deg", "end_spread_deg")
    names += ("motor_torque_nm", "motor_power_w")
    one, three, five = ({n: k * (i + 1) for i, n in enumerate(names)} for k in (1.0, 3.0, 5.0))
    problem = {
        **quick["problem"],
        "system": {"kind": "manipulator", "joints": 3, "K": [0.8, 0.7], "k_g": 0.7},
        "start": {"theta_deg": [10, 10, 10]},
    }
    goals = ([30, 30, 30], [30, 20, 20], [30, 20, 5])  # joints that turn apart are not one-way
    pairs = [{"start_deg": [10, 10, 10], "goal_deg": goal} for goal in goals]
    problem["goal"] = {"theta_deg": goals[0], "duration": 0.01}
    tables = {"problem": problem, "tasks": {"pairs": pairs}}
    many = [one, five, three, five, None, None]  # each as it is, and compensated
    few = [one, None, None, None, None, None]
    study = known([many, few], compensated=True, **tables)
    more, less = study.rows
    part = pytest.approx(2 / 3)
    assert {k: v for k, v in more.figures.items() if k not in ("window", "least_link")} == {
        "effort": 3.0, "duration_s": 6.0, "one_way": part, "margin": 3.0,
        "peak_u1_rad_s": 12.0, "peak_u2_rad_s": 15.0, "contact_torque_nm": 18.0,
        "contact_load": 21.0, "motor_torque_nm": 33.0, "motor_power_w": 36.0,
        "E_deg": 24.0, "end_deg": 27.0, "spread_deg": 30.0,
        "compensated_end_deg": 45.0, "compensated_spread_deg": 50.0,
        "solved polynomial": part, "solved polynomial compensated": part,
    }  # fmt: skip
    assert np.isnan([less["effort"], less["margin"], less["compensated_end_deg"]]).all()
    assert less["peak_u1_rad_s"] == 4.0
    posed = (study.input.problem_of(less.design, task) for task in study.input.tasks[3])
    *windows, none = map(planner.travel_window, posed)
    assert none is not None
    assert none.empty
    widths = [(w.high - w.low) / ((w.high + w.low) / 2) for w in windows if w is not None]
    assert less["window"] == pytest.approx(min(widths))  # the middle one: that of none is 0
    endless = known([[one]])
    assert (endless.rows[0]["window"], endless.rows[0]["one_way"]) == (2.0, 1.0)
    assert "For 1 of the 3 tasks no one-way motion exists with this design" in study.reason
    assert "one-way" not in endless.reason
