"""What was verified stays so: arrays are copied when they come in, and read-only outside."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import re
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cache
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

import planner
from planner import Identification
from planner.errors import Part
from planner.problem.tables.method_options import DesensitisedOptions
from planner.robustness.trade_off_points import TradeOffPoint

TWO_JOINTS = {
    "system": {"kind": "manipulator", "joints": 2, "K": [0.8], "k_g": 0.7},
    "start": {"theta_deg": [10, 10]},
    "goal": {"theta_deg": [30, 30], "duration": 3.0},
    "limits": {"input_rad_s": 0.8, "joint_deg": 80},
    "machine": {"step_s": 0.01, "control_period_s": 0.05},
}
POLYNOMIAL = {"points": [[0.5, -0.3]]}


@cache
def plan() -> planner.Plan:
    """Compensated, so that it holds another plan, and notes."""
    problem = planner.load_problem("problems/paper.toml")
    return planner.compensate(planner.solve(problem, "collocation"), planner.Machine.prototype())


@cache
def plain() -> planner.Plan:
    return planner.solve(planner.Problem.from_dict(TWO_JOINTS), "collocation")


@cache
def log() -> planner.Log:
    return planner.emulate_log(plain(), planner.Machine.prototype())


def sweep() -> planner.Sweep:
    grid = {"goal.duration": [3.0, 4.0]}
    return planner.Sweep.from_dict({"problem": TWO_JOINTS, "methods": ["convex"], "grid": grid})


def study() -> planner.DesignStudy:
    tasks = {"pairs": [{"start_deg": [10, 10], "goal_deg": [30, 30]}]}
    tables = {"problem": TWO_JOINTS, "grid": {"kappa": [0.7, 1.5]}, "tasks": tasks}
    more = {"methods": ["collocation"], "compensated": False, "present": False}
    return planner.design_study({**tables, **more, "replay": {"samples": 2}}, workers=0)


def trade_off() -> planner.TradeOff:
    machine, options = planner.Machine.prototype(), DesensitisedOptions()
    errors = {"E_deg": [1.0]}
    point = TradeOffPoint(1.0, plain(), 1.0, 3.0, (0.5, 0.5), 1.0, 1.0, 1.0, 1.0, 0, 1, errors)
    return planner.TradeOff(plain().problem, "effort", (point,), options, machine, None)


def identification() -> Identification:
    machine, ones = planner.Machine.prototype(), np.ones((1, 2))
    problem, logs = plain().problem, (log(),)
    return Identification(machine, machine, problem, logs, None, (), ones, ones.copy(), ())


def custom() -> planner.CustomSystem:
    system = planner.load_problem("problems/custom.toml").system
    assert isinstance(system, planner.CustomSystem)
    return system


GEAR = planner.Gear(1.0, 1.0, 1.0, 1.0, 1.0)

MADE: dict[str, Callable[[], Any]] = {
    "Analysis": lambda: planner.check(plain().problem, ["collocation"]),
    "BallGear": lambda: planner.BallGear(np.array([0.8, 0.9])),
    "Budget": lambda: planner.error_budget(plain(), samples=2, base=2),
    "Car": lambda: planner.Car(2.7),
    "Certificate": lambda: plan().certificate,
    "ChainedForm": lambda: planner.chained_form(plain().problem.system),
    "Check": lambda: planner.verify(plain()),
    "Claim": lambda: plan().certificate.claims[0],  # type: ignore[union-attr]
    "Coin": planner.Coin,
    "Comparison": lambda: planner.compare(plain().problem, ["collocation:intervals=20"], samples=2),
    "Controllability": lambda: planner.controllability(plain().problem.system, [0.0, 0.3, 0.4]),
    "CustomSystem": custom,
    "Design": lambda: study().rows[0].design,
    "DesignStudy": study,
    "Gear": lambda: GEAR,
    "HomingRule": planner.HomingRule,
    "Player": lambda: planner.Player(plain()),
    "Identification": identification,
    "Limits": lambda: plain().problem.limits,
    "Log": log,
    "Machine": planner.Machine.prototype,
    "MachineSensitivity": lambda: planner.machine_sensitivity(plain(), planner.Machine.prototype()),
    "Manipulator": lambda: planner.Manipulator.from_gear(3, GEAR, link_lengths=np.ones(3)),
    "Plan": plan,
    "Problem": lambda: planner.load_problem("problems/obstacle.toml"),
    "waypoint": lambda: planner.load_problem("problems/waypoint.toml"),
    "Replay": lambda: planner.replay(plain(), samples=4, motions=2, feedback=True),
    "Samples": lambda: planner.load_samples(_exported()),
    "Sensitivities": lambda: planner.sensitivities({"one": plain()}),
    "Sensitivity": lambda: planner.sensitivity(plain()),
    "Sweep": sweep,
    "Tracker": lambda: planner.Tracker(run_up=False),
    "TradeOff": trade_off,
    "Trailers": lambda: planner.Trailers(np.array([3.0, 4.0]), 2.7),
    "TravelWindow": lambda: planner.travel_window(plain().problem),
    "Unicycle": planner.Unicycle,
    "Violation": lambda: planner.Violation(Part("x", "rad", 0.0, 1.0, 1.0), 2.0, 1.0),
    "excitation": lambda: planner.excitation(plain().problem),
    "check_run": lambda: planner.check_run(plain().problem),
    "homing": lambda: planner.homing(plain().problem),
    "seating": lambda: planner.seating(plain().problem),
    "retimed": lambda: planner.retime(planner.solve(plain().problem, "convex")),
    "rest": lambda: planner.solve(plain().problem, "collocation", rest=True),
    "polynomial": lambda: planner.solve(plain().problem.changed({"limits": {}}), "polynomial"),
}
"""One value of every public class, and of functions whose results hold other classes."""


def public_classes() -> set[str]:
    values = ((name, getattr(planner, name)) for name in vars(planner)["__all__"])
    return {
        name
        for name, value in values
        if isinstance(value, type)
        and not issubclass(value, BaseException)
        and value is not planner.TriangularSystem  # abstract
    }


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    _exported.path = tmp_path_factory.mktemp("samples") / "plan.csv"  # type: ignore[attr-defined]


def _exported() -> str:
    planner.export(made("rest"), _exported.path)  # type: ignore[attr-defined]
    return str(_exported.path)  # type: ignore[attr-defined]


@cache
def made(name: str) -> Any:
    return MADE[name]()


def test_every_public_class_has_an_example() -> None:
    assert public_classes() <= MADE.keys()
    for name in public_classes():
        assert type(made(name)).__name__ == name


# -- what is handed out ----------------------------------------------------------------------------

Path = tuple[tuple[str, Callable[[Any], Any]], ...]

DEEPEST = 6
"""Attributes of attributes that are looked at: every kind of value appears above."""

HELD: Any = (np.ndarray, dict, list)


def of_planner(value: Any) -> bool:
    return type(value).__module__.startswith("planner.") and not isinstance(value, type)


def parts(value: Any) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Everything that a value hands out without arguments: its name, and how to read it."""
    if isinstance(value, Mapping):
        yield from ((f"[{key!r}]", itemgetter(key)) for key in value)
    elif isinstance(value, tuple | list):
        yield from ((f"[{k}]", itemgetter(k)) for k in range(min(len(value), 3)))
    elif of_planner(value):
        if isinstance(value, BaseModel):  # pydantic's own attributes are not those of the table
            names = [*type(value).model_fields]
        else:
            names = [name for name in object.__dir__(value) if not name.startswith("_")]
        for name in names:
            if not callable(getattr(type(value), name, None)) or name in vars(value):
                yield f".{name}", attrgetter(name)


def held(
    root: Any, path: Path = (), found: Any = None, seen: dict[int, Any] | None = None
) -> Iterator[Path]:
    """The path of every array, dictionary and list that a value hands out."""
    seen = {} if seen is None else seen
    value = found if path else root
    if id(value) in seen or len(path) > DEEPEST:
        return
    seen[id(value)] = value  # kept, so that no other value gets its id
    for part in parts(value):
        try:
            found = part[1](value)
        except (planner.InputError, AttributeError):  # this system has no such thing
            continue
        if isinstance(found, HELD):
            yield (*path, part)
        is_kept = of_planner(found) and part[1](value) is found
        if is_kept or isinstance(found, tuple | list | Mapping):
            yield from held(root, (*path, part), found, seen)


def read(root: Any, path: Path) -> Any:
    for _, part in path:
        root = part(root)
    return root


def name_of(path: Path) -> str:
    return "".join(name for name, _ in path)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return re.sub(" at 0x[0-9a-f]+", "", repr(one)) == re.sub(" at 0x[0-9a-f]+", "", repr(other))


def spoil(value: Any) -> None:
    if isinstance(value, np.ndarray):
        value[...] = ~value if value.dtype.kind == "b" else value + 1
    else:
        value.clear()


@pytest.mark.parametrize("name", MADE)
def test_nothing_that_it_hands_out_changes_it(name: str) -> None:
    value = made(name)
    for path in held(value):
        found = read(value, path)
        before = copy.deepcopy(found)
        if not len(before):
            continue
        with suppress(ValueError, TypeError):
            spoil(found)
        assert same(read(value, path), before), f"{name}{name_of(path)} was changed"


def test_the_walk_finds_what_can_be_changed() -> None:
    found = {name_of(path) for name in ("Plan", "Replay") for path in held(made(name))}
    for end in (
        "trajectory.breaks",
        "problem.start",
        "problem.limits.input",
        "problem.system.K",
        "problem.methods.polynomial.points",
        ".options",
        ".notes",
        ".terminal_error_deg",
        ".draws.values['input_gain_error']",
    ):
        assert any(name.endswith(end) for name in found), end


# -- what is taken in ------------------------------------------------------------------------------


def test_nothing_that_they_took_changes_them() -> None:
    tried = set()
    for name in MADE:
        value = made(name)
        for field in fields(value) if is_dataclass(value) else ():
            given = getattr(value, field.name)
            if not isinstance(given, HELD) or not len(given) or field.name.startswith("_"):
                continue
            mine: Any = given.copy() if isinstance(given, np.ndarray) else list(given)
            mine = dict(given) if isinstance(given, dict) else mine
            other = replace(value, **{field.name: mine})
            spoil(mine)
            assert same(getattr(other, field.name), given), f"{name}.{field.name} is the caller's"
            tried.add(f"{name}.{field.name}")
    assert {"Plan.notes", "Problem.start", "Log.theta", "Replay.q", "Check.margins"} <= tried


def test_arguments_are_copied() -> None:
    K, lengths, start = np.array([0.8, 0.9]), np.ones(3), np.array([10.0, 20.0, 30.0])
    arms = [planner.Manipulator(K, 1.0, lengths), planner.BallGear(K, 1.0, lengths)]
    trailers = planner.Trailers(K)
    problem = planner.Problem.manipulator(start, start + 5, K=K, k_g=1.0)
    expecting = problem.expecting(hint := problem.start.copy())
    points = [[0.5, -0.3]]
    law = planner.solve(problem.changed({"limits": {}}), "polynomial", points=points)
    for array in (K, lengths, start, hint):
        array += 1
    points[0][0] = 7.0
    for arm in arms:
        assert arm.K.tolist() == [0.8, 0.9]
        assert arm.link_lengths.tolist() == [1, 1, 1]
    assert trailers.trailer_lengths_m == pytest.approx([0.8, 0.9])
    assert np.rad2deg(problem.start[1:]) == pytest.approx([10, 20, 30])
    assert expecting.likely.goal[1:] == pytest.approx(problem.start[1:])
    assert law.options["points"] == [[0.5, -0.3]]


class Sledge(planner.Unicycle):
    """A system from elsewhere, which keeps an array as it comes."""

    kind = "sledge"

    def __init__(self, weights: np.ndarray) -> None:
        self.weights = weights


def test_a_system_from_elsewhere_is_as_safe() -> None:
    weights = np.ones(2)
    sledge = Sledge(weights)
    weights += 1
    assert sledge.weights.tolist() == [1, 1]
    with pytest.raises(ValueError, match="read-only"):
        sledge.weights[0] = 5
    assert pickle.loads(pickle.dumps(sledge)) == sledge


def test_a_system_in_use_cannot_change() -> None:
    arm = plain().problem.system
    with pytest.raises(AttributeError, match="is in use and cannot change; make another Manip"):
        arm.k_g = 3.0  # type: ignore[attr-defined]


def test_times_shifted_in_place_leave_the_plan_as_it_was() -> None:
    with pytest.raises(ValueError, match="read-only"):
        plain().t.__iadd__(2.0)
    t = plain().t + 2.0  # the way to shift them
    assert t[0] == 2
    assert plain().t[0] == 0
    q = plain().q(plain().t)
    q += 1  # what a plan computes belongs to the caller
    assert not same(q, plain().q(plain().t))


# -- copies, files of memory, other processes ------------------------------------------------------


def contents(value: Any) -> dict[str, Any]:
    return {name_of(path): read(value, path) for path in held(value)}


def assert_equal(name: str, one: Any, other: Any) -> None:
    assert type(one) is type(other)
    mine, theirs = contents(one), contents(other)
    assert mine.keys() == theirs.keys(), name
    for path, value in mine.items():
        assert same(value, theirs[path]), name + path
    if isinstance(one, planner.Plan | planner.Problem | planner.Machine | planner.TriangularSystem):
        assert one == other


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
@pytest.mark.parametrize("name", MADE)
def test_copies_are_equal_and_read_only_too(name: str, way: str) -> None:
    value = made(name)
    list(held(value))  # with all that its properties have cached
    other = copy.deepcopy(value) if way == "deepcopy" else pickle.loads(pickle.dumps(value))
    assert_equal(name, value, other)
    theirs = contents(other)
    for path, found in contents(value).items():
        if isinstance(found, np.ndarray) and found.size:
            assert theirs[path].flags.writeable == found.flags.writeable, name + path


def _returned(values: dict[str, Any]) -> dict[str, Any]:
    assert values["Plan"].q(1.0).shape == (4,)
    return values


def test_every_value_comes_back_from_another_process() -> None:
    values = {name: made(name) for name in MADE}
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        back = pool.submit(_returned, values).result()
    for name, value in values.items():
        assert_equal(name, value, back[name])
    assert back["Replay"].again([3]).terminal_error == pytest.approx(
        values["Replay"].terminal_error[3:]
    )


def refusals() -> Iterator[BaseException]:
    with pytest.raises(planner.NoPlanError) as found:
        planner.solve(planner.load_problem("problems/paper.toml"), "polynomial")
    yield found.value
    kinds = [planner.PlannerError]
    for kind in kinds:  # grows
        kinds += kind.__subclasses__()
        yield kind("why")


def test_refusals_come_back_too() -> None:
    for raised in refusals():
        for other in (pickle.loads(pickle.dumps(raised)), copy.deepcopy(raised)):
            assert type(other) is type(raised)
            assert str(other) == str(raised)
            assert vars(other).keys() == vars(raised).keys()


# -- times -----------------------------------------------------------------------------------------

NO_TIMES: list[Any] = ["5", None, True, [1.0, "2"], [[1.0], [1.0, 2.0]], 1j, {}, np.array(["5"])]


@pytest.mark.parametrize("t", NO_TIMES, ids=repr)
def test_what_is_no_time_is_refused(t: Any) -> None:
    one = plain()
    calls = [one.q, one.u, one.z, one.v, one.user, one.theta, one.reference, plan().reference]
    calls += [one.trajectory.q, one.trajectory.u, one.clock, made("retimed").q]
    for call in calls:
        with pytest.raises(planner.InputError, match="must be a number or an array of numbers"):
            call(t)


def test_numbers_of_all_kinds_are_times() -> None:
    expected = plain().q([1.0, 2.0])
    for t in ((1, 2), [1, np.float32(2)], np.array([1, 2], dtype=np.int8), [np.int64(1), 2.0]):
        assert plain().q(t) == pytest.approx(expected)


@pytest.mark.parametrize("name", MADE)
def test_two_values_can_be_compared(name: str) -> None:
    value = made(name)
    assert value == value
    assert isinstance(copy.deepcopy(value) == value, bool)
