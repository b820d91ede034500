"""The instruments of the campaigns in `benchmarks/`, on few cases: they measure what they say.

No other file of the suite uses anything from there.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import planner
from planner import Machine, Problem
from planner.machine import compiled
from planner.report.result_folder import MARKER, folder
from planner.support.arrays import Array

sys.path += [str(Path(__file__).parent / name) for name in ("benchmarks", "installed")]

import bench_report
import collocation
import frameworks
import gallery
import identification
import legs
import replay
import results_pages as pages
import truths
from bench_cases import cases
from outside_judge import campaign


def test_an_answer_passes_only_if_its_inputs_lead_to_the_goal_within_limits(paper: Problem) -> None:
    outcome = collocation.ours(cases()[0])()
    goal, over = collocation.judged(paper, outcome)
    assert goal < collocation.GOAL_TOLERANCE
    assert over <= collocation.LIMIT_TOLERANCE
    astray = replace(outcome, inputs=1.001 * outcome.inputs)
    assert collocation.judged(paper, astray)[0] > collocation.GOAL_TOLERANCE
    narrow = paper.changed({"limits.input_rad_s": [0.5, 0.12]})
    assert collocation.judged(narrow, outcome)[1] > 0.01


@pytest.mark.parametrize(
    ("code", "picture"), list(gallery.blocks()), ids=[path.stem for _, path in gallery.blocks()]
)
def test_a_block_of_the_gallery_draws(
    code: str, picture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a smaller sample."""
    assert picture.exists()
    monkeypatch.chdir(gallery.PAGE.parents[1])
    figure = gallery.figure_of(
        re.sub(r"samples=\d+", "samples=10", code).replace("budget(plan,", "budget(plan, base=8,")
    )
    assert all(axes.has_data() for axes in figure.axes if axes.axison)


def test_there_are_ten_pictures_in_the_gallery() -> None:
    pictures = sorted(path for _, path in gallery.blocks())
    assert len(pictures) == 10
    assert pictures == sorted(pictures[0].parent.glob("*.png"))


def test_every_page_of_results_is_signed() -> None:
    folders = {path.name for path in pages.RESULTS.iterdir()}
    assert folders == set(pages.DEPENDENCIES)
    for name in folders:
        assert pages.SIGNATURE.search((pages.RESULTS / name / "README.md").read_text("utf-8"))
    for names in pages.DEPENDENCIES.values():
        assert all(pages._files(pages.ROOT, name) for name in names)


def test_a_fingerprint_changes_with_what_is_computed_alone(tmp_path: Path) -> None:
    file = tmp_path / "planner" / "one.py"
    file.parent.mkdir()
    kinds = {
        "plain": "def f(x: float) -> float:\n    return 2 * x\n",
        "words": 'def f(x: float) -> float:\n    """Twice x."""\n    return 2*x  # fast\n',
        "other": "def f(x: float) -> float:\n    return 3 * x\n",
    }
    found = {}
    for name, text in kinds.items():
        file.write_text(text, encoding="utf-8")
        found[name] = pages.fingerprint(["one.py"], tmp_path)
    assert found["plain"] == found["words"] != found["other"]


def test_a_fingerprint_is_the_same_on_every_python(tmp_path: Path) -> None:
    """CI runs this on each; others that are at hand read some of the code here."""
    file = tmp_path / "planner" / "one.py"
    file.parent.mkdir()
    text = (
        'class One:\n    def f(self, x=()):\n        return f"{x!r}" f"{x:{self}.3}" "" "é\u0378"\n'
    )
    file.write_text(text, encoding="utf-8")
    assert pages.fingerprint(["one.py"], tmp_path) == "a8715d7af483"
    code, here = "import results_pages as p; print(p.fingerprint(['report']))", ["report"]
    for python in filter(None, map(legs.interpreter, legs.declared())):
        words = [python, "-c", code]
        said = subprocess.run(words, cwd=pages.__file__.rpartition("/")[0], capture_output=True)
        assert said.stdout.decode().strip() == pages.fingerprint(here), python


def test_the_page_of_the_speed_says_which_aims_are_missed() -> None:
    folder = pages.RESULTS / "benchmarks"
    found = json.loads((folder / "numbers.json").read_text("utf-8"))
    said = bench_report._targets(found).split("- Convex")[0]
    assert said in (folder / "README.md").read_text("utf-8")
    ratios = found["contests"]["paper"]["planner"]["times_faster_than"]
    for ratio, words in ((5.0, "| 5.00 |"), (4.9, "| 4.90, missed |")):
        ratios["plain Radau + IPOPT"] = ratio
        assert words in bench_report._targets(found)


def test_a_page_is_signed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "RESULTS", tmp_path)
    path = tmp_path / "suite" / "README.md"
    path.parent.mkdir()
    path.write_text("# Suite\n", encoding="utf-8")
    pages.sign("suite", tmp_path)  # of a checkout without code
    assert pages.SIGNATURE.search(path.read_text("utf-8"))[1] != pages.fingerprint(
        pages.DEPENDENCIES["suite"]
    )  # type: ignore[index]
    pages.sign("suite")
    once = path.read_text("utf-8")
    pages.sign("suite")
    assert path.read_text("utf-8") == once
    assert once.startswith(
        "# Suite\n\n<small>Fingerprint `" + pages.fingerprint(pages.DEPENDENCIES["suite"])
    )


def test_a_folder_of_results_lists_its_files_and_the_next_run_replaces_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As git holds them; a page that was signed or edited is listed as it is then."""
    lists = sorted(pages.RESULTS.glob("*/" + MARKER))
    assert len(lists) == 10
    for path in lists:
        page = path.parent.name
        copy = tmp_path / page
        shutil.copytree(path.parent, copy)
        with folder(copy):
            pass
        assert [p.name for p in copy.iterdir()] == [MARKER], f"results_pages.py --list {page}"
    monkeypatch.setattr(pages, "RESULTS", tmp_path)
    with folder(tmp_path / "suite") as place:
        (place / "README.md").write_text("# Suite\n", encoding="utf-8")
    pages.sign("suite")
    with folder(tmp_path / "suite"):
        pass
    assert [p.name for p in (tmp_path / "suite").iterdir()] == [MARKER]


def test_frameworks_that_are_not_installed_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frameworks, "find_spec", lambda name: None if name == "mpopt" else name)
    assert frameworks.missing() == ["mpopt"]
    usable = ["rockit + IPOPT", "rockit + Fatrop", "do-mpc + IPOPT"]
    usable += ["Drake + SNOPT", "Drake + IPOPT"]
    assert list(frameworks.frameworks(cases()[0].arm)) == usable


def test_verify_and_load_plan_judge_as_an_integrator_from_outside_does(tmp_path: Path) -> None:
    """No false accept, no false refusal; and there is something of both to tell apart."""
    plans, damages = 3, 20
    tally, told = campaign(plans, damages, 25, tmp_path)
    assert not told
    assert tally["plans as they are", "both accept"] == plans
    for outcome in ("both accept", "both refuse", "no form"):
        assert sum(count for (_, each), count in tally.items() if each == outcome) >= damages / 10


@pytest.mark.skipif(
    shutil.which("cc") is None or compiled.library() is None, reason="needs a C compiler"
)
def test_ways_to_replay_compute_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The C written for this machine alone, and SciPy, share no code with the package."""
    every: Any = replay.replays
    monkeypatch.setattr(replay, "SCIPY_SAMPLES", 1)
    monkeypatch.setattr(
        replay, "replays", lambda plan, count: {replay.OURS: every(plan, count)[replay.OURS]}
    )
    gaps = {name: gap for name, _, gap in replay.measured(20, 1)}
    assert gaps["C by hand"] < 1e-12
    assert gaps["solve_ivp"] < 1e-4


def test_an_arm_goes_on_from_where_its_homing_ended(paper: Problem) -> None:
    """What follows is run after the very commands of the homing, by the same arm."""
    (arm,) = identification.arms(1)
    assert not any(q.varies for k, q in arm.effects.items() if k not in identification.OF_A_RUN)
    way = identification.Homed.run(paper, arm, 3)
    rule = planner.HomingRule()
    run = planner.replay(planner.homing(paper), arm, [3], identification.SEED, rule, settle_s=0.0)
    read_s = identification.TICK_S * len(way.commands) - identification.WAIT_S  # drives creep on
    still = np.rad2deg(run.q[0, np.searchsorted(run.t, read_s), 1:])
    np.testing.assert_allclose(way.pose_deg, still, atol=0.05)  # an encoder's half step
    assert 3 < len(way.commands) * identification.TICK_S < 10
    plan = planner.solve(identification.from_pose(paper, way.pose_deg))
    moved = way.end_after(plan)
    assert np.abs(moved - 30).max() < 3  # homed, and nothing of the machine allowed for


# -- arms outside the model ------------------------------------------------------------------------

START_DEG = [1.0, 1.0, 1.0]
FELT = ("shaft_stiffness_nm_per_rad", "coulomb_friction_nm", "viscous_friction_nms_per_rad")


@pytest.fixture(scope="module")
def built_arm(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The simulator, which shares no code with the package."""
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler")
    return truths.built(tmp_path_factory.mktemp("truths"))


@pytest.fixture
def made(built_arm: Any, paper: Problem) -> Callable[..., truths.Arm]:
    """An arm in the middle of its gaps."""

    def made(numbers: truths.Numbers, steps: int = 100) -> truths.Arm:
        arm = truths.Arm(built_arm, numbers, paper, [0], steps)
        arm.place(START_DEG, [0.0, 0.0])
        return arm

    return made


def test_the_first_truth_is_of_the_class_of_the_model(
    made: Callable[..., truths.Arm], paper: Problem
) -> None:
    """Errors of first-order steps are what halving the steps changes; twice that is allowed."""
    plan, numbers = planner.excitation(paper), truths.drawn(0)  # reverses the drive eleven times
    u = plan.trajectory.u(truths.TICK_S * np.arange(round(plan.duration / truths.TICK_S)))
    machine = Machine.prototype().nominal().without(*identification.OF_A_RUN).with_(**numbers)

    def theirs(step_s: float, **more: Any) -> Array:
        arm = machine.with_(step_s=step_s, **more)
        replay = planner.replay(plan, arm, [0], settle_s=0.0, record_s=truths.TICK_S)
        return replay.q[0, : len(u), 1:]

    def apart(a: Array, b: Array) -> float:
        return float(np.abs(a - b).max())

    ours = [made(numbers, steps).period(u) for steps in (50, 100)]
    known = [theirs(0.002), theirs(0.001)]
    allowed = 2 * (apart(*ours) + apart(*known))
    assert allowed < np.deg2rad(0.02)
    assert apart(ours[1], known[1]) < allowed
    wider = [b + 0.1 for b in numbers["backlash_deg"]]
    assert apart(ours[1], theirs(0.001, backlash_deg=wider)) > allowed


def test_with_little_inertia_links_move_as_without(made: Callable[..., truths.Arm]) -> None:
    """They lag by inertia times acceleration over stiffness, and swing by as much about that."""
    t = truths.TICK_S * np.arange(800)
    u = np.stack([0.4 * np.sign(np.sin(t)), 0.2 * np.sin(1.7 * t)], axis=1)
    numbers, inertia = truths.drawn(1), 1e-4
    heavy = {**numbers, "inertia": [inertia, inertia], "reach": [0.0, 0.0, 0.0]}
    gap = np.abs(made(heavy, 400).period(u) - made(numbers, 400).period(u)).max()
    assert gap < 4 * inertia * 30.0 / min(numbers["shaft_stiffness_nm_per_rad"])


def test_free_links_keep_their_energy(made: Callable[..., truths.Arm]) -> None:
    """Without friction and shafts the chain has its kinetic energy alone; joint 1 stands."""
    free = {name: [0.0, 0.0] for name in FELT}

    def change(steps: int) -> float:
        arm = made({**truths.arm_of(5, 0), **free, "edge_deg": 0.0, "shaft_damping": 0.0}, steps)
        arm.state.spin[:] = [1.0, -0.7]
        a, b = arm.numbers["inertia"]
        reach = arm.numbers["reach"][2]
        energies = []
        for _ in range(150):
            arm.period(np.zeros((1, 2)), held=True)
            w2, w3 = arm.state.spin
            swing = reach * np.cos(arm.state.theta[2]) * w2 * w3
            energies.append(a * w2**2 / 2 + b * w3**2 / 2 + swing)
        return float(np.ptp(energies) / energies[0])

    coarse, fine = change(50), change(100)
    assert fine < 0.002
    assert coarse == pytest.approx(2 * fine, rel=0.2)  # of first order, and nothing else


def test_records_of_other_code_begin_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = pages.begin_records("stress", tmp_path / "new" / "records.txt")
    with path.open("a", encoding="utf-8") as out:
        out.write("one\n")
    assert pages.read_records(pages.begin_records("stress", path)) == ["one"]
    assert not capsys.readouterr().err
    monkeypatch.setitem(pages.DEPENDENCIES, "stress", ("solve.py",))
    monkeypatch.setattr(pages, "ROOT", tmp_path)  # where the old file goes
    assert pages.read_records(pages.begin_records("stress", path)) == []
    assert "records.txt is of other code" in capsys.readouterr().err
    assert pages.read_records(tmp_path / "out" / "stress-before-records.txt") == ["one"]
