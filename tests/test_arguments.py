"""Arguments of another kind: what is meant is taken, and all else is told in one sentence."""

from __future__ import annotations

import copy
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import report
from planner.paper.reproduce import reproduce
from planner.support.arrays import plain


@pytest.fixture(scope="module")
def plan() -> planner.Plan:
    return planner.solve(planner.load_problem("problems/paper.toml"), "collocation")


# -- what is meant is taken ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "angles", [np.array([20.0, 21.0, 22.0]), (20.0, 21.0, 22.0), [np.float32(20), 21, np.int64(22)]]
)
def test_arrays_tuples_and_numpy_numbers_are_values_of_a_problem(angles: Any) -> None:
    problem = planner.load_problem("problems/paper.toml")
    changed = problem.changed({"goal.theta_deg": angles, "goal.duration": np.float64(12)})
    assert np.rad2deg(changed.goal[1:]) == pytest.approx([20, 21, 22])
    assert changed == problem.changed({"goal.theta_deg": [20, 21, 22], "goal.duration": 12.0})
    tables = problem.to_dict()
    tables["goal"]["theta_deg"] = angles
    tables["goal"]["duration"] = np.float64(12)
    assert planner.Problem.from_dict(tables) == changed
    assert tables["goal"]["theta_deg"] is angles  # the caller's tables stay as they are


def test_numpy_numbers_out_of_range_are_refused_as_others_are() -> None:
    problem = planner.load_problem("problems/paper.toml")
    with pytest.raises(planner.InputError, match="too large"):
        problem.changed({"goal.duration": np.float64(1e300)})
    with pytest.raises(planner.InputError, match=r"'goal.theta_deg\[1\]' = 95\.0: "):
        problem.changed({"goal.theta_deg": np.array([1.0, 95.0, 1.0])})


def test_arrays_are_options_of_a_method(plan: planner.Plan) -> None:
    tight = plan.problem.changed({"limits.input_rad_s": 2.0})
    made = planner.solve(tight, "polynomial", points=np.array([[5.0, -0.3]]))
    assert made.options["points"] == [[5.0, -0.3]]


def test_plain_values_copy_what_they_are_given() -> None:
    given: dict[str, Any] = {"a": [[1.0]], "b": np.bool_(True), "c": (np.arange(2),)}
    found = plain(given)
    assert found == {"a": [[1.0]], "b": True, "c": [[0, 1]]}
    assert found["a"][0] is not given["a"][0]
    assert type(found["b"]) is bool


def test_a_preset_stands_for_its_machine(plan: planner.Plan) -> None:
    by_name = planner.replay(plan, "ideal")
    assert by_name.machine == planner.Machine.ideal()
    np.testing.assert_array_equal(
        by_name.q, planner.replay(plan, planner.Machine.ideal(), seed=0).q
    )
    found = planner.compare(plan.problem, ["collocation"], machine="ideal", samples=2)
    assert found.machine == planner.Machine.ideal()


# -- all else is told ------------------------------------------------------------------------------

NO_PLAN = "is not a Plan; planner.solve.problem, method. makes one and planner.load_plan"
NO_PROBLEM = "is not a Problem; planner.load_problem"
NO_NAME = "is not the name of a file or folder"

TAKE_PLANS: dict[str, Callable[[Any], Any]] = {
    "certify": planner.certify,
    "emulate_log": planner.emulate_log,
    "error_budget": planner.error_budget,
    "export": lambda x: planner.export(x, "never.csv"),
    "machine_sensitivity": planner.machine_sensitivity,
    "replay": planner.replay,
    "retime": planner.retime,
    "sensitivity": planner.sensitivity,
    "verify": planner.verify,
    "animate": lambda x: report.animate(x, "never.gif"),
    "plot_arm": report.plot_arm,
    "plot_inputs": report.plot_inputs,
    "plot_joints": report.plot_joints,
    "plot_map": report.plot_map,
    "plot_z": report.plot_z,
}
TAKE_PROBLEMS: dict[str, Callable[[Any], Any]] = {
    "check": planner.check,
    "check_run": planner.check_run,
    "compare": planner.compare,
    "excitation": planner.excitation,
    "explore": planner.explore,
    "homing": planner.homing,
    "seating": planner.seating,
    "identify": lambda x: planner.identify([], x),
    "solve": planner.solve,
    "trade_off": planner.trade_off,
    "travel_window": planner.travel_window,
}
TAKE_NAMES: dict[str, Callable[[Any], Any]] = {
    "design_study": planner.design_study,
    "load_machine": planner.load_machine,
    "load_plan": planner.load_plan,
    "load_problem": planner.load_problem,
    "load_samples": planner.load_samples,
    "load_sweep": planner.load_sweep,
    "load_budgets": report.load_budgets,
    "load_comparison": report.load_comparison,
    "read_log": planner.read_log,
    "run_sweep": lambda x: planner.run_sweep(x, "never.db"),
    "write_report": report.write_report,
}
TAKE_OTHERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "sensitivities": (lambda x: planner.sensitivities({"a": x}), "is not a Plan"),
    "compensate": (  # takes a problem, too
        lambda x: planner.compensate(None if isinstance(x, planner.Problem) else x),
        NO_PLAN,
    ),
    "chained_form": (planner.chained_form, "is not a TriangularSystem; problem.system is one"),
    "controllability": (
        lambda x: planner.controllability(x, [0, 0, 0, 0]),
        "is not a TriangularSystem; problem.system is one",
    ),
    "plot_budget": (report.plot_budget, "is not a Budget; planner.error_budget"),
    "plot_design": (report.plot_design, "is not a DesignStudy; planner.design_study"),
    "plot_efforts": (report.plot_efforts, "is not a Comparison; planner.compare"),
    "plot_errors": (report.plot_errors, "give errors by label"),
    "plot_machine_sensitivity": (report.plot_machine_sensitivity, "planner.machine_sensitivity"),
    "plot_mechanism": (report.plot_mechanism, "is not a Manipulator; problem.system of an arm"),
    "plot_replays": (report.plot_replays, "is not a Replay; planner.replay.plan. makes one"),
    "plot_responses": (report.plot_responses, "is not a Sensitivity; planner.sensitivity"),
    "plot_run": (lambda x: report.plot_run(x, None), "is not a Log; planner.read_log"),
    "plot_sensitivities": (report.plot_sensitivities, "is not a Sensitivities; planner.sens"),
    "plot_sensitivity": (report.plot_sensitivity, "is not a Sensitivity; planner.sensitivity"),
    "plot_trade_off": (report.plot_trade_off, "is not a TradeOff; planner.trade_off"),
}
REGISTERING = {"register_method", "register_requirement", "register_system"}


WRONG: dict[str, tuple[Callable[[Any], Any], str, list[Any]]] = {
    **{name: (call, NO_PLAN, ["plan.json", 3]) for name, call in TAKE_PLANS.items()},
    **{name: (call, NO_PROBLEM, [3, None]) for name, call in TAKE_PROBLEMS.items()},
    **{name: (call, NO_NAME, [3]) for name, call in TAKE_NAMES.items()},
    **{name: (call, words, [3]) for name, (call, words) in TAKE_OTHERS.items()},
}


def test_every_public_function_is_tried_here() -> None:
    functions = {
        name
        for package in (planner, report)
        for name in package.__all__
        if inspect.isroutine(inspect.unwrap(getattr(package, name)))
    }
    assert functions - REGISTERING == WRONG.keys()


@pytest.mark.parametrize("name", WRONG)
def test_what_is_something_else_is_told(plan: planner.Plan, name: str) -> None:
    call, words, values = WRONG[name]
    for value in [plan if name in TAKE_PROBLEMS else plan.problem, *values]:
        with pytest.raises(planner.InputError, match=words):
            call(value)


@pytest.mark.parametrize("name", [*TAKE_PROBLEMS, "compensate"])
def test_a_problem_may_be_its_file_or_its_tables(name: str) -> None:
    for value, words in (("none.toml", "none.toml"), ({"system": {}}, "system.kind")):
        with pytest.raises(planner.InputError, match=words):
            WRONG[name][0](value)


def test_a_file_and_tables_give_the_same_plan() -> None:
    path = Path(__file__).parents[1] / "problems/paper.toml"
    problem = planner.load_problem(path)
    tables = problem.to_dict()
    assert planner.load_problem(tables) == planner.solve(tables).problem
    for same in (path, str(path)):
        np.testing.assert_array_equal(planner.solve(same).t, planner.solve(problem).t)
    longer = planner.load_problem(tables, {"goal.duration": 12.0, "limits.z2_margin": None})
    assert longer.duration == 12.0
    assert longer.limits.z2_margin is None
    assert planner.load_problem(tables) == planner.load_problem(problem.to_dict())
    for motion in (planner.excitation, planner.check_run, planner.homing):
        for same in (path, tables):
            np.testing.assert_array_equal(motion(same).t, motion(problem).t)


def test_one_wrong_among_several_plans_is_told(plan: planner.Plan) -> None:
    for several in ([plan, plan.problem], {"a": plan, "b": plan.problem}, [None]):
        with pytest.raises(planner.InputError, match=NO_PLAN):
            report.plot_inputs(several)


@pytest.mark.parametrize("given", ["protoype", 3, {"preset": "ideal"}])
def test_what_is_no_machine_is_told(plan: planner.Plan, given: Any) -> None:
    for call in (planner.replay, planner.machine_sensitivity, planner.error_budget):
        with pytest.raises(planner.InputError, match="prototype, id"):
            call(plan, given)
    with pytest.raises(planner.InputError, match=r"\bMachine\b"):
        planner.compare(plan.problem, ["collocation"], machine=given)


def test_other_arguments_are_told(plan: planner.Plan) -> None:
    problem: Any = plan.problem
    for call, words in (
        (lambda: problem.changed([("goal.travel", 1)]), "changes must be dotted keys and values"),
        (lambda: planner.Problem.from_dict([1]), "is not a Mapping; planner.load_problem"),  # type: ignore[arg-type]
        (lambda: planner.retime(plan, 0.3), r"give keys of \[limits\]"),  # type: ignore[arg-type]
        (lambda: planner.Tracker(3), r"as in planner.Tracker\(run_up=False\)"),  # type: ignore[arg-type]
        (lambda: planner.compare(problem, 3), "give a list of names, for example"),  # type: ignore[arg-type]
        (lambda: planner.compare(problem, [3]), "give a list of names, for example"),  # type: ignore[list-item]
        (lambda: planner.solve(problem, ["convex"]), "unknown method"),  # type: ignore[arg-type]
        (lambda: planner.solve(problem, warm=problem), NO_PLAN),
        (lambda: planner.replay(plan, after=3), "is not a Replay"),  # type: ignore[arg-type]
        (lambda: planner.replay(plan).percentile(101), "from 0 to 100"),
        (lambda: planner.sensitivities([plan]), "give plans by label"),  # type: ignore[arg-type]
        (lambda: plan.save(None), NO_NAME),  # type: ignore[arg-type]
    ):
        with pytest.raises(planner.InputError, match=words):
            call()


@pytest.mark.parametrize(
    ("cls", "words"),
    [
        (planner.Problem, "planner.load_problem.path., Problem.manipulator.*Problem.from_dict"),
        (planner.Machine, "planner.Machine.prototype.., .ideal.. or .from_table"),
        (planner.Plan, "planner.solve.problem, method. or planner.load_plan"),
    ],
)
def test_a_class_that_is_not_filled_in_by_hand_says_how_it_is_made(cls: Any, words: str) -> None:
    for wrong in ((), ("one",)):
        with pytest.raises(planner.InputError, match=words):
            cls(*wrong)
    with pytest.raises(planner.InputError, match=words):
        cls(nonsense=1)


def test_copies_are_still_made(plan: planner.Plan) -> None:
    assert copy.deepcopy(plan.problem) == plan.problem
    assert copy.copy(planner.Machine.prototype()) == planner.Machine.prototype()


# -- one word for axes --------------------------------------------------------------------------


def test_every_figure_is_drawn_into_axes_of_ones_own_by_the_same_word() -> None:
    figures = {name for name in report.__all__ if name.startswith("plot_")}
    for name in figures:
        keyword = inspect.signature(getattr(report, name)).parameters["axes"]
        assert keyword.kind is inspect.Parameter.KEYWORD_ONLY
        assert keyword.default is None
    drawing = [path.read_text() for path in Path("planner/report/figures").glob("*.py")]
    assert figures == {
        name for text in drawing for name in re.findall(r"^def (plot_\w+)", text, re.M)
    }


LISTENED: list[Callable[[planner.Plan, Any], Any]] = [
    lambda plan, words: planner.solve(plan.problem, "polynomial", progress=words),
    lambda plan, words: planner.compare(plan.problem, "polynomial", samples=1, progress=words),
    lambda plan, words: planner.check(plan.problem, progress=words),
    lambda plan, words: planner.replay(plan, samples=1, progress=words),
    lambda plan, words: planner.error_budget(plan, samples=1, progress=words),
    lambda plan, words: planner.run_sweep({}, "x.sqlite", progress=words),
    lambda plan, words: planner.design_study("x.toml", "x", progress=words),
    lambda plan, words: planner.trade_off(plan.problem, "effort", 3, "x", progress=words),
    lambda plan, words: reproduce("x", progress=words),
    lambda plan, words: report.animate(plan, "x.gif", progress=words),
]


@pytest.mark.parametrize("call", LISTENED, ids=lambda call: call.__code__.co_names[-1])
def test_who_cannot_be_told_of_progress_is_refused_at_once(
    plan: planner.Plan,
    call: Callable[[planner.Plan, Any], Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(planner.InputError, match="progress = 'x': "):
        call(plan, "x")
    assert list(tmp_path.iterdir()) == []
