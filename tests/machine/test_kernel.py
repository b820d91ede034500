"""The compiled manipulator against the one in NumPy, over all effects; and life without it."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from handmade import arm_problem, inputs, plan_from

from planner import Machine, Plan, Replay, replay
from planner.machine import compiled

JUMPS = inputs(
    ([1.8], [0.8, 0.4]), ([-1.2], [0.5]), ([1.5], [-0.6, 0.6]), breaks=[0.0, 0.25, 0.6, 1]
)
SPREAD = {"value": 0.005, "spread": 0.002}
PROTOTYPE: dict[str, dict[str, Any]] = {
    "as it is": {},
    "second order": {"servo_damping": 0.7},
    "overdamped": {"servo_damping": 1.5, "velocity_limit_rad_s": 0.25},
    "critical": {"servo_damping": 1.0, "acceleration_limit_rad_s2": 1.0},
    "limits": {"velocity_limit_rad_s": 0.25, "acceleration_limit_rad_s2": 1.0},
    "ramp alone": {"servo_bandwidth_rad_s": False, "acceleration_limit_rad_s2": 1.0},
    "direct": {"servo_bandwidth_rad_s": False, "acceleration_limit_rad_s2": False},
    "continuous": {"control_period_s": False},
    "continuous, second order": {"control_period_s": False, "servo_damping": 0.7},
    "many delays": {"delay_s": SPREAD},
    "many delays, continuous": {"delay_s": SPREAD, "control_period_s": False},
    "slipping": {"friction_capacity_nm": {"value": 0.06, "spread": 0.03}},
    "rigid": {"shaft_stiffness_nm_per_rad": False},
    "rigid, slipping": {"shaft_stiffness_nm_per_rad": False, "friction_capacity_nm": 0.15},
    "no contacts": {"creep": False, "creep_per_nm": False, "friction_capacity_nm": False},
    "constant creep": {"creep_per_nm": False, "friction_capacity_nm": False},
    "plain disks": {"lateral_friction": 1.0},
    "sideways alone": {"creep": False, "creep_per_nm": False},
    "sideways, slipping": {"lateral_friction": 0.5, "friction_capacity_nm": 0.3},
    "sideways, rigid, slipping": {
        "lateral_friction": 0.5,
        "shaft_stiffness_nm_per_rad": False,
        "friction_capacity_nm": 0.3,
    },
    "no sideways": {"lateral_friction": False},
    "inclined": {"incline_deg": 15.0},
    "inclined, rigid": {"incline_deg": 15.0, "shaft_stiffness_nm_per_rad": False},
    # Not sideways too: at an eighth of the capacity, in steps of 4 ms, that amplifies rounding.
    "inclined, slipping": {
        "incline_deg": 3.0,
        "friction_capacity_nm": 0.2,
        "lateral_friction": False,
    },
    "one dry joint": {"viscous_friction_nms_per_rad": [0.0, 0.05]},
    "no gearheads": {"gearhead_backlash_deg": [0.5, 0.0]},
    "pushed, each joint otherwise": {"start_state": ["unknown", "forward", "backward"]},
}


@pytest.fixture(scope="module", autouse=True)
def _needs_a_compiler(library: Any) -> None:
    """All of this is about the compiled code."""


@pytest.fixture(scope="module")
def plan() -> Plan:
    """1 s with jumps, both directions, not at rest at either end."""
    return plan_from(arm_problem([10, 20, 15], end=1.0), JUMPS, pieces=50)


def agree(
    plan: Plan,
    machine: Machine,
    library: Any,
    use: Any,
    monkeypatch: pytest.MonkeyPatch | None = None,
) -> Replay:
    """The same replay compiled and in NumPy; the former. With `monkeypatch` NumPy takes the
    compiled cosines: contacts that slip amplify the last bit of an angle."""
    runs = []
    for found in (library, None):
        use(found)
        if monkeypatch and found is None:
            monkeypatch.setattr(np, "cos", partial(cosines, library))
        runs.append(replay(plan, machine, samples=3, seed=1, settle_s=0.1))
    for name in (
        "q",
        "motor_rates",
        "saturated_s",
        "slip_s",
        "deviation",
        "terminal_error",
        "end_state",
    ):
        assert np.max(np.abs(getattr(runs[0], name) - getattr(runs[1], name))) < 1e-12, name
    return runs[0]


@pytest.mark.parametrize("name", PROTOTYPE)
def test_kernel_and_numpy_agree_to_rounding(
    plan: Plan, library: Any, use: Any, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    step_s = 0.01 if "rigid" in name else 0.004  # rigid shafts take NumPy ten times as long
    machine = Machine.prototype(step_s=step_s, backlash_deg=0.5, **PROTOTYPE[name])
    run = agree(plan, machine, library, use, monkeypatch if "slipping" in name else None)
    monkeypatch.undo()
    if "slipping" in name and "inclined" not in name:  # and they do slip
        use(library)
        firm = replay(
            plan, machine.with_(friction_capacity_nm=50.0), samples=3, seed=1, settle_s=0.1
        )
        assert np.max(np.abs(run.q[:, -1, 3] - firm.q[:, -1, 3])) > np.deg2rad(1)


@pytest.mark.parametrize("n", [2, 5])
def test_of_any_number_of_joints(n: int, library: Any, use: Any) -> None:
    plan = plan_from(arm_problem(list(range(10, 10 + n)), end=1.0), JUMPS, pieces=50)
    agree(plan, Machine.ideal(step_s=0.01), library, use)
    agree(plan, Machine.prototype(step_s=0.004, backlash_deg=0.5), library, use)


@pytest.mark.parametrize("count", ["1", "3"])
def test_threads_do_not_matter(
    plan: Plan, library: Any, use: Any, monkeypatch: pytest.MonkeyPatch, count: str
) -> None:
    use(library)
    monkeypatch.setattr(compiled, "STEPS_A_CALL", 77)
    machine, told = Machine.prototype(step_s=0.01), []
    usual = replay(plan, machine, samples=70, record_s=None)
    monkeypatch.setenv("OMP_NUM_THREADS", count)
    assert compiled.threads() == int(count)
    run = replay(plan, machine, samples=70, record_s=None, progress=lambda *x: told.append(x))
    assert np.array_equal(run.q, usual.q)
    assert np.array_equal(run.deviation, usual.deviation)
    assert told == sorted(told)
    assert told[-1][0] == told[-1][1]


@pytest.mark.parametrize("name", ["many delays", "sideways, slipping", "second order", "inclined"])
def test_a_machine_gives_the_same_bits_alone_and_among_others(
    plan: Plan, library: Any, use: Any, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    use(library)
    machine, runs = Machine.prototype(step_s=0.004, **PROTOTYPE[name]), []
    for together in (1, 32):
        monkeypatch.setattr(compiled, "SAMPLES_A_CALL", together)
        runs.append(replay(plan, machine, samples=26, seed=1))
    for result in ("q", "motor_rates", "saturated_s", "slip_s", "deviation", "end_state"):
        assert np.array_equal(*(getattr(run, result) for run in runs)), result


def cosines(library: Any, x: Any, out: Any = None) -> Any:
    """The cosines that the compiled code computes with."""
    given = np.ascontiguousarray(x, dtype=float)
    result = np.empty_like(given)
    places = (ctypes.c_void_p(array.ctypes.data) for array in (given, result))
    library.planner_cosines(ctypes.c_int64(given.size), *places)
    if out is not None:
        out[...] = result
    return result


def test_cosines_are_right_to_the_last_bits(library: Any) -> None:
    rng = np.random.default_rng(1)
    for most, units in ((0.7, 0.7), (3.0, 1.6), (1000.0, 1.6), (1e6, 2.4)):
        x = rng.uniform(-most, most, 20_000)
        right = np.cos(x.astype(np.longdouble))
        unit = np.spacing(np.abs(right.astype(float)))
        assert np.max(np.abs(cosines(library, x) - right) / unit) < units, most
    turns = np.arange(-8, 9) * np.pi / 2
    assert np.allclose(cosines(library, turns), np.cos(turns), rtol=0, atol=1e-16)
    assert np.isnan(cosines(library, [np.nan, np.inf])).all()


def test_without_a_kernel_or_with_an_old_one_there_is_none_and_a_warning_says_why(
    library: Any,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    find = compiled.library.__wrapped__
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.py"))
    assert find() is None
    place = tmp_path / f"_kernel{compiled.EXTENSION_SUFFIXES[0]}"
    place.write_bytes(b"not a library")
    assert find() is None
    shutil.copy(library._name, place)
    assert caplog.messages == [compiled.MISSING_WARNING] * 2
    assert find() is not None
    monkeypatch.setattr(compiled, "VERSION", compiled.VERSION + 1)
    assert find() is None
    assert "of another version, so replays are about ten times slower" in caplog.messages[2]
    assert "run make in the project's folder" in caplog.messages[2]


def test_a_kernel_of_older_source_with_the_same_layout_is_none(
    library: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = Path(compiled.__file__).parent
    for name in compiled.SOURCES:
        shutil.copy(folder / name, tmp_path)
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.py"))
    assert compiled.open_library(Path(library._name)) is not None
    with (tmp_path / "dynamic.c").open("a", encoding="utf-8") as file:
        file.write("/* another law */\n")
    assert compiled.open_library(Path(library._name)) is None
    (tmp_path / "dynamic.c").unlink()  # as in a wheel
    assert compiled.open_library(Path(library._name)) is not None


BITS = """
import hashlib, sys
import planner
plan = planner.load_plan(sys.argv[1])
for changes in ({}, {"servo_damping": 0.7}, {"fidelity": "dynamic", "incline_deg": 3.0}):
    run = planner.replay(plan, planner.Machine.prototype(**changes), samples=18, seed=1)
    arrays = run.q, run.motor_rates, run.deviation, run.end_state, run.slip_s, run.margin
    print(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="asks glibc for another processor's functions")
def test_replays_are_the_same_bits_on_older_processors(plan: Plan, tmp_path: Path) -> None:
    """Sines and exponentials without fused products; motors round commands of the plan."""
    path, said = tmp_path / "plan.json", []
    plan.save(path)
    for features in ("", "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"):
        run = subprocess.run(
            [sys.executable, "-c", BITS, str(path)],
            env={**os.environ, "GLIBC_TUNABLES": features},
            capture_output=True,
            check=True,
        )
        said.append(run.stdout.split())
    assert len(set(said[0])) == 3
    assert said[0] == said[1]
