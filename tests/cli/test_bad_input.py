"""Bad input of many kinds: the right status, one clear message, nothing half-written."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

THETA_START = "[start]\ntheta_deg = [1, 1, 1]"
THETA_GOAL = "[goal]\ntheta_deg = [30, 30, 30]"
TRAVEL = 'travel = "free"  '
DURATION = "duration = 10.0"
LIMITS = "[limits]"
END = "z2_margin = 0.01"
POLYNOMIAL = ["--method", "polynomial"]


@dataclass(frozen=True)
class Case:
    """Edits to the paper's file, further words, and what the message must hold."""

    name: str
    says: tuple[str, ...]
    edits: dict[str, str] = field(default_factory=dict)
    words: tuple[str, ...] = ()
    status: int = 2


BAD = [
    Case("missing table", ("missing key 'goal'",), {f"{THETA_GOAL}\n": "[limits.x]\n"}),
    Case("no system", ("missing key 'system.kind'",), {'kind = "manipulator"': ""}),
    Case(
        "unknown kind",
        ("'system.kind' = 'manipulater'", "did you mean 'manipulator'?"),
        {'"manipulator"': '"manipulater"'},
    ),
    Case(
        "unknown key",
        ("unknown key 'goal.duratoin'", "did you mean 'duration'?", "allowed: "),
        {DURATION: "duratoin = 10.0"},
    ),
    Case("unknown table", ("unknown key 'limit'", "did you mean 'limits'?"), {LIMITS: "[limit]"}),
    Case(
        "key in the wrong table",
        ("unknown key 'limits.duration'", "it belongs to [goal]"),
        {END: "duration = 3.0"},
    ),
    Case(
        "wrong type",
        ("'goal.duration' = 'ten'", "must be 'free' or a number"),
        {DURATION: 'duration = "ten"'},
    ),
    Case("number as text", ("'start.theta_deg[0]' = '1'",), {"[1, 1, 1]": '["1", 1, 1]'}),
    Case(
        "list for a number",
        ("'goal.duration' = [10.0]", "must be 'free' or a number"),
        {DURATION: "duration = [10.0]"},
    ),
    Case("number for a list", ("'start.theta_deg' = 1", "a list"), {"[1, 1, 1]": "1"}),
    Case("table for a number", ("'system.k_g'", "a number"), {"k_g = 0.668811": "k_g = {}"}),
    Case("true as number", ("'goal.duration' = True",), {DURATION: "duration = true"}),
    Case("true as angle", ("'start.theta_deg[1]' = True",), {"[1, 1, 1]": "[1, true, 1]"}),
    Case("fraction for a count", ("'system.joints' = 3.5",), {"joints = 3": "joints = 3.5"}),
    Case("nan", ("'goal.travel' = nan", "a finite number"), {TRAVEL: "travel = nan"}),
    Case("infinite", ("'goal.duration' = inf", "finite"), {DURATION: "duration = inf"}),
    Case("nan angle", ("'goal.theta_deg[2]' = nan",), {"[30, 30, 30]": "[30, 30, nan]"}),
    Case(
        "degrees for radians",
        ("'goal.travel' = 45", "radians", "looks like degrees"),
        {TRAVEL: "travel = 45"},
    ),
    Case(
        "angles without their unit",
        ("unknown key 'start.theta'", "did you mean 'theta_deg'?"),
        {THETA_START: "[start]\ntheta = [1, 1, 1]"},
    ),
    Case(
        "angle of 90 degrees",
        ("'goal.theta_deg[1]' = 90", "less than 90"),
        {"[30, 30, 30]": "[30, 90, 30]"},
    ),
    Case(
        "angle below -90 degrees",
        ("'start.theta_deg[0]' = -100", "greater than -90"),
        {"[1, 1, 1]": "[-100, 1, 1]"},
    ),
    Case("negative duration", ("'goal.duration' = -10.0", "0"), {DURATION: "duration = -10.0"}),
    Case("no duration at all", ("'goal.duration' = 0",), {DURATION: "duration = 0"}),
    Case(
        "fewer angles than joints",
        ("start.theta_deg has 2 angles", "system.joints = 3"),
        {"[1, 1, 1]": "[1, 1]"},
    ),
    Case("too few K", ("joints = 3 needs 2 values in K", "not 1"), {"K = [0.870125, ": "K = ["}),
    Case("no joint to plan", ("'system.joints' = 1", "at least 2"), {"joints = 3": "joints = 1"}),
    Case("negative K", ("'system.K[0]' = -0.87",), {"0.870125": "-0.87"}),
    Case("K without k_g", ("K needs k_g",), {"k_g = 0.668811": ""}),
    Case(
        "both K and gear",
        ("give either K (with k_g) or gear",),
        {"k_g = 0.668811": "gear = { r1 = 1, R = 1, r3 = 1, lambda = 1, eta = 1 }"},
    ),
    Case(
        "gear misspelt",
        ("unknown key 'system.gear.lam'", "did you mean 'lambda'?"),
        {
            "K = [0.870125, 0.711625]": "gear = { r1 = 1, R = 1, r3 = 1, lam = 1, eta = 1 }",
        },
    ),
    Case(
        "three limits for two inputs",
        ("'limits.input_rad_s'", "has 3 values", "2 inputs"),
        {"[0.5, 0.5]": "[0.5, 0.5, 0.5]"},
    ),
    Case("negative limit", ("'limits.input_rad_s[1]' = -0.5",), {"[0.5, 0.5]": "[0.5, -0.5]"}),
    Case(
        "joint limit of 90", ("'limits.joint_deg' = 90", "90"), {"joint_deg = 80": "joint_deg = 90"}
    ),
    Case(
        "goal outside its limit",
        ("contradiction", "goal theta1 = 30 deg", "limit of 20 deg", "widen the limit"),
        {"joint_deg = 80": "joint_deg = 20"},
    ),
    Case(
        "z2 margin wider than z2",
        (
            "contradiction",
            "z2 at the start is -0.0324",
            "lower limits.z2_margin to 0.0321, or leave it out",
        ),
        {END: "z2_margin = 0.1"},
    ),
    Case(
        "unknown preset",
        ("'machine.preset' = 'toy'", "'ideal'"),
        {END: '[machine]\npreset = "toy"'},
    ),
    Case(
        "point after the end",
        ("method.polynomial.points", "time 12 s", "(0, 10) s"),
        {END: "[method.polynomial]\npoints = [[12.0, -0.2]]"},
    ),
    Case(
        "two points at one time",
        ("method.polynomial.points", "two points at one time"),
        {END: "[method.polynomial]\npoints = [[5.0, -0.2], [5.0, -0.3]]"},
    ),
    Case(
        "point without a value",
        ("'method.polynomial.points[0]' = [5.0]", "2 values, not 1"),
        {END: "[method.polynomial]\npoints = [[5.0]]"},
    ),
    Case(
        "unknown option",
        ("unknown key 'method.polynomial.ponits'", "did you mean 'points'?"),
        {END: "[method.polynomial]\nponits = [[5.0, -0.2]]"},
    ),
    Case(
        "unknown method",
        ("unknown method 'polynomal'", "did you mean 'polynomial'?"),
        words=("--method", "polynomal"),
    ),
    Case("set without a value", ("--set goal.travel", "key=value"), words=("--set", "goal.travel")),
    Case("set without a key", ("--set =3", "key=value"), words=("--set", "=3")),
    Case(
        "set with a broken list",
        ("--set start.theta_deg=[1,", "cannot read the value"),
        words=("--set", "start.theta_deg=[1,"),
    ),
    Case(
        "set with two values",
        ("cannot read the value",),
        words=("--set", "goal.travel=1\ngoal.duration=3"),
    ),
    Case(
        "set of an unknown key",
        ("unknown key 'goal.travle'", "did you mean 'travel'?", "from --set"),
        words=("--set", "goal.travle=0.8"),
    ),
    Case(
        "set inside a number",
        ("cannot set 'goal.duration.x'", "'duration' is not a table"),
        words=("--set", "goal.duration.x=1"),
    ),
    Case(
        "set of a bad value",
        ("'goal.duration' = -1", "from --set: goal.duration"),
        words=("--set", "goal.duration=-1"),
    ),
    Case("unknown command option", ("No such option", "--methd"), words=("--methd", "polynomial")),
    Case(
        "duration too short for the limits",
        ("no plan of any kind exists", "theta3 must move 29 deg", "2.127 s", "Try:"),
        {DURATION: "duration = 2.0"},
        status=3,
    ),
    Case(
        "start on the singularity",
        ("the start has theta2 = 0", "singular", "Try:", "collocation"),
        {"[1, 1, 1]": "[1, 0, 1]", END: ""},
        status=3,
    ),
    Case(
        "joint changes sign",
        ("theta1 changes sign", "Try:", "collocation"),
        {"[1, 1, 1]": "[-1, 1, 1]", END: ""},
        status=3,
    ),
    Case(
        "unreachable travel",
        ("leaves the domain of the chained-form chart at t = ", "z2 = 0 at t = ", "Try:"),
        {TRAVEL: "travel = 0.7"},
        status=3,
    ),
    Case(
        "passive joints part ways",
        ("no motion without reversal exists", "opposite directions", "Try:"),
        {"[30, 30, 30]": "[30, 0.5, 30]", END: ""},
        status=3,
    ),
]


def tree(folder: Path) -> dict[str, str]:
    """Every file below the folder with its text."""
    return {
        str(p.relative_to(folder)): p.read_text(encoding="latin-1") if p.is_file() else ""
        for p in folder.rglob("*")
    }


@pytest.mark.parametrize("case", BAD, ids=lambda c: c.name)
def test_bad_problem_or_option(
    case: Case, run: Callable, edited: Callable[[dict[str, str]], Path], tmp_path: Path
) -> None:
    path = edited(case.edits)
    before = tree(tmp_path)
    words = ["plan", path, *POLYNOMIAL, "--out", tmp_path / "plan.json", *case.words]
    people = run(*words)
    assert people.status == case.status
    assert people.out == ""
    for piece in case.says:
        assert piece in people.err
    if not case.words:
        assert str(path) in people.err
    assert "Traceback" not in people.err
    assert "pydantic" not in people.err
    machine = run(*words, "--json")
    assert machine.status == case.status
    assert machine.json["exit_status"] == case.status
    for piece in case.says:
        assert piece in machine.json["error"]
    assert tree(tmp_path) == before


def write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


FILES: list[tuple[str, Callable[[Path], Path], str]] = [
    ("missing", lambda d: d / "none.toml", r"cannot read .*none\.toml: No such file"),
    ("folder", lambda d: d, r"cannot read .*: Is a directory"),
    ("below a file", lambda d: write(d / "f", b"") / "p.toml", r"cannot read .*: Not a directory"),
    ("empty", lambda d: write(d / "e.toml", b""), r"e\.toml is empty; a problem needs \[system\]"),
    ("binary", lambda d: write(d / "b.toml", b"\x80\xff\x00PNG"), r"b\.toml is not a text file"),
    ("zeros", lambda d: write(d / "z.toml", b"\x00" * 100), r"z\.toml is not valid TOML.*line 1"),
    ("prose", lambda d: write(d / "p.toml", b"dear planner"), r"p\.toml is not valid TOML.*line 1"),
    (
        "json",
        lambda d: write(d / "p.json", b'{"system": 1}'),
        r"p\.json is JSON, such as a plan; a problem file is TOML",
    ),
    (
        "key twice",
        lambda d: write(d / "t.toml", b"title = 'a'\ntitle = 'b'"),
        r"t\.toml is not valid TOML: Cannot overwrite",
    ),
    ("number only", lambda d: write(d / "n.toml", b"system = 3"), r"missing key 'system\.kind'"),
]


@pytest.mark.parametrize(("make", "says"), [f[1:] for f in FILES], ids=[f[0] for f in FILES])
@pytest.mark.parametrize("command", ["plan", "check", "compare"])
def test_file_that_is_no_problem_file(
    command: str, make: Callable[[Path], Path], says: str, run: Callable, tmp_path: Path
) -> None:
    path = make(tmp_path)
    before = tree(tmp_path)
    people = run(command, path)
    assert people.status == 2
    assert people.out == ""
    assert re.search(says, people.err)
    assert "Traceback" not in people.err
    machine = run(command, path, "--json")
    assert machine.status == 2
    assert machine.json["status"] == "bad_input"
    assert re.search(says, machine.json["error"])
    assert tree(tmp_path) == before


PLACES: list[tuple[str, str, str]] = [
    ("missing folder", "none/plan.json", r"there is no folder .*none; make it first"),
    ("below a file", "file/plan.json", r"file is a file, not a folder"),
    ("a folder", "folder", r"folder: it is a folder; name a file in it"),
]


@pytest.mark.parametrize(("place", "says"), [p[1:] for p in PLACES], ids=[p[0] for p in PLACES])
def test_place_where_no_plan_can_be_written(
    place: str, says: str, run: Callable, edited: Callable, tmp_path: Path
) -> None:
    path = edited({})
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    before = tree(tmp_path)
    people = run("plan", path, *POLYNOMIAL, "--out", tmp_path / place)
    assert people.status == 2
    assert re.search(says, people.err)
    assert "no plan (" not in people.err, "the place must be refused before the work"
    assert run("plan", path, "--out", tmp_path / place, "--json").json["exit_status"] == 2
    assert tree(tmp_path) == before


def test_folder_that_holds_other_work_is_kept(
    run: Callable, edited: Callable, tmp_path: Path
) -> None:
    path = edited({})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").touch()
    before = tree(tmp_path)
    result = run("compare", path, "--out", tmp_path / "mine")
    assert result.status == 2
    assert "mine holds files that are not from an earlier run; name another folder" in result.err
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--samples", "-5"], "--samples"),
        (["--samples", "0"], "--samples"),
        (["--samples", "many"], "--samples"),
        (["--seed", "-1"], "--seed"),
        (["--methods", "polynomial,colocation"], "unknown method 'colocation'"),
        (["--methods", ""], "''"),
        (["--methods", "polynomial,polynomial"], "twice"),
        (["--methods", "polynomial:travle=middle"], "travle"),
    ],
)
def test_bad_numbers_and_methods_of_compare(
    words: list[str], says: str, run: Callable, edited: Callable, tmp_path: Path
) -> None:
    path = edited({})
    before = tree(tmp_path)
    result = run("compare", path, "--out", tmp_path / "out", *words)
    assert result.status == 2
    assert says in result.err
    assert result.out == ""
    assert run("compare", path, *words, "--json").json["exit_status"] == 2
    assert tree(tmp_path) == before


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_methods_of_check(words: list[str], run: Callable, edited: Callable) -> None:
    assert run("check", edited({}), "--methods", "polynomal", *words).status == 2
    result = run("check", edited({}), "--methods", ",", *words)
    assert result.status == 2
    assert "names no method" in result.err


def test_angles_that_look_like_radians_are_legal_but_told(run: Callable, edited: Callable) -> None:
    short = {DURATION: "duration = 0.01", END: ""}  # refused before any method tries
    small = {"[1, 1, 1]": "[0.2, 0.2, 0.2]", "[30, 30, 30]": "[0.5, 0.5, 0.5]"}
    result = run("plan", edited(short | small), *POLYNOMIAL, "--json")
    warnings = [line for line in result.err.splitlines() if line.startswith("warning: ")]
    assert len(warnings) == 1
    assert "write them in degrees" in warnings[0]
    assert result.json["status"] == "infeasible"
    assert "warning" not in run("plan", edited(short), *POLYNOMIAL).err
