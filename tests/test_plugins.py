"""Systems, methods and limits from outside: registered by hand, and by an installed package."""

from __future__ import annotations

import json
import os
import pickle
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Literal

import casadi as ca
import numpy as np
import pytest
from command import main
from pydantic import Field
from registered import restored

import planner
from planner import METHODS, InputError, Unicycle
from planner.cli.start import problem_text
from planner.explorer.controls import limit_controls
from planner.explorer.state import State
from planner.methods.refusal import path_changes
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.tables import kinds as plugins
from planner.problem.tables.kinds import FILES, REQUIREMENTS, json_schema
from planner.problem.tables.method_options import MethodsTable
from planner.problem.tables.vehicles import UnicycleFile, UnicycleLimits, VehicleFile
from planner.report.page.words import task_facts
from planner.support.user_tables import Positive, Table
from planner.systems.triangular_system import Coordinate, TangentSystem

ROOT = Path(__file__).parents[1]
PACKAGE = Path(__file__).parent / "plugin"
PAPER = ROOT / "problems/paper.toml"
KEY, PRODUCT = "limits.input_product", "product of the inputs"
PRODUCT_WORDS = "largest |u1 u2|, in the product of the inputs' units"


@pytest.fixture
def clean() -> Iterator[None]:
    with restored() as patch:
        patch.setattr(plugins, "entry_points", lambda group: [])
        yield


@pytest.fixture(scope="module")
def problem_file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The package of tests/plugin as pip would install it, and a problem file of its system."""
    folder = tmp_path_factory.mktemp("site")
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = folder / f"planner_tricycle-{project['version']}.dist-info"
    info.mkdir()
    lines = [
        f"{name} = {what}" for name, what in project["entry-points"]["planner.plugins"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(["[planner.plugins]", *lines]))
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    path = folder / "mine.toml"
    with restored() as patch:
        patch.syspath_prepend(str(PACKAGE))
        patch.syspath_prepend(str(folder))
        patch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{PACKAGE}")  # of the workers of a sweep
        assert main(["new", str(path), "--system", "tricycle", "--full"]) == 0
        yield path
    sys.modules.pop("planner_tricycle", None)


def test_its_system_is_planned_and_verified(problem_file: Path, tmp_path: Path) -> None:
    problem = planner.load_problem(problem_file)
    assert problem.system.kind == "tricycle"
    plan = planner.solve(problem, "collocation")
    assert plan.verified
    assert planner.verify(plan).ok
    assert plan.certificate is not None
    assert planner.load_plan(plan.save(tmp_path / "plan.json")).problem == problem
    assert planner.Problem.from_dict(problem.to_dict()) == problem


def test_its_method_plans_any_system(problem_file: Path) -> None:
    unicycle = planner.load_problem(ROOT / "problems/unicycle.toml")
    for problem in (planner.load_problem(problem_file), unicycle):
        plan = planner.solve(problem, "two_speeds", first=0.4)
        assert plan.verified
        assert plan.method == "two_speeds"
        assert plan.options["first"] == 0.4


def test_the_problem_file_sets_its_options_and_is_strict(problem_file: Path) -> None:
    problem = planner.load_problem(problem_file, {"method.two_speeds.first": 0.45})
    assert planner.solve(problem, "two_speeds").options["first"] == 0.45
    assert problem.to_dict()["method"]["two_speeds"] == {"first": 0.45}
    with pytest.raises(InputError, match=r"'method.two_speeds.frst'.*'first'"):
        planner.load_problem(problem_file, {"method.two_speeds.frst": 0.4})
    with pytest.raises(InputError, match=r"'method.two_speeds.first' = 2: .* 1"):
        planner.load_problem(problem_file, {"method.two_speeds.first": 2})
    with pytest.raises(InputError, match=r"'method.two_sped'.*'two_speeds'"):
        planner.load_problem(problem_file, {"method.two_sped.first": 0.4})


def test_compare_check_and_all_know_its_method(
    problem_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in {*METHODS} - {"polynomial", "two_speeds"}:  # the others' searches are long
        monkeypatch.delitem(METHODS, name)
    problem = planner.load_problem(problem_file, {KEY: 9.0, "machine.step_s": 0.01})
    result = planner.compare(problem, "two_speeds:first=0.4,polynomial", samples=2)
    assert [row.solved for row in result.rows] == [True, True]
    assert result.rows[0].replay is not None
    assert (KEY, f"at most 9 ({PRODUCT})") in task_facts(result)
    with pytest.raises(InputError, match="'first'"):
        planner.compare(problem, "two_speeds:frst=0.4", samples=2)
    analysis = planner.check(problem)
    assert [o["verified"] for o in analysis.outcomes if o["method"] == "two_speeds"] == [True]
    assert "two_speeds" in [
        spec.method for spec in planner.comparison.compare.specs_of(problem, "all")
    ]


def product(plan: planner.Plan) -> float:
    u = plan.u(np.linspace(0.0, plan.duration, 20001))
    return float(np.max(np.abs(u[:, 0] * u[:, 1])))


@pytest.mark.parametrize(
    ("name", "duration"),
    [
        ("paper", 10.0),
        ("tricycle", "free"),
        pytest.param("paper", "free", marks=pytest.mark.campaign),
        pytest.param("tricycle", 10.0, marks=pytest.mark.campaign),
    ],
)
def test_its_limit_is_kept_between_the_nodes_and_proven(
    problem_file: Path, name: str, duration: float | str
) -> None:
    path = problem_file if name == "tricycle" else ROOT / f"problems/{name}.toml"
    changes = {"goal.duration": duration}
    most = 0.7 * product(planner.solve(planner.load_problem(path, changes)))
    plan = planner.solve(planner.load_problem(path, {**changes, KEY: most}))
    assert 0.9 * most < product(plan) <= most
    assert plan.notes["limits_drawn_in"][PRODUCT] > 0  # nodes alone would have let it slip
    assert plan.certificate is not None
    assert plan.certificate[PRODUCT].status == "proven"


@pytest.mark.parametrize("time", [1e-6, 1e6])
def test_its_limit_is_kept_on_any_scale_of_time(problem_file: Path, time: float) -> None:
    del problem_file  # by which it is registered
    one, other = (
        planner.solve(
            planner.Problem.manipulator(
                [1, 1, 1], [30, 30, 30], duration=10.0 * unit, changes={KEY: 0.01 / unit**2}
            )
        )
        for unit in (1.0, time)
    )
    assert product(one) == pytest.approx(0.01, rel=0.02)
    assert product(other) * time**2 == pytest.approx(product(one), rel=1e-9)
    assert other.objective * time == pytest.approx(one.objective, rel=1e-9)


def test_its_limit_slows_what_is_timed(problem_file: Path) -> None:
    del problem_file  # by which it is registered
    paper = planner.load_problem(ROOT / "problems/paper.toml")
    plan = planner.solve(paper)
    retimed = planner.retime(plan, {"input_product": 0.005})
    assert product(retimed) == pytest.approx(0.005, rel=1e-3)
    fastest = planner.retime(plan)
    assert retimed.duration > 1.5 * fastest.duration
    # The clock knows limits of inputs and rates only, and the plan does not claim more.
    assert fastest.objective_name == "time: the least for this path, in seconds"
    assert "slowed as a whole for other limits" in retimed.objective_name
    with pytest.raises(planner.NotConvergedError, match="input limits, slowed for other limits; g"):
        planner.solve(paper.changed({KEY: 0.011}), "convex")
    problem = paper.changed({KEY: 0.01, "goal.duration": "free"})
    for plan in (
        planner.solve(problem, "sinusoid", amplitude=0.3),  # given, since its search takes long
        planner.solve(problem, "convex"),
    ):
        assert product(plan) == pytest.approx(0.01, rel=1e-2)


def test_its_limit_is_kept_by_desensitised_plans_and_judged_elsewhere(problem_file: Path) -> None:
    del problem_file
    paper = planner.load_problem(ROOT / "problems/paper.toml", {KEY: 0.012})
    assert product(planner.solve(paper, "desensitised", starts=1)) <= 0.012
    with pytest.raises(planner.VerificationError) as refusal:
        planner.solve(paper, "polynomial")
    broken = next(each for each in refusal.value.violations if each.label == PRODUCT)
    assert broken.limit == pytest.approx(0.012)
    assert broken.value == pytest.approx(0.07222, abs=5e-6)


def test_its_limit_is_a_key_of_every_file(problem_file: Path) -> None:
    for path in (problem_file, *sorted((ROOT / "problems").glob("*.toml"))):
        problem = planner.load_problem(path, {KEY: 0.5})
        assert problem.to_dict()["limits"]["input_product"] == 0.5
        assert problem.registered_limits[0].parts[0].high == 0.5
        assert not problem.changed({KEY: None}).registered_limits
    with pytest.raises(InputError, match=r"'limits.input_product' = -1: .* 0"):
        planner.load_problem(problem_file, {KEY: -1})
    with pytest.raises(InputError, match="'input_product'"):
        planner.load_problem(problem_file, {"limits.inputs_product": 1})
    schema = json_schema()["$defs"]
    for table in ("CarLimits", "LimitsTable", "CustomLimits"):
        assert "Largest |u1 u2|" in schema[table]["properties"]["input_product"]["description"]
    for kind in FILES:
        brief = problem_text(kind)
        (row,) = (line for line in brief.splitlines() if "input_product" in line)
        assert row.split("# ") == ["#input_product = 0.2".ljust(29), PRODUCT_WORDS]
        limited = tomllib.loads(brief.replace("#input_product", "input_product"))["limits"]
        assert limited["input_product"] == 0.2
    state = State(planner.load_problem(problem_file, {KEY: 0.5}))
    (slider,) = (c for c in limit_controls(state, state.base) if c.key == KEY)
    assert (slider.label, slider.shown) == ("input product", 0.5)


def test_workers_of_a_sweep_read_the_same_entry_points(problem_file: Path, tmp_path: Path) -> None:
    sweep = {
        "problem": planner.load_problem(problem_file).to_dict(),
        "methods": ["two_speeds"],
        "grid": {"method.two_speeds.first": [0.4, 0.5], KEY: [1.0, 2.0]},
    }
    outcome = planner.run_sweep(sweep, tmp_path / "x.sqlite", workers=1)
    assert outcome.statuses == {"solved": 4}
    with pytest.raises(InputError, match="'first'"):
        planner.Sweep.from_dict({**sweep, "grid": {"method.two_speeds.frst": [0.4, 0.5]}})


def test_commands_know_both(problem_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def said(*words: str) -> str:
        assert main(list(words)) == 0
        return capsys.readouterr().out

    assert json.loads(said("methods", "--json"))["two_speeds"].startswith("v1 constant")
    assert json.loads(said("systems", "--json"))["tricycle"].startswith("tricycle, driven")
    schema = json.loads(said("schema"))
    assert "two_speeds" in schema["$defs"]["MethodsTable"]["properties"]
    assert "TricycleFile" in schema["$defs"]
    assert "TwoSpeedsOptions" in said("schema", "plan")
    made = problem_file.read_text(encoding="utf-8")
    assert made.startswith("# A problem file of planner.")
    assert '\nkind = "tricycle"\n' in made
    assert "\n[method.two_speeds]\n" in made
    assert "\n#first = 0.5\n" in made
    assert json.loads(said("plan", str(problem_file), "-m", "two_speeds", "--json"))["verified"]


def test_a_schema_says_what_a_file_may_say(problem_file: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    data = tomllib.loads(problem_file.read_text(encoding="utf-8"))
    assert validator.is_valid({**data, "method": {"two_speeds": {"first": 0.4}}})
    assert not validator.is_valid({**data, "method": {"two_speeds": {"frst": 0.4}}})


# -- by hand -----------------------------------------------------------------------------------


class Options(Table):
    often: int = 1


class Needy(Table):
    often: int


class SledTable(Table):
    kind: Literal["sled"]


class SledFile(UnicycleFile):
    summary = "a sled"
    example = '[system]\nkind = "sled"\n[goal]\nx_m = 2.0\ny_m = 1.0\n'
    system: SledTable

    def build_system(self) -> Unicycle:
        return Unicycle()


def polynomial(problem: planner.Problem, options: Options) -> planner.Plan:
    return planner.solve(problem, "polynomial")


def register(name: Any = "mine", plan: Any = polynomial, **changes: Any) -> None:
    given: dict[str, Any] = {"options": Options, "summary": "mine", **changes}
    planner.register_method(name, plan, **given)


@pytest.mark.usefixtures("clean")
def test_problems_read_before_keep_working() -> None:
    before = planner.load_problem(ROOT / "problems/unicycle.toml")
    register()
    assert planner.solve(before, "mine").verified
    after = before.changed({"method.mine.often": 3})
    assert after.methods.mine.often == 3  # type: ignore[attr-defined]
    assert pickle.loads(pickle.dumps(after)) == after
    assert pickle.loads(pickle.dumps(before)).methods == before.methods


@pytest.mark.usefixtures("clean")
def test_what_no_other_process_knows_is_not_sent_to_workers(tmp_path: Path) -> None:
    register()
    planner.register_system("sled", SledFile)
    sweep = {
        "problem": tomllib.loads(SledFile.example),
        "methods": ["mine"],
        "grid": {"goal.y_m": [0.5, 1.0]},
    }
    says = "method 'mine' and system 'sled': registered only in this process"
    with pytest.raises(InputError, match=says):
        planner.run_sweep(sweep, tmp_path / "x.sqlite")
    outcome = planner.run_sweep(sweep, tmp_path / "x.sqlite", workers=0)
    assert outcome.statuses == {"solved": 2}


METHOD_REFUSALS: list[tuple[dict[str, Any], str]] = [
    ({"name": "polynomial"}, "method 'polynomial' exists already: the paper's method"),
    ({"name": "two words"}, "method 'two words' cannot be registered: a name has letters"),
    ({"name": "a\x1b[31mb"}, r"method 'a\[31mb' cannot be registered"),
    ({"name": 3}, "method '3' cannot be registered"),
    ({"name": "all"}, "method 'all' cannot be registered: the name is reserved"),
    ({"name": "model_dump"}, "the name is reserved"),
    ({"plan": "polynomial"}, "method 'mine' cannot be registered: plan = 'polynomial' is not a"),
    ({"replan": 3}, "replan = 3 is not a function"),
    ({"options": dict}, "options = <class 'dict'> is not a subclass of Table"),
    ({"options": Needy}, "its option often has no default"),
    ({"summary": ""}, "summary is not a text"),
    ({"refines": "colocation"}, "refines = 'colocation' is no method"),
]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(("changes", "says"), METHOD_REFUSALS, ids=[s for _, s in METHOD_REFUSALS])
def test_what_is_no_method_is_refused(changes: dict[str, Any], says: str) -> None:
    before = dict(METHODS), dict(MethodsTable.model_fields)
    with pytest.raises(InputError, match=says):
        register(**changes)
    assert before == (dict(METHODS), dict(MethodsTable.model_fields))


def changed(**attributes: Any) -> type[SledFile]:
    hints = {name: kind for name, kind in attributes.items() if name in SledFile.model_fields}
    rest = {name: value for name, value in attributes.items() if name not in hints}
    return type(
        "OtherFile", (SledFile,), {"__annotations__": hints, "__module__": __name__, **rest}
    )


SYSTEM_REFUSALS: list[tuple[Any, Callable[[], Any], str]] = [
    ("car", lambda: SledFile, "system kind 'car' is taken, by CarFile"),
    ("a sled", lambda: SledFile, "system kind 'a sled' cannot be registered: a kind has letters"),
    ("a\u202eb", lambda: SledFile, "system kind 'ab' cannot be registered"),
    (None, lambda: SledFile, "system kind 'None' cannot be registered"),
    ("sled", lambda: Unicycle, "<class .*Unicycle'> is not a subclass of ProblemFile"),
    ("sled", lambda: NoBuildFile, "NoBuildFile lacks build_system"),
    ("sledge", lambda: SledFile, r"SledFile.system has no key kind of type Literal\['sledge'\]"),
    ("sled", lambda: changed(goal=Options), "OtherFile.goal is not a table, .* of GoalTable"),
    ("sled", lambda: changed(summary=""), "OtherFile.summary is not a text"),
    ("sled", lambda: changed(example=" "), "OtherFile.example is not a text"),
]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(
    ("kind", "make", "says"), SYSTEM_REFUSALS, ids=[s for _, _, s in SYSTEM_REFUSALS]
)
def test_what_is_no_system_is_refused(kind: Any, make: Callable[[], Any], says: str) -> None:
    before = dict(FILES)
    with pytest.raises(InputError, match=says):
        planner.register_system(kind, make())
    assert before == FILES


class Half(TangentSystem):
    kind = "sled"
    coordinates = Coordinate("x", "m"), Coordinate("heading", "rad"), Coordinate("y", "m")


class NoBuildFile(VehicleFile):
    system: SledTable
    limits: UnicycleLimits = Field(default_factory=UnicycleLimits)


class HalfSystemFile(SledFile):
    def build_system(self) -> Any:
        return Half()  # type: ignore[abstract]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(
    ("file", "says"),
    [
        (NoBuildFile, r"system kind 'sled' is not complete: .*NoBuildFile.*\bbuild_system\b"),
        (HalfSystemFile, r"system kind 'sled' is not complete: .*Half.*\bslopes_expr\b"),
    ],
)
def test_what_a_kind_of_the_planner_lacks_is_named(file: Any, says: str) -> None:
    FILES["sled"] = file
    with pytest.raises(InputError, match=says):
        planner.Problem.from_dict(tomllib.loads(SledFile.example))


@dataclass(frozen=True)
class TurnRate(Requirement):
    """|u₂| ≤ most."""

    most: float
    key, reads, table = "turn_rate", frozenset({"u"}), (Positive, "Largest |u2|.")

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("turn rate", "rad/s", -self.most, self.most, self.most, 1),)


class Partless(Requirement):
    key, reads, table = "partless", frozenset({"u"}), (Positive, "None.")


def differing(**attributes: Any) -> type[TurnRate]:
    return type("Other", (TurnRate,), attributes)


REQUIREMENT_REFUSALS: list[tuple[Any, str]] = [
    (TurnRate(1.0), "is not a subclass of Requirement"),
    (Partless, "requirement 'partless' cannot be registered: Partless lacks parts"),
    (differing(key="z2_margin"), "'z2_margin' cannot be registered: that key is taken"),
    (differing(key="Turn"), "Other.key is not a name of a-z, 0-9 and _"),
    (differing(key="model_dump"), "Other.key is not a name"),
    (differing(key=""), "Other.key is not a name"),
    (differing(reads=frozenset({"z"})), "Other.reads does not say which"),
    (differing(smooth=False), "Other.reads may be only 'q' in a limit that is not smooth"),
    (differing(final=True), "Other.reads may be only 'q' in a limit that is not smooth, or final"),
    (differing(table=None), "Other.table is not a type and a description"),
    (differing(table=(float, " ")), "Other.table is not a type and a description"),
]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(
    ("kind", "says"), REQUIREMENT_REFUSALS, ids=[s for _, s in REQUIREMENT_REFUSALS]
)
def test_what_is_no_requirement_is_refused(kind: Any, says: str) -> None:
    before = dict(REQUIREMENTS)
    with pytest.raises(InputError, match=says):
        planner.register_requirement(kind)
    assert before == REQUIREMENTS


@dataclass(frozen=True)
class Faulty(TurnRate):
    """What an author may forget."""

    how: str = ""
    names: Any = ()

    @classmethod
    def of(cls, value: Any, system: Any) -> Faulty:
        if value > 3:
            raise ValueError("at most 3 turns")
        if value == 2:
            raise KeyError("two")
        how = ("unnamed", "rows", "parts", "list", "raises", "one", "none")[int(10 * value) - 1]
        return cls(float(value), how, [] if how == "list" else ())

    @property
    def parts(self) -> tuple[Part, ...]:
        return super().parts * (2 if self.how == "parts" and self.most else 1)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        if self.how == "rows":
            return []
        return [point.u[1] - (self.most if self.how == "unnamed" else 0)] * len(self.parts)

    def values(self, point: MotionPoint) -> Sequence[Any]:
        if self.how == "raises":
            raise ZeroDivisionError("no\x07 way")
        return {"one": [0.1], "none": [None]}.get(self.how) or super().values(point)


FAULTS = [
    (0.1, "its class Faulty has rows that read a float that `row_fields` does not list"),
    (0.2, "has 1 parts and 0 rows"),
    (0.3, "has 2 parts and 2 rows; their numbers must be equal"),
    (0.4, "has fields that are not strings"),
    (0.5, "its class Faulty failed: ZeroDivisionError: no way"),
    (0.6, "has 1 parts, but its values are not one real array for each"),
    (0.7, "has 1 parts, but its values are not one real array for each"),
    (2.0, "its class Faulty failed: KeyError: 'two'"),
    (4.0, "'limits.turn_rate': at most 3 turns"),
]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(("value", "says"), FAULTS)
def test_a_class_that_contradicts_itself_is_refused(
    paper: planner.Problem, value: float, says: str
) -> None:
    planner.register_requirement(Faulty)
    with pytest.raises(InputError, match=says):
        paper.changed({"limits.turn_rate": value})


@pytest.mark.usefixtures("clean")
def test_a_limit_registered_by_hand_is_known_here_alone(tmp_path: Path) -> None:
    before = planner.load_problem(ROOT / "problems/unicycle.toml")
    planner.register_requirement(TurnRate)
    with pytest.raises(InputError, match="'turn_rate' "):
        planner.register_requirement(TurnRate)
    planner.register_system("sled", SledFile)  # which knows it too
    problem = planner.Problem.from_dict(
        {**tomllib.loads(SledFile.example), "limits": {"turn_rate": 0.8}}
    )
    plan = planner.solve(problem)
    assert planner.verify(plan).margins["turn rate"] >= 0
    assert plan.certificate is not None
    assert plan.certificate["turn rate"].status == "proven"
    assert pickle.loads(pickle.dumps(problem)) == problem
    assert planner.solve(before, "polynomial").verified
    sweep = {"problem": before.to_dict(), "methods": ["polynomial"]}
    for grid in ({"limits.turn_rate": [5.0, 6.0]}, {"limits": [{"turn_rate": 5.0}, {}]}):
        with pytest.raises(InputError, match="requirement 'turn_rate': registered only in this"):
            planner.run_sweep({**sweep, "grid": grid}, tmp_path / "x.sqlite")


@dataclass(frozen=True)
class Picky(Requirement):
    """θ₁ ≤ 90°, by a formula that fails beyond `fails`."""

    fails: float
    key, reads, table = "picky", frozenset({"q"}), (Positive, "Where its formula fails.")

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("picky", "rad", -np.inf, np.pi / 2, 1.0, 1),)

    def values(self, point: MotionPoint) -> Sequence[Any]:
        return [1 / 0 if np.any(point.q[1] > self.fails) else point.q[1]]


@pytest.mark.usefixtures("clean")
def test_a_limit_that_breaks_down_on_the_way_names_its_package(
    paper: planner.Problem, tmp_path: Path
) -> None:
    planner.register_requirement(Picky)
    named = f"limit 'picky' of module {__name__} failed: ZeroDivisionError: division by zero"
    problem = paper.changed({"limits.picky": 0.53, "goal.duration": 20})
    with pytest.raises(planner.MethodError, match=re.escape(named)) as refusal:
        planner.solve(problem, "collocation")
    assert "in values" in refusal.value.traceback
    assert planner.compare(problem, "polynomial", samples=2).rows[0].why == named
    sweep = {"problem": problem.to_dict(), "methods": ["polynomial"]}
    sweep["grid"] = {"goal.duration": [20]}
    outcome = planner.run_sweep(sweep, tmp_path / "x.sqlite", workers=0)
    assert (outcome.statuses, outcome.bugs) == ({"method_failed": 1}, 0)
    with pytest.raises(InputError, match=re.escape(f"the goal cannot be checked: {named}")):
        paper.changed({"limits.picky": 0.5})


@dataclass(frozen=True)
class Folded(Requirement):
    """cos(θ₁ + θ₂) ≥ least: the second link does not turn too far from the base."""

    least: float
    key, reads, table = "folded", frozenset({"q"}), (Positive, "Least cos(theta1 + theta2).")

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("second link's cosine", "", self.least, np.inf, 1.0),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [ca.cos(point.q[1] + point.q[2])]

    def values(self, point: MotionPoint) -> Sequence[Any]:
        return [np.cos(point.q[1] + point.q[2])]


@pytest.mark.usefixtures("clean")
def test_a_limit_on_the_way_is_kept_or_said_not_to_be_promised(paper: planner.Problem) -> None:
    planner.register_requirement(Folded)
    fast = paper.changed({"goal.duration": "free"})

    def least(plan: planner.Plan) -> float:
        q = plan.q(np.linspace(0.0, plan.duration, 20001))
        return float(np.min(np.cos(q[:, 1] + q[:, 2])))

    assert least(planner.solve(fast)) < 0.45
    problem = fast.changed({"limits.folded": 0.45})
    plan = planner.solve(problem)
    assert 0.45 <= least(plan) < 0.4501
    assert plan.certificate is not None
    assert plan.certificate["second link's cosine"].status == "proven"
    assert least(planner.solve(fast, "polynomial")) < 0.45  # a law chooses its travel by it
    assert least(planner.solve(problem, "polynomial")) >= 0.45
    away = {"start.theta_deg": [28, 30, 30], "limits.folded": 0.52, "goal.theta_deg": [1, 9, 35]}
    with pytest.raises(planner.InfeasibleError, match="from the limit on second link's cosine"):
        planner.solve(paper.changed(away), "desensitised", backoff=1.0)
    assert least(planner.solve(problem, "convex")) >= 0.45  # by luck: it promises nothing
    law = problem.with_travel(planner.solve(fast, "polynomial").travel)
    with pytest.raises(
        planner.VerificationError, match="which the polynomial method does not promise"
    ):
        planner.solve(law, "polynomial")
    (change,) = (c for c in path_changes(problem) if "limits.folded" in c.keys)
    assert problem.changed(change.keys).registered_limits == ()
    (folded,) = problem.registered_limits
    (part,) = folded.parts
    broken = planner.Violation(part, 0.4, 0.45, 1.0, folded)
    assert Folded.easing([broken]) == ("wider limits.folded: second link's cosine at most 0.3996")
    with pytest.raises(InputError, match=r"cosine .* 0\.5, .* 0\.6"):
        paper.changed({"limits.folded": 0.6})


# -- entry points ------------------------------------------------------------------------------


@pytest.fixture
def entries(clean: None, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def put(**named: str) -> None:
        found = [EntryPoint(name, what, plugins.GROUP) for name, what in named.items()]
        monkeypatch.setattr(plugins, "entry_points", lambda group: found)

    return put


calls: list[str] = []


def reads_a_problem() -> None:
    planner.load_problem(ROOT / "problems/unicycle.toml")
    calls.append("read")


def fails() -> None:
    raise RuntimeError("no\x07 licence")


def leaves() -> None:
    raise SystemExit(3)


def says_nothing() -> None:
    raise Mute


def test_a_plugin_is_called_once(entries: Callable[..., None]) -> None:
    entries(one=f"{__name__}:reads_a_problem")
    calls.clear()
    for _ in range(2):
        planner.load_problem(ROOT / "problems/car.toml")
    assert calls == ["read"]


def test_a_plugin_that_fails_is_named_each_time(
    entries: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    entries(
        b=f"{__name__}:fails",
        a="nowhere_to_be_found:x",
        c=f"{__name__}:leaves",
        d=f"{__name__}:says_nothing",
    )
    for _ in range(2):
        with pytest.raises(InputError) as refused:
            planner.load_problem(ROOT / "problems/car.toml")
        first, second, third, fourth = str(refused.value).splitlines()
        assert first.startswith("plugin 'a' of a package (nowhere_to_be_found:x) failed: ModuleNot")
        assert f"'b' of a package ({__name__}:fails) failed: RuntimeError: no licence;" in second
        assert third.startswith("plugin 'c'")
        assert f"'d' of a package ({__name__}:says_nothing) failed: Mute;" in fourth
    assert main(["methods"]) == 2
    assert "plugin 'b'" in capsys.readouterr().err


# -- what goes wrong in them -------------------------------------------------------------------


def breaks_down(problem: planner.Problem, options: Options) -> planner.Plan:
    print("nobody asked for this")
    raise ZeroDivisionError("no\x07 way")


def refuses_input(problem: planner.Problem, options: Options) -> planner.Plan:
    raise InputError("'goal.duration' = 20: too long for mine")


def exits(problem: planner.Problem, options: Options) -> planner.Plan:
    sys.exit(0)


class Mute(BaseException):
    """One that says nothing, and that few catch."""

    def __str__(self) -> str:
        raise ValueError("no words")


def drops_out(problem: planner.Problem, options: Options) -> planner.Plan:
    raise Mute


def plans_nothing(problem: planner.Problem, options: Options) -> Any:
    return None


def plans_another(problem: planner.Problem, options: Options) -> planner.Plan:
    return planner.solve(problem.changed({"goal.duration": 22.0}), "polynomial")


def junk(**fields: Any) -> Callable[..., planner.Plan]:
    def plan(problem: planner.Problem, options: Options) -> planner.Plan:
        return replace(planner.solve(problem, "polynomial"), **fields)

    return plan


class Shaky:
    """A trajectory by its looks alone."""

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "state"}


def undecided(*_: Any) -> Any:
    return "perhaps"


BREAKDOWNS: list[tuple[Any, str]] = [
    (breaks_down, "failed: ZeroDivisionError: no way"),
    (refuses_input, "failed: InputError: 'goal.duration' = 20: too long for mine"),
    (exits, "failed: SystemExit: 0"),
    (drops_out, "failed: Mute"),
    (plans_nothing, "returned None, which is not a plan"),
    (plans_another, "returned a plan of another problem"),
    (junk(objective="high"), "returned a plan that cannot be saved"),
    (junk(notes=None), "returned a plan that cannot be saved: its plan: 'notes' = None"),
    (junk(compensation="much"), "failed: AttributeError"),
    (junk(trajectory=Shaky()), "returned a plan that cannot be saved"),
    (junk(trajectory=None), "failed: AttributeError"),
]


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(("plan", "says"), BREAKDOWNS, ids=[s for _, s in BREAKDOWNS])
def test_a_method_that_breaks_down_is_a_row_that_names_its_package(
    paper: planner.Problem, plan: Any, says: str, tmp_path: Path
) -> None:
    paper = paper.changed({"goal.duration": 20, "goal.travel": 0.8286})
    register(plan=plan)
    named = f"method 'mine' of module {__name__} {says}"
    with pytest.raises(planner.MethodError, match=re.escape(named)):
        planner.solve(paper, "mine")
    if plan not in (breaks_down, plans_another):  # all that follows asks the same function
        return
    found = planner.compare(paper, ["mine", "polynomial"], samples=2)
    assert [row.solved for row in found.rows] == [False, True]
    assert found.rows[0].why.startswith(named)
    (outcome,) = planner.check(paper, ["mine"]).outcomes
    assert (outcome["method"], outcome["status"]) == ("mine", "method_failed")
    tables = {"problem": paper.to_dict(), "methods": ["mine"], "grid": {"goal.duration": [20, 21]}}
    outcome = planner.run_sweep(tables, tmp_path / "x.sqlite", workers=0)
    assert outcome.statuses == {"method_failed": 2}
    assert outcome.bugs == 0
    (row, _) = planner.load_sweep(tmp_path / "x.sqlite").to_dict("records")
    assert row["why"].startswith(named)


@pytest.mark.usefixtures("clean")
def test_what_a_method_claims_of_its_plan_counts_for_nothing(paper: planner.Problem) -> None:
    register(plan=junk(verified=True, status="singular"))
    assert not planner.solve(paper.changed({"goal.duration": 20}), "mine").verified


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize("keeps", [undecided, lambda *_: 1 / 0])
def test_what_a_method_keeps_may_break_down_too(paper: planner.Problem, keeps: Any) -> None:
    paper = paper.changed({"goal.duration": 20})
    register(keeps=keeps)
    with pytest.raises(planner.MethodError, match=f"'mine' of module {__name__} (keeps|failed)"):
        planner.solve(paper, "mine")
    assert planner.check(paper, ["mine", "polynomial"]).has_plan


@pytest.mark.usefixtures("clean")
def test_a_bug_of_planner_stays_one(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = replace(METHODS["polynomial"], plan=breaks_down)
    monkeypatch.setitem(METHODS, "polynomial", broken)
    with pytest.raises(ZeroDivisionError):
        planner.compare(paper, ["polynomial"], samples=2)


LOUD = """
import os, subprocess
import planner
from planner.support.user_tables import Table

class Options(Table):
    often: int = 1

def plan(problem, options):
    print("printed")
    os.write(1, b"written\\n")
    subprocess.run(["echo", "by another process"])
    raise ZeroDivisionError

def register():
    print("loaded")
    planner.register_method("loud", plan, options=Options, summary="loud")
"""


@pytest.mark.skipif(os.name != "posix", reason="echo")
def test_what_a_plugin_prints_is_no_json(tmp_path: Path) -> None:
    (tmp_path / "loud_methods.py").write_text(LOUD, encoding="utf-8")
    info = tmp_path / "loud_methods-1.2.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text("[planner.plugins]\nloud = loud_methods:register\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: loud-methods\nVersion: 1.2\n")
    commands = [["plan", "-m"], ["compare", "-n", "2", "--methods"]]
    calls = [[*words, "loud", str(PAPER), "--json"] for words in commands]
    script = f"from planner.cli.app import main; print([main(words) for words in {calls}])"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    *answers, statuses = re.split(r"\n(?=[{[])", done.stdout.strip())
    assert [json.loads(answer)["exit_status"] for answer in answers] == json.loads(statuses)
    assert json.loads(statuses) == [3, 3]
    for answer in answers:
        assert "method 'loud' of loud-methods 1.2 failed: ZeroDivisionError" in answer
    said = done.stderr.splitlines()
    assert said.count("loaded") == 1
    assert [said.count(s) for s in ("printed", "written", "by another process")] == [2, 2, 2]
