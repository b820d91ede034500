"""The tracker in C: it compiles without a warning, passes its own test, does what Python does."""

from __future__ import annotations

import re
import subprocess
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from compiled_tracker import LATE, OVER, CompiledTracker, Shadow, compile_c, compiler

import planner
from planner import Machine, Plan, Replay, Tracker

ROOT = Path(__file__).parents[2]
SAMPLES = 12
MACHINE = Machine.prototype(step_s=0.005)


@pytest.fixture(scope="module", autouse=True)
def _needs_a_compiler() -> None:
    if compiler() is None:
        pytest.skip("no C compiler")


class Case(NamedTuple):
    """A plan, and what the tracker in Python does with it on some machines."""

    plan: Plan
    tracker: Tracker
    shadow: Shadow
    replay: Replay


def lose(k: int, measured: np.ndarray) -> np.ndarray:
    """Some readings are lost."""
    return np.where(np.random.default_rng(k).random(measured.shape) < 0.03, np.nan, measured)


def shift(k: int, measured: np.ndarray) -> np.ndarray:
    """The last joint seems to be three degrees beyond its goal, and so beyond its limit."""
    return measured + np.deg2rad([[0.0], [0.0], [0.0], [3.0 * (k > 150)]])


@cache
def case(name: str) -> Case:
    problem = planner.load_problem(
        ROOT / f"problems/{'unicycle' if name == 'vehicle' else 'paper'}.toml"
    )
    rated = {"limits.input_rate_rad_s2": [2.0, 2.0], "limits.joint_deg": [80, 31, 31]}
    if name == "vehicle":  # no run-up, no limits of states, all coordinates read exactly
        plan = planner.solve(problem, "polynomial")
    else:
        plan = planner.solve(problem.changed(rated), "collocation", intervals=20, rest=True)
    tracker = Tracker()
    shadow = Shadow(tracker, {"beyond": shift, "rated": lose}.get(name))
    run = planner.replay(plan, MACHINE, SAMPLES, seed=0, feedback=shadow, record_s=None)
    return Case(plan, tracker, shadow, run)


def exported(name: str, folder: Path, real: str) -> Path:
    plan = case(name).plan
    if name != "vehicle":
        return planner.export(plan, folder / "c", "c", real=real, machine=MACHINE)
    with pytest.warns(planner.InputWarning, match="not start at rest"):
        return planner.export(plan, folder / "c", "c", real=real, machine=MACHINE)


def compiled(name: str, folder: Path, real: str = "double") -> CompiledTracker:
    one = case(name)
    return CompiledTracker(exported(name, folder, real), one.tracker.design(one.plan, MACHINE))


@pytest.mark.parametrize("name", ["rated", "vehicle"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_it_passes_its_own_test_and_wrong_commands_do_not(
    name: str, real: str, tmp_path: Path
) -> None:
    folder = exported(name, tmp_path, real)
    words = re.search(
        r"cc (-std=c99 .* -pedantic) (selftest.c.*) -lm", (folder / "README.md").read_text()
    )
    assert words is not None
    compile_c(folder, [*words[1].split(), *words[2].split(), "-o", "selftest"])
    done = subprocess.run([folder / "selftest"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "fallbacks: 0" in done.stdout
    source = folder / "tracker.c"
    source.write_text(source.read_text().replace("correction[m] -= GAIN", "correction[m] += GAIN"))
    compile_c(folder, ["selftest.c", "tracker.c", "-o", "selftest"])
    assert subprocess.run([folder / "selftest"], capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize(
    ("name", "real", "most", "usual"),
    [
        ("rated", "double", 2e-4, 1e-5),
        ("rated", "float", 0.2, 2e-3),
        ("beyond", "double", 2e-4, 1e-5),
        ("vehicle", "double", 1e-4, 1e-5),
        ("vehicle", "float", 0.02, 2e-3),
    ],
)
def test_it_commands_what_python_does_on_the_same_readings(
    name: str, real: str, most: float, usual: float, tmp_path: Path
) -> None:
    one, tracker = case(name), compiled(name, tmp_path, real)
    control = tracker.start(one.plan, MACHINE, np.arange(SAMPLES))
    off = np.array([np.abs(control(t, read) - told) for t, read, told in one.shadow.log])
    assert off.max() < most
    assert np.percentile(off, 99) < usual
    assert np.max(control.steps) > 3  # limits were in the way
    assert control.fallbacks.tolist() == one.replay.fallbacks.tolist()
    assert control.fallbacks.any() == (name == "beyond")


@pytest.mark.parametrize("real", ["double", "float"])
def test_machines_end_as_well_as_with_python(real: str, tmp_path: Path) -> None:
    one = case("rated")
    with_c = planner.replay(
        one.plan,
        MACHINE,
        SAMPLES,
        seed=0,
        feedback=Shadow(compiled("rated", tmp_path, real), lose),
        record_s=None,
    )
    known, found = np.median(one.replay.terminal_E_deg), np.median(with_c.terminal_E_deg)
    assert found == pytest.approx(known, rel=0.2)
    assert with_c.percentile(50) == pytest.approx(one.replay.percentile(50), rel=0.1)


def test_ticks_that_are_late_forgotten_or_over_stand_still(tmp_path: Path) -> None:
    one, tracker = case("rated"), compiled("rated", tmp_path)
    control, ref = (
        tracker.start(one.plan, MACHINE, np.arange(1)),
        one.tracker.design(one.plan, MACHINE).ref,
    )
    ticks, latency = ref.timing.ticks, ref.timing.latency
    end = len(ref.feed) * ticks + latency
    assert control.command(0, latency)[0] == LATE
    nothing = np.full((4, 1), np.nan)
    for k in range(len(ref.feed)):
        control(0.0, nothing)
        assert control.command(0, (k + 1) * ticks + latency - 1)[0] == 0
        status, speed = control.command(0, (k + 1) * ticks + latency)
        assert status == (OVER if k == len(ref.feed) - 1 else LATE)
        assert not speed.any()
    assert control.command(0, 0)[0] == LATE
    assert control.command(0, end)[0] == OVER


def test_what_c_has_not_is_refused(tmp_path: Path) -> None:
    with pytest.raises(planner.InputError, match=r"real = 'half'; .*double"):
        planner.export(case("rated").plan, tmp_path / "c", "c", real="half")  # type: ignore[arg-type]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "x").touch()
    with pytest.raises(planner.InputError, match="not from an earlier run"):
        planner.export(case("rated").plan, tmp_path / "mine", "c")
