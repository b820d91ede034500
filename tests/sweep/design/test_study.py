"""A small study from end to end, and what is refused before anything is planned."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import main

import planner
from planner.report import plot_design

Tables = dict[str, Any]
TASKS = [
    {"start_deg": [10, 10], "goal_deg": [30, 30]},
    {"start_deg": [30, 30], "goal_deg": [10, 20]},
]
SYSTEM = {"kind": "manipulator", "joints": 2, "K": [0.8], "k_g": 0.7}
PROBLEM = {
    "system": SYSTEM,
    "start": {"theta_deg": [10, 10]},
    "goal": {"theta_deg": [30, 30], "duration": 3.0},
    "limits": {"input_rad_s": 0.8, "joint_deg": 80},
    "machine": {"step_s": 0.01, "control_period_s": 0.05},
}
STUDY: Tables = {
    "title": "two and two",
    "problem": PROBLEM,
    "methods": ["collocation"],
    "compensated": False,
    "present": False,
    "grid": {"kappa": [0.7, 1.5]},
    "tasks": {"pairs": TASKS},
    "replay": {"samples": 4},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def study(folder: Path) -> planner.DesignStudy:
    return planner.design_study(STUDY, folder, workers=0)


def test_its_figures_are_those_of_the_plans(study: planner.DesignStudy) -> None:
    slow, fast = study.rows
    plans = []
    for task in TASKS:
        problem = planner.Problem.manipulator(
            task["start_deg"],
            task["goal_deg"],
            duration=3.0,
            K=[1.5],
            k_g=1.0,
            input_rad_s=0.8,
            joint_deg=80,
            changes={f"machine.{k}": v for k, v in PROBLEM["machine"].items()},  # type: ignore[attr-defined]
        )
        plans.append(planner.solve(problem, "collocation"))
    assert fast["effort"] == pytest.approx(np.median([p.objective for p in plans]), rel=1e-4)
    runs = [planner.replay(plan, samples=4) for plan in plans]
    spreads = [np.max(run.terminal_error_deg.std(axis=0)) for run in runs]
    assert fast["spread_deg"] == pytest.approx(np.median(spreads), rel=1e-3)
    assert fast["contact_load"] > slow["contact_load"]
    assert slow["effort"] > fast["effort"]
    assert fast["solved collocation"] == 1.0
    assert fast["least_link"] == pytest.approx(1.0)  # R; r3 = 1/1.5 is less


def test_it_recommends_with_a_reason_and_prints_a_line(study: planner.DesignStudy) -> None:
    assert study.recommended is study["kappa = 1.5"]
    assert study.recommended in study.front
    assert study.reason.startswith("Take kappa = 1.5. It solves 2 of 2 tasks by collocation")
    assert repr(study) == "DesignStudy('two and two', 2 designs, 2 tasks: take kappa = 1.5)"
    with pytest.raises(planner.InputError, match=r"kappa = 0\.7; kappa = 1\.5"):
        study["kappa = 2"]
    with pytest.raises(planner.InputError, match="'effort'"):
        study.rows[0]["efort"]
    assert "<table>" in study._repr_html_()


def test_it_is_a_frame_and_a_folder(study: planner.DesignStudy, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    frame = study.to_frame()
    assert frame.index.tolist() == ["kappa = 0.7", "kappa = 1.5"]
    assert frame.loc["kappa = 1.5", "effort"] == study.rows[1]["effort"]
    place = study.save(tmp_path / "new" / "folder")
    assert {p.name for p in place.iterdir()} == {
        "design.csv", "design.json", "design.md", "design.png",
    }  # fmt: skip
    data = json.loads((place / "design.json").read_text(encoding="utf-8"))
    assert data["recommended"] == "kappa = 1.5"
    assert data["designs"][0]["figures"]["effort"] == study.rows[0]["effort"]
    head, *lines = (place / "design.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 2
    assert {"effort", "contact_load", "r3", "front"} <= set(head.split(","))
    assert "| kappa = 1.5 | take |" in (place / "design.md").read_text(encoding="utf-8")
    (tmp_path / "file").touch()
    with pytest.raises(planner.InputError, match="is a file; name a folder"):
        study.save(tmp_path / "file")


def test_the_same_call_goes_on_where_it_was_ended(study: planner.DesignStudy, folder: Path) -> None:
    def finished(*statements: str) -> list[Any]:
        connection = sqlite3.connect(folder / "cases.sqlite")
        with connection:
            for statement in statements:
                connection.execute(statement)
            rows = connection.execute("SELECT key, finished_at FROM cases ORDER BY rowid")
            found = rows.fetchall()
        connection.close()
        return found

    # As if it had been ended before its last case.
    kept = finished("DELETE FROM cases WHERE rowid = (SELECT max(rowid) FROM cases)")
    again = planner.design_study(STUDY, folder, workers=0)
    assert len(kept) == 3
    assert finished()[:3] == kept
    assert len(finished()) == 4
    assert again.reason == study.reason
    assert again.rows[1].figures == pytest.approx(study.rows[1].figures, nan_ok=True)


def test_the_picture_has_bars_or_a_map(study: planner.DesignStudy) -> None:
    figure, axes = plot_design(study)
    assert len(study.plot().axes) == len(figure.axes)
    assert axes.shape == (2, 3)
    words = {text.get_text() for ax in axes.flat for text in ax.get_yticklabels()}
    assert {"kappa = 0.7", "kappa = 1.5"} <= words
    given = figure.axes
    assert plot_design(study, axes=given)[0] is figure
    with pytest.raises(planner.InputError, match=r"\b6 axes"):
        plot_design(study, axes=given[:2])
    with pytest.raises(planner.InputError, match="DesignStudy"):
        plot_design(study.rows[0])  # type: ignore[arg-type]


def test_a_front_is_joined_where_it_is_a_curve(study: planner.DesignStudy, folder: Path) -> None:
    """Of four figures of merit it is none in two of them."""
    two = planner.design_study({**STUDY, "front": ["effort", "spread_deg"]}, folder, workers=0)
    for each, style in ((study, "None"), (two, "-")):
        _, axes = plot_design(each)
        (front,) = axes[0, 0].lines
        assert front.get_linestyle() == style
        assert len(front.get_xdata()) == len(each.front)


def test_rows_of_different_variables_are_bars_and_a_grid_is_a_map(
    folder: Path, study: planner.DesignStudy
) -> None:
    several = [{"kappa": 1.5}, {"rho": 1.2, "kappa": 0.7}]
    tables = {**STUDY, "grid": {}, "cases": several}
    _, axes = plot_design(planner.design_study(tables, folder, workers=0))
    assert axes[0, 1].get_xlabel() == ""
    grid = {"rho": [1.0, 1.2], "kappa": [0.7, 1.5]}
    _, axes = plot_design(planner.design_study({**STUDY, "grid": grid}, folder, workers=0))
    assert (axes[0, 1].get_xlabel(), axes[0, 1].get_ylabel()) == ("rho", "kappa")
    assert [t.get_text() for t in axes[0, 1].get_xticklabels()] == ["1", "1.2"]


def test_what_cannot_be_built_is_named_and_not_planned(
    folder: Path, study: planner.DesignStudy
) -> None:
    # Links of 1.2 are too short for the ring of kappa = 0.7, whose radius is 1.43.
    short = {"link_lengths": [1.2, 1.0]}
    cases = [{"kappa": 0.7, **short}, {"kappa": 1.5, **short}]
    tables = {**STUDY, "grid": {}, "cases": cases, "tasks": {"pairs": TASKS[:1]}}
    found = planner.design_study(tables, folder, workers=0)
    refused, built = found.rows
    assert "l1 > r3 = 1.429 does not hold: l1 = 1.2" in refused.design.refused
    assert refused.figures == {}
    assert found.recommended is built
    assert "Cannot be built:" in found.markdown()
    found.plot()
    with pytest.raises(planner.InputError, match=r"l1 = 1\.2"):
        planner.design_study({**tables, "cases": cases[:1]}, workers=0)


def test_where_no_task_can_be_solved_it_says_so(quick: Tables) -> None:
    found = planner.design_study({**quick, "grid": {"kappa": [0.7, 1.5]}}, workers=0)
    assert found.recommended is None
    assert found.front == ()
    assert found.reason.startswith("No design solves a task by polynomial: no plan of any kind")
    assert "no design solves a task" in repr(found)
    found.plot()


def changed(**tables: Any) -> Tables:
    return {**STUDY, **tables}


UNEVEN = {
    "system": {"kind": "manipulator", "joints": 4, "K": [0.8, 0.5, 0.7], "k_g": 0.7},
    "start": {"theta_deg": [10] * 4},
    "goal": {"theta_deg": [30] * 4, "duration": 3.0},
}
TIP = {
    "system": {**SYSTEM, "link_lengths": [1.0, 1.0]},
    "goal": {"tip_m": [1.2, 1.2], "duration": 3.0},
}
BOX = {"start_deg": [5, 15], "goal_deg": [20, 45]}


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        (changed(grid={"kapa": [1.0]}), "unknown key 'kapa' .*; did you mean 'kappa'"),
        (changed(grid={}), "the file names no design; give"),
        (changed(grid={"r1": [1.0, -2.0]}), r"design r1 = -2: 'r1' = -2.0: must be greater than 0"),
        (changed(grid={"rho": []}), r"'grid.rho' = \[\]: must be a list of at least 1"),
        (changed(grid={"rho": [1.0], "r1": [1.0]}), "rho sets r1; give one of the two"),
        (changed(grid={"joints": [2, 9]}), "'joints' = 9: must be at most 8"),
        (changed(grid={"joints": [2, 3]}), "task 1: start_deg has 2 angles, and a design has 3"),
        (changed(grid={"link_lengths": [[1.0]]}), "link_lengths has 1 values for 2 joints"),
        (changed(front=["effrt"]), "front: unknown figure 'effrt'; did you mean 'effort'"),
        (changed(front=["effort", "effort"]), "front names 'effort' twice"),
        (changed(methods=["colocation"]), "did you mean 'collocation'"),
        (changed(methods=["collocation compensated"]), "name methods without 'compensated'"),
        (changed(tasks={"count": 3}), r"start_deg = \[low, high\] is needed to draw 3 pairs"),
        (changed(tasks={}), "give either pairs, or count"),
        (changed(tasks={"count": 2, **BOX, "goal_deg": [45, 20]}), "the first must be the lower"),
        (changed(tasks={"pairs": TASKS, **BOX}), "start_deg is for drawn pairs"),
        (changed(contact_force_n=10.0), "contact_force_n needs radii in metres; give the table"),
        (changed(grid={"contact_force_n": [9.0]}), "contact_force_n needs radii in metres; give"),
        (changed(problem="nowhere.toml"), "there is no file nowhere.toml"),
        (changed(problem="problems/unicycle.toml"), "a design study needs a 'manipulator'"),
        (changed(set={"goal.travel": 0.5}), "goal.travel = 0.5 of the problem suits one"),
        (changed(problem={**PROBLEM, **TIP}), "goal.tip_m of the problem suits the links of one"),
        (changed(problem={**PROBLEM, **UNEVEN}), "belong to stages of different radii; give the"),
        (changed(replay={"samples": 0}), "'replay.samples' = 0: must be at least 2"),
        (changed(grid={"kappa": [1, 1]}), "has the value 1 twice"),
    ],
)  # fmt: skip
def test_bad_studies_are_named_before_anything_is_planned(tables: Tables, says: str) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.design_study(tables, workers=0)


def test_a_goal_that_leaves_a_joint_free_has_no_window_and_is_planned() -> None:
    goal = {"goal.theta_deg": [30, "free"]}
    kept = {key: value for key, value in STUDY.items() if key != "tasks"}
    found = planner.design_study({**kept, "methods": ["collocation"], "set": goal}, workers=0)
    assert found.recommended is not None
    assert found.rows[0]["solved collocation"] == 1.0
    assert np.isnan(found.rows[0]["one_way"])
    assert "one-way" not in found.reason


def asked(quick: Tables, **tables: Any) -> Any:
    """What is planned of designs and tasks, none of which can be solved."""
    return planner.design_study({**quick, **tables}, workers=0).input


def test_the_dry_run_refuses_unknown_figures_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "x.toml"
    paper = json.dumps(str(Path("problems/paper.toml").resolve()))
    file.write_text(f'problem = {paper}\nfront = ["effrt"]\n[grid]\nrho = [1.0]\n')
    assert main(["design", str(file), "--dry-run"]) == 2
    assert "unknown figure 'effrt'" in capsys.readouterr().err


def test_tasks_are_drawn_alike_for_every_design_and_more_begin_with_the_same(quick: Tables) -> None:
    drawn = {"count": 3, "seed": 5, **BOX}
    few = asked(quick, grid={"joints": [2, 4]}, tasks=drawn)
    assert sorted(few.tasks) == [2, 4]
    for n, tasks in few.tasks.items():
        assert all(5 <= angle <= 15 for task in tasks for angle in task[0])
        assert all(20 <= angle <= 45 for task in tasks for angle in task[1])
        assert {len(angles) for task in tasks for angles in task} == {n}
    more = asked(quick, grid={"joints": [2, 4]}, tasks={**drawn, "count": 5})
    assert more.tasks[4][:3] == few.tasks[4]
    system = few.problem_of(few.designs[1], few.tasks[4][0]).system
    # rho = 1 of two joints, kappa = k_g K2
    assert np.asarray(system.K) == pytest.approx([0.56] * 3)


def test_the_problems_own_task_and_mechanism_are_taken_where_nothing_else_is_said(
    quick: Tables,
) -> None:
    problem = planner.Problem.from_dict(quick["problem"])
    own = asked(quick, problem=problem, grid={"kappa": [0.7, 1.5]}, present=True)
    assert own.tasks == {2: (([10, 10], [30, 30]),)}
    first = own.designs[0]
    assert (first.name, first.values) == ("as it is", {})
    system = own.problem_of(first, own.tasks[2][0]).system
    assert system.k_g * system.K == pytest.approx([0.56])
    gear = {"r1": 0.03, "R": 0.04, "r3": 0.03, "lambda": 1.0, "eta": 1.0}
    arm = {"kind": "manipulator", "joints": 2, "gear": gear, "link_lengths": [0.3, 0.2]}
    shaped = {**quick["problem"], "system": arm}
    linked = asked(quick, problem=shaped, grid={"kappa": [1.0]}, present=True)
    assert [each.link_lengths for each in linked.designs] == [(0.3, 0.2)] * 2
    same = asked(quick, present=True, grid={"kappa": [0.56, 1.0]})
    assert [each.name for each in same.designs] == ["kappa = 0.56", "kappa = 1"]


def test_a_given_force_makes_larger_wheels_transmit_more(quick: Tables) -> None:
    gear = {"r1": 0.03, "R": 0.04, "r3": 0.03, "lambda": 1.0, "eta": 1.0}
    found = asked(quick, gear=gear, contact_force_n=50.0, grid={"r1": [0.03, 0.06]})
    problems = [found.problem_of(each, found.tasks[2][0]) for each in found.designs]
    quantities = [
        planner.Machine.from_table(p.machine).effects["friction_capacity_nm"] for p in problems
    ]
    assert [q.value[0] for q in quantities] == pytest.approx([1.5, 3.0])
    assert [q.spread[0] for q in quantities] == pytest.approx([0.15, 0.3])  # 10 % as before


def test_designs_have_stages_that_are_alike(quick: Tables) -> None:
    gear = {"r1": [0.03, 0.04], "R": 0.04, "r3": 0.03, "lambda": 1.0, "eta": 1.0}
    with pytest.raises(planner.InputError, match="all stages are equal: give numbers"):
        asked(quick, gear=gear, grid={"R": [0.05]})


def test_the_contact_force_is_a_design_variable(quick: Tables) -> None:
    """A contact pressed harder slips less, and drags more on motor 1 where a joint turns it."""
    gear = {"r1": 0.04, "R": 0.05, "r3": 0.05, "lambda": 1.0, "eta": 1.0}
    problem = {**PROBLEM, "goal": {"theta_deg": [30, 30], "duration": 6.0}}
    problem["machine"] = {**PROBLEM["machine"], "lateral_friction": 0.2}  # type: ignore[dict-item]
    tables = {**STUDY, "problem": problem, "gear": gear, "tasks": {"pairs": TASKS[:1]}}
    study = planner.design_study(
        {**tables, "grid": {"contact_force_n": [10.0, 80.0]}, "present": True}, workers=0
    )
    present, light, hard = study.rows
    assert present.design.values == {}
    assert light["contact_load"] > 2 * hard["contact_load"]  # its own drag loads it, too
    assert light["motor_torque_nm"] < hard["motor_torque_nm"]
    powers = [row["motor_power_w"] / row["motor_torque_nm"] for row in (light, hard)]
    assert powers == pytest.approx([light["peak_u1_rad_s"]] * 2)
    assert study.to_dict()["designs"][1]["contact_force_n"] == 10.0
