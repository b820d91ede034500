"""The tracker in C: it compiles without a warning, passes its own test, does what Python does."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from compiled_tracker import LATE, OVER, CompiledTracker, compile_c, compiler

import planner
from planner import Machine, Plan, Tracker
from planner.report.controller.controller import Recorder
from planner.report.export import slowed

ROOT = Path(__file__).parents[2]
SAMPLES = 8
MACHINE = Machine.prototype(step_s=0.005)
TRACKER = Tracker()


@pytest.fixture(scope="module", autouse=True)
def _needs_a_compiler() -> None:
    if compiler() is None:
        pytest.skip("no C compiler")


def lose(k: int, measured: np.ndarray) -> np.ndarray:
    """Some readings are lost."""
    return np.where(np.random.default_rng(k).random(measured.shape) < 0.03, np.nan, measured)


def shift(k: int, measured: np.ndarray) -> np.ndarray:
    """The last joint seems to be three degrees beyond its goal, and so beyond its limit."""
    return measured + np.deg2rad([[0.0], [0.0], [0.0], [3.0 * (k > 150)]])


TAMPERS = {"lost": lose, "exact": lose, "beyond": shift, "vehicle": lambda _, read: read}


def machine_of(name: str) -> Machine:
    """The encoders of an "exact" one have no noise."""
    return MACHINE.with_(encoder_noise_deg=False) if name == "exact" else MACHINE


def plan_of(name: str) -> Plan:
    """A vehicle (no run-up, no limits of states, read exactly), or an arm with limited rates."""
    return _plan(name == "vehicle")


@cache
def _plan(is_vehicle: bool) -> Plan:
    if is_vehicle:
        return planner.solve(planner.load_problem(ROOT / "problems/unicycle.toml"), "polynomial")
    rated = {"limits.input_rate_rad_s2": [2.0, 2.0], "limits.joint_deg": [80, 31, 31]}
    problem = planner.load_problem(ROOT / "problems/paper.toml", rated)
    return planner.solve(problem, "collocation", intervals=20)


@cache
def followed(name: str) -> tuple[Recorder, planner.Replay]:
    """What the tracker in Python reads and commands, and how the machines move."""
    shadow = Recorder(TRACKER, TAMPERS[name])
    run = planner.replay(
        plan_of(name), machine_of(name), SAMPLES, seed=0, feedback=shadow, record_s=None
    )
    return shadow, run


Made = Callable[[str, str], Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Exports, each made once: of the arm or the vehicle, with a type of numbers."""

    @cache
    def make(name: str, real: str) -> Path:
        folder = tmp_path_factory.mktemp("c") / f"{name}-{real}"
        machine = machine_of(name)
        if name != "vehicle":  # at rest at both ends
            return planner.export(plan_of(name), folder, "c", real=real, machine=machine)
        with pytest.warns(planner.InputWarning, match="not start at rest"):
            return planner.export(plan_of(name), folder, "c", real=real, machine=machine)

    return lambda name, real: make(name if name in ("vehicle", "exact") else "arm", real)


@cache
def compiled(folder: Path) -> CompiledTracker:
    name = folder.name.partition("-")[0]
    return CompiledTracker(folder, TRACKER.design(plan_of(name), machine_of(name)))


@pytest.mark.parametrize(
    ("name", "real"),
    [
        ("lost", "double"),
        ("vehicle", "float"),
        pytest.param("lost", "float", marks=pytest.mark.campaign),
        pytest.param("vehicle", "double", marks=pytest.mark.campaign),
    ],
)
def test_it_passes_its_own_test_and_a_wrong_tracker_does_not(
    name: str, real: str, made: Made, tmp_path: Path
) -> None:
    folder = made(name, real)
    told = (folder / "README.md").read_text()
    swings = (
        "- Stand clear: before the plan starts, the joints move within theta1 from -1 to 62 deg"
    )
    assert (swings in told) == (name == "lost")
    words = re.search(r"cc (-std=c99 .* -pedantic) (selftest.c.*) -lm", told)
    compile_c(folder, [*words[1].split(), *words[2].split(), "-o", "selftest"])
    done = subprocess.run([folder / "selftest"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "fallbacks: 0" in done.stdout
    if real == "float":  # the same code
        return
    for file in folder.glob("*.[ch]"):
        text = file.read_text().replace("correction[m] -= GAIN", "correction[m] += GAIN")
        (tmp_path / file.name).write_text(text)
    compile_c(tmp_path, ["selftest.c", "tracker.c", "-o", "selftest"])
    assert subprocess.run([tmp_path / "selftest"], capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize(
    ("name", "real", "most", "usual"),
    [
        ("lost", "double", 2e-4, 1e-5),  # OSQP's in Python
        ("exact", "double", 2e-4, 1e-5),
        ("lost", "float", 0.2, 2e-3),  # rounding decides now and then whether a joint has moved
        ("beyond", "double", 2e-4, 1e-5),
        ("vehicle", "double", 1e-9, 1e-9),
        ("vehicle", "float", 1e-4, 1e-4),
    ],
)
def test_it_commands_what_python_does_on_the_same_readings(
    name: str, real: str, most: float, usual: float, made: Made
) -> None:
    shadow, run = followed(name)
    control = compiled(made(name, real)).start(run.plan, MACHINE, np.arange(SAMPLES))
    off = np.array([np.abs(control(t, read) - told) for t, read, told in shadow.log])
    assert off.max() < most
    assert np.percentile(off, 99) < usual
    assert np.max(control.steps) > 3  # limits were in the way
    assert control.fallbacks.tolist() == run.fallbacks.tolist()


@pytest.mark.parametrize("real", ["double", "float"])
def test_machines_end_as_well_as_with_python(real: str, made: Made) -> None:
    plan, (_, known) = plan_of("lost"), followed("lost")
    feedback = Recorder(compiled(made("lost", real)), lose)
    found = planner.replay(plan, MACHINE, SAMPLES, seed=0, feedback=feedback, record_s=None)
    assert found.percentile(50) == pytest.approx(known.percentile(50), rel=0.1)
    ends = [np.median(run.terminal_E_deg) for run in (found, known)]
    assert ends[0] == pytest.approx(ends[1], rel=0.2)


class Slow:
    """Ticks that are ten times as long, and a tenth of the speeds."""

    def __init__(self, feedback: CompiledTracker) -> None:
        self.feedback = feedback

    def start(self, plan: Plan, machine: Machine, numbers: np.ndarray) -> Slow:
        control = self.control = self.feedback.start(plan, machine, numbers)
        times = (control.period_s, control.tick_s, control.lead_s, control.end_s)
        self.period_s, self.tick_s, self.lead_s, self.end_s = (10 * each for each in times)
        return self

    @property
    def fallbacks(self) -> np.ndarray:
        return self.control.fallbacks

    def __call__(self, t: float, measured: np.ndarray) -> np.ndarray:
        return self.control(t / 10, measured) / 10


def test_a_first_run_is_slow_and_ends_as_near(made: Made) -> None:
    plan, (_, known) = plan_of("lost"), followed("lost")
    slow = Slow(compiled(made("lost", "double")))
    run = planner.replay(slowed(plan, 10), MACHINE, SAMPLES, feedback=slow, record_s=0.2)
    assert run.t[0] < -30
    assert not run.fallbacks.any()
    assert run.percentile(95) < known.percentile(95) + 0.3  # lags differ from what it expects
    path = made("lost", "double") / "README.md"
    assert "make each tick ten times as long (100 ms)" in path.read_text("utf-8")


def test_it_says_which_joint_leaves_the_band_of_the_machines(made: Made) -> None:
    """Machines of the model's kind seldom do; a joint that seems to slip by three degrees does."""
    outside = {}
    for name in ("lost", "beyond"):
        shadow, run = followed(name)
        control = compiled(made(name, "double")).start(run.plan, MACHINE, np.arange(SAMPLES))
        for t, read, _ in shadow.log:
            control(t, read)
        outside[name] = control.outside
    assert sum(map(bool, outside["lost"])) <= 1
    assert all(outside["beyond"])
    assert outside["beyond"].count(3) >= SAMPLES - 1  # correcting one may move another


def test_ticks_that_are_late_forgotten_or_over_stand_still(made: Made) -> None:
    plan = plan_of("lost")
    control = compiled(made("lost", "double")).start(plan, MACHINE, np.arange(1))
    ref = TRACKER.design(plan, MACHINE).ref
    ticks, latency, periods = ref.timing.ticks, ref.timing.latency, len(ref.feed)
    assert control.command(0, latency)[0] == LATE
    for k in range(periods):
        control(0.0, np.full((4, 1), np.nan))
        assert control.command(0, (k + 1) * ticks + latency - 1)[0] == 0
        status, speed = control.command(0, (k + 1) * ticks + latency)
        assert status == (OVER if k == periods - 1 else LATE)
        assert not speed.any()
    assert control.command(0, 0)[0] == LATE  # forgotten
    assert np.isfinite(control.command(0, periods * ticks)[1]).all()


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    plan = plan_of("lost")
    with pytest.raises(planner.InputError, match=r"real = 'half'; .*double"):
        planner.export(plan, tmp_path / "c", "c", real="half")  # type: ignore[arg-type]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "x").touch()
    with pytest.raises(planner.InputError, match="not from an earlier run"):
        planner.export(plan, tmp_path / "mine", "c")
