"""Bad input of many kinds: the right status, one clear message, nothing half-written."""

from __future__ import annotations

import os
import shlex
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest

PROBLEMS = Path(__file__).parents[2] / "problems"
PAPER = (PROBLEMS / "paper.toml").read_text(encoding="utf-8")
CUSTOM = (PROBLEMS / "custom.toml").read_text(encoding="utf-8")
POLYNOMIAL = ["--method", "polynomial", "--out", "plan.json"]
DURATION, START, GOAL = "duration = 10.0", "[1, 1, 1]", "[30, 30, 30]"
TRAVEL, INPUTS, END = 'travel = "free"  ', "[0.5, 0.5]", "z2_margin = 0.01"
K, K_G = "K = [0.870125, 0.711625]", "k_g = 0.668811"
GEAR = "gear = { r1 = 1, R = 1, r3 = 1, lambda = 1, eta = 1 }"
POINTS = "[method.polynomial]\npoints = "

Case = tuple[str, ...]
"""What of the paper's file becomes what, and what the message must say."""

BAD: list[Case] = [
    ("[goal]\ntheta_deg = [30, 30, 30]\n", "[limits.x]\n", "missing key 'goal'"),
    ('kind = "manipulator"', "", "missing key 'system.kind'"),
    ('"manipulator"', '"manipulater"', "'system.kind' = 'manipulater'", "mean 'manipulator'?"),
    (DURATION, "duratoin = 1", "'goal.duratoin'", "did you mean 'duration'?", "allowed: "),
    ("[limits]", "[limit]", "unknown key 'limit'", "did you mean 'limits'?"),
    (DURATION, "duration = [10.0]", "'goal.duration' = [10.0]", "must be 'free' or a number"),
    (DURATION, "duration = 0", "'goal.duration' = 0"),
    (START, "[1, true, 1]", "'start.theta_deg[1]' = True"),
    (START, "[-100, 1, 1]", "'start.theta_deg[0]' = -100", "greater than -90"),
    (START, "[1, 1]", "start.theta_deg has 2 angles", "system.joints = 3"),
    (GOAL, "[30, 90, 30]", "'goal.theta_deg[1]' = 90", "less than 90"),
    ("joints = 3", "joints = 1", "'system.joints' = 1", "at least 2"),
    (K, "K = [-0.87, 0.7]", "'system.K[0]' = -0.87"),
    (K, GEAR.replace("lambda", "lam"), "unknown key 'system.gear.lam'", "mean 'lambda'?"),
    (K_G, "k_g = {}", "'system.k_g'", "a number"),
    (K_G, GEAR, "give either K (with k_g) or gear"),
    (INPUTS, "[0.5, 0.5, 0.5]", "'limits.input_rad_s'", "has 3 values", "2 inputs"),
    (INPUTS, "[0.5, -0.5]", "'limits.input_rad_s[1]' = -0.5"),
    ("joint_deg = 80", "joint_deg = 90", "'limits.joint_deg' = 90"),
    (
        "joint_deg = 80",
        "joint_deg = 20",
        "contradiction",
        "goal theta1 = 30 deg",
        "widen limits.joint_deg",
    ),
    (END, f"{POINTS}[[10.0, -0.2]]", "method.polynomial.points", "time 10 s", "(0, 10) s"),
    (END, f"{POINTS}[[5.0, -0.2], [5.0, -0.3]]", "points", "two points at one time"),
    (END, "[method.polynomial]\nponits = 1", "'method.polynomial.ponits'", "mean 'points'?"),
    # numbers and texts that are hostile
    (DURATION, "duration = " + "1" * 5000, "digits"),
    (DURATION, "duration = 0x" + "f" * 5000, "digits"),
    (DURATION, "duration = 1e308", "too large"),
    (DURATION, "duration = 2020-01-01", "'goal.duration' = datetime"),
    (DURATION, r'"\u001b[31mred\u009b2J\u0007\u202e" = 1', "unknown key 'goal."),
    (K_G, "k_g = 1e308", "'system.k_g' = 1e+308: too large"),
    (K_G, "k_g = 1e-308", "'system.k_g' = 1e-308: too small"),
    (K_G, "k_g = -0.0", "'system.k_g' = -0.0"),
    (INPUTS, "[5e-324, 0.5]", "rad_s[0]'", "too small"),
    (END, "\n[" + "a." * 60 + "b]\n", "nested too deeply"),
    (END, "".join(f"\n[x{k}]\na = 1" for k in range(20_000)), "key 'x0'", "and 19990 more errors"),
]
NO_PLAN: list[Case] = [
    (
        DURATION,
        "duration = 2.0",
        "no plan of any kind exists",
        "theta3 must move 29 deg",
        "2.127 s",
    ),
    (START, "[1, 0, 1]", "the start has theta2 = 0", "singular", "collocation"),
    (START, "[-1, 1, 1]", "theta1 changes sign", "collocation"),
    (TRAVEL, "travel = 0.7", "leaves the domain of the chained-form chart at t", "z2 = 0 at t ="),
    (GOAL, "[30, 8, 30]", "does not promise to keep", "joint theta3 reaches 114", "collocation"),
]


def slopes(last: str) -> str:
    return CUSTOM.replace('slopes = ["tan(heading)", "y"]', f'slopes = ["tan(heading)", "{last}"]')


FILES: dict[str, tuple[str | bytes, Case]] = {
    "empty": ("", ("mine.toml is empty; a problem needs [system]",)),
    "binary": (b"\x80\xff\x00PNG", ("mine.toml is not a text file",)),
    "zeros": (b"\x00" * 100, ("mine.toml is not valid TOML", "line 1")),
    "prose": ("dear planner", ("mine.toml is not valid TOML", "line 1")),
    "json": ('{"system": 1}', ("mine.toml is JSON, such as a plan; a problem file is TOML",)),
    "key twice": ("title = 'a'\ntitle = 'b'", ("is not valid TOML: Cannot overwrite",)),
    "number only": ("system = 3", ("missing key 'system.kind'",)),
    "lone surrogate": ('title = "\\ud800"\n' + PAPER, ("not valid TOML",)),
    "brackets 100,000 deep": ("a = " + "[" * 100_000 + "]" * 100_000, ("nested too deeply",)),
    "key of 100,000 parts": ("a" + ".a" * 100_000 + " = 1", ("more than 100 parts",)),
    "600 terms": (slopes("y" + " + 1e-3*y" * 600), ("too many terms",)),
    "100,000 terms": (slopes("y" + "+y" * 100_000), ("slopes[1]: 'y+y+y",)),
    "number of 400 digits in an expression": (slopes("y + " + "1" * 400), ("hundreds of digits",)),
    "interval of the whole line": (
        CUSTOM.replace("[-3.0, 3.0]", "[-1e14, 1e308]"),
        ("'system.intervals.y[1]' = 1e+308: too large",),
    ),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to be in, with a problem, a sweep, a design study and other people's work."""
    monkeypatch.chdir(tmp_path)
    for name in ("paper.toml", "sweeps/paper-travel.toml", "designs/gear-ratios.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(PROBLEMS / name, tmp_path / name)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work", encoding="utf-8")
    (tmp_path / "plan.json").write_text("{}", encoding="utf-8")
    return tmp_path


def refuse(refused: Callable, path: Path, *says: str, status: int = 2) -> None:
    began = time.process_time()
    refused(["plan", path, *POLYNOMIAL], str(path), *says, status=status)
    assert time.process_time() - began < 8  # two are promised; this runs twice, beside other tests


@pytest.mark.parametrize("case", BAD, ids=lambda case: case[1][:30])
def test_bad_problem(case: Case, refused: Callable, here: Path) -> None:
    old, new, *says = case
    assert PAPER.count(old) == 1
    (here / "mine.toml").write_text(PAPER.replace(old, new), encoding="utf-8")
    refuse(refused, here / "mine.toml", *says)


@pytest.mark.parametrize("case", NO_PLAN, ids=lambda case: case[1])
def test_problem_without_a_plan(case: Case, refused: Callable, here: Path) -> None:
    old, new, *says = case
    (here / "mine.toml").write_text(PAPER.replace(old, new).replace(END, ""), encoding="utf-8")
    refuse(refused, here / "mine.toml", *says, "Try:", status=3)


@pytest.mark.parametrize("name", FILES)
def test_file_that_is_no_problem_file(name: str, refused: Callable, here: Path) -> None:
    text, says = FILES[name]
    data = text if isinstance(text, bytes) else text.encode()
    (here / "mine.toml").write_bytes(data)
    refuse(refused, here / "mine.toml", *says)


LONG, ARMS = "n" * 300, "an arm here has 2 to 8 joints"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("plan none.toml", "cannot read none.toml: No such file"),
        ("plan .", "cannot read .: Is a directory"),
        ("check paper.toml/p.toml", "cannot read paper.toml/p.toml: Not a directory"),
        ("plan paper.toml --method polynomal", "'polynomal'; did you mean 'polynomial'?"),
        ("plan paper.toml --methd polynomial", "No such option: --methd"),
        ("compare paper.toml --by foo", "'--by': 'foo' is not one of"),
        ("plan paper.toml --set goal.travel", "--set goal.travel: write it as key=value"),
        ("plan paper.toml --set =3", "--set =3: write it as key=value"),
        ("plan paper.toml --set start.theta_deg=[1,", "cannot read the value"),
        ("plan paper.toml --set 'goal.travel=1\ngoal.duration=3'", "cannot read the value"),
        ("plan paper.toml --set goal.travle=0.8", "did you mean 'travel'?"),
        ("plan paper.toml --set goal.travle=0.8", "from --set"),
        ("plan paper.toml --set goal.duration.x=1", "'duration' is not a table"),
        ("plan paper.toml --set goal.duration=-1", "from --set: goal.duration"),
        ("plan paper.toml --set limits.joint_deg=5", "from --set: limits.joint_deg"),
        ("plan paper.toml --set goal.duration=1e308", "too large"),
        (f"plan paper.toml --set goal.travel={'[' * 3000}", "--set goal.travel="),
        (f"plan paper.toml --set goal.duration={'1' * 5000}", "--set goal.duration="),
        (f"plan paper.toml --set {'a.' * 3000}b=1", "--set a.a."),
        ("plan paper.toml --out paper.toml/plan.json", "paper.toml is a file, not a folder"),
        ("plan paper.toml --out mine", "mine: it is a folder; name a file in it"),
        ("plan plan.json", "plan.json is JSON, such as a plan; a problem file is TOML"),
        ("check paper.toml --methods polynomal", "did you mean 'polynomial'?"),
        ("check paper.toml --methods ,", "unknown method ''"),
        ("compare paper.toml --out mine", "mine holds files that are not from an earlier run"),
        ("compare paper.toml --samples -5", "--samples"),
        ("compare paper.toml --samples 0", "--samples"),
        ("compare paper.toml --samples many", "--samples"),
        ("compare paper.toml --samples 1000000000", "at most 1000000 machines"),
        (f"compare paper.toml --samples {'9' * 30}", "at most 1000000 machines"),
        ("compare paper.toml --seed -1", "--seed"),
        ("compare paper.toml --methods polynomial,colocation", "unknown method 'colocation'"),
        ("compare paper.toml --methods ''", "''"),
        ("compare paper.toml --methods polynomial,polynomial", "twice"),
        ("compare paper.toml --methods polynomial:travle=middle", "travle"),
        (
            "budget paper.toml --methods polynomial -n 2 --base 100",
            "base = 100: must be a power of 2",
        ),
        (
            "budget plan.json --methods polynomial",
            "--methods: for a problem, but plan.json is named",
        ),
        (
            "budget plan.json --set goal.duration=3 --set machine.seed=1",
            "--set goal.duration: for a problem, but plan.json is named as a plan",
        ),
        ("export paper.toml -o y.csv", "paper.toml is not JSON"),
        ("export paper.toml -o y.csv", "`planner plan PROBLEM --out FILE` writes a plan file"),
        ("sensitivity none.json", "cannot read none.json"),
        ("sensitivity plan.json", "is not a plan file"),
        (
            "sensitivity plan.json --set goal.duration=3",
            "--set: for a problem, but plan.json is named as a plan",
        ),
        ("sensitivity plan.json --points 4", "--points: for a problem, but plan.json is named"),
        ("sensitivity paper.toml --out mine", "mine holds files"),
        ("sensitivity paper.toml --pareto effort", "--out"),
        ("sensitivity paper.toml --pareto money --out x", "money"),
        ("schema swep", "did you mean 'sweep'"),
        ("sweep none.toml", "cannot read none.toml"),
        ("sweep sweeps/paper-travel.toml --export out.txt", "must end in .csv or .parquet"),
        ("sweep sweeps/paper-travel.toml --export plan.json/out.csv", "is a file, not a folder"),
        ("sweep sweeps/paper-travel.toml --db plan.json/x.sqlite", "is a file, not a folder"),
        ("sweep sweeps/paper-travel.toml --db plan.json", "cannot use the database"),
        ("sweep sweeps/paper-travel.toml --workers 0", "--workers"),
        ("design none.toml", "cannot read none.toml"),
        ("design designs/gear-ratios.toml --out paper.toml", "is a file; name a folder"),
        ("design designs/gear-ratios.toml --workers 0", "--workers"),
        ("new mine/thesis.tex", "exists; name another file, or replace it with --force"),
        ("new x.toml --system tank", "no system 'tank'; allowed: manipulator"),
        ("new plan.json/x.toml", "is a file, not a folder"),
        ("new x.toml --system car --joints 3", "--joints is for manipulator, ball-gear; a car"),
        ("new x.toml --joints 1", f"--joints 1: {ARMS}"),
        ("new x.toml --joints 9", f"--joints 9: {ARMS}"),
        (f"plan paper.toml --out {LONG}", "File name too long"),
        (f"compare paper.toml --out {LONG}", "File name too long"),
        (f"calibrate --out {LONG}", "File name too long"),
        (f"new {LONG}", "File name too long"),
        (f"sweep sweeps/paper-travel.toml --db {LONG}", "File name too long"),
        ("plan 'no\x1b[31m\u202esuch.toml'", "cannot read"),
        ("plan '--no\x1b[31m'", "No such option"),
    ],
    ids=lambda text: text[:60].encode("unicode_escape").decode(),
)
def test_bad_words(words: str, says: str, refused: Callable, here: Path) -> None:
    refused(shlex.split(words), says)


READ = ["plan {}", "check {}", "compare {}", "sweep {}", "budget {}", "sensitivity {}"]
READ += ["export {} --out o.csv", "animate {} --out o.gif", "report folder"]
WRITE = ["plan {} --out", "compare {} --out", "calibrate --out", "new", "sweep {} --db"]


@pytest.mark.parametrize("command", READ)
def test_what_is_no_file_is_refused_before_reading(
    command: str, run: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pipe, a device, a link to itself, a folder, and a file of five gigabytes."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    os.symlink("/dev/zero", "zero")
    os.symlink("loop", "loop")
    with open("huge", "wb") as stream:
        stream.truncate(5 * 10**9)
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "zero", "loop", ".", "huge"):
        link = tmp_path / "folder/comparison.json"
        link.unlink(missing_ok=True)
        link.symlink_to(tmp_path / name)
        result = run(*command.format(name).split())
        assert result.status == 2
        assert result.err.count("\n") == 1
        assert "cannot read" in result.err


@pytest.mark.parametrize("command", WRITE)
def test_a_link_to_itself_is_no_place_to_write(command: str, run: Callable, here: Path) -> None:
    os.symlink("loop", "loop")
    before = sorted(here.iterdir())
    file = "sweeps/paper-travel.toml" if command.startswith("sweep") else "paper.toml"
    assert run(*command.format(file).split(), "loop").status == 2
    assert sorted(here.iterdir()) == before


def test_angles_that_look_like_radians_are_legal_but_told(run: Callable, tmp_path: Path) -> None:
    """Each command tells it once, not each process; in too short a time no method tries."""
    path = tmp_path / "small.toml"
    text = PAPER.replace(DURATION, "duration = 0.01").replace(END, "")
    path.write_text(text.replace(START, "[0.2, 0.2, 0.2]").replace(GOAL, "[0.5, 0.5, 0.5]"))
    for words in (("plan", "-m", "polynomial", "--json"), ("check", "--methods", "polynomial")):
        result = run(words[0], path, *words[1:])
        assert [line for line in result.err.splitlines() if "warning" in line] == [
            f"warning: {path}: all angles of start and goal are below 1.6 degrees; if they are"
            " meant in radians, write them in degrees"
        ]
    path.write_text(text)
    assert "warning" not in run("plan", path, "-m", "polynomial").err
