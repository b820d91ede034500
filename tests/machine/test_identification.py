"""The machine of an arm from its logs: known machines are found again, and doubts are told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner import (
    Identification,
    InputError,
    Log,
    Machine,
    Plan,
    Problem,
    compensate,
    emulate_log,
    excitation,
    identify,
    load_machine,
    load_problem,
    solve,
)
from planner.machine.identification import model
from planner.machine.identification.band import Departure, departure
from planner.machine.identification.model import LogModel, reading_noise
from planner.machine.identification.parameters import Parameters

PRESET = Machine.prototype()
STIFFNESS = "shaft_stiffness_nm_per_rad"
ARM = PRESET.nominal().with_(
    backlash_deg=[4.4, 1.9],
    shaft_stiffness_nm_per_rad=[3.9, 2.8],
    coulomb_friction_nm=[0.18, 0.15],
    lateral_friction=0.13,
    gear_ratio_error=[0.008, -0.011],
    input_gain_error=[0.002, -0.004],
    input_bias_rad_s=[0.0006, -0.0004],
    gearhead_backlash_deg=[0.7, 0.4],
    delay_s=0.009,
    encoder_noise_deg=[0.03, 0.02, 0.02],
    initial_play={"value": 0.0, "spread": 0.5},
    initial_angle_error_deg={"value": 0.0, "spread": 0.2},
)
"""One arm, none of the preset's; each run of it begins somewhere in its backlash."""


def lost_deg(machine: Machine, joints: int = 3) -> np.ndarray:
    names = ("backlash_deg", "coulomb_friction_nm", "shaft_stiffness_nm_per_rad")
    backlash, friction, stiffness = (machine.mean(name, joints) for name in names)
    return backlash / 2 + np.rad2deg(friction / stiffness)


@pytest.fixture(scope="module")
def motion(paper: Problem) -> Plan:
    return excitation(paper)


@pytest.fixture(scope="module")
def plan(paper: Problem) -> Plan:
    return solve(paper, "collocation")


@pytest.fixture(scope="module")
def found(paper: Problem, motion: Plan, plan: Plan) -> Identification:
    runs = [emulate_log(motion, ARM, sample=3), emulate_log(plan, ARM, sample=4)]
    return identify(runs, paper)


def test_a_known_arm_is_found_from_one_run_of_30_s(found: Identification) -> None:
    np.testing.assert_allclose(lost_deg(found.machine), lost_deg(ARM), atol=0.02)
    for key, true, most in (  # how unsure it may be, and it is no surer than it says
        ("gain2", -0.4, 0.03),  # %
        ("bias1", 0.6, 0.06),  # mrad/s
        ("bias2", -0.4, 0.02),
        ("gear1", 0.7, 0.12),  # deg: like a motor's lag, but where joint 1 turns back
        ("gear2", 0.4, 0.03),
        ("servo1", 9.0 + 1e3 / 67.1, 1.0),  # ms: delay and servo together
        ("servo2", 9.0 + 1e3 / 67.1, 1.5),
        ("lateral", 0.13, 0.002),
        ("friction2", 0.18, 0.02),  # N m: by what the contacts lose under it
        ("friction3", 0.15, 0.02),
        ("ratio2", 0.8 + 0.2, 0.3),  # %: with the gain of motor 1
        ("ratio3", -1.1 + 0.2, 0.3),
    ):
        assert found[key].spread < most, key
        assert abs(found[key].value - true) < 3.5 * found[key].spread + 0.02 * most, key
    assert not found.warnings
    assert not found.untold
    np.testing.assert_allclose(found.residual_deg, found.noise_deg, rtol=0.15)
    noise_deg = ARM.mean("encoder_noise_deg")
    np.testing.assert_allclose(found.machine.mean("encoder_noise_deg"), noise_deg, rtol=0.25)


def test_a_run_that_was_kept_out_is_predicted_far_better_than_by_the_preset(
    found: Identification, plan: Plan
) -> None:
    assert found.kept_out is not None
    assert "collocation" in found.kept_out.source
    identified, preset = found.errors["identified"], found.errors["preset"]
    assert max(identified.rms_deg) < 0.06  # the encoder's noise is 0.04
    assert max(preset.rms_deg) > 3 * max(identified.rms_deg)
    prediction = found.predict(found.kept_out)
    silent = emulate_log(plan, ARM, sample=4, noise_deg=0.0)
    end = prediction.theta_deg[-1] - silent.theta_deg[-1]
    assert np.abs(end).max() < 0.08  # half of the encoder's step, and 0.03


def test_only_a_run_that_reverses_tests_the_machine(found: Identification, motion: Plan) -> None:
    assert (found.improves, found.verdict) == (None, "not tested")  # the plan never reverses
    assert np.isnan(found.half_width_deg)
    other = emulate_log(motion, ARM, sample=5)
    tested = replace(found, kept_out=other)
    assert (tested.improves, tested.verdict) == (True, "better")
    rms = np.array(tested.errors["identified"].rms_deg[1:])
    assert tested.half_width_deg == pytest.approx(5.4 * np.sqrt(np.mean(rms**2)))
    assert tested.half_width_deg < 0.4
    assert f"within {tested.half_width_deg:.2g} deg" in tested.to_toml()
    worth = tested.machine.worth
    assert worth is not None
    assert (worth.tested, worth.improves) == (True, True)
    assert worth.half_width_deg == pytest.approx(tested.half_width_deg, rel=0.01)
    alike = replace(found, kept_out=other, preset=found.machine)
    assert (alike.improves, alike.verdict) == (False, "no better")


@pytest.mark.parametrize("state", ["unwound", "forward", "backward"])
def test_a_run_is_predicted_whatever_the_arm_did_before(
    found: Identification, plan: Plan, state: str
) -> None:
    """A homed axis pushes at once; its run of one direction was predicted 3.7 degrees off."""
    log = emulate_log(plan, ARM.with_(start_state=state), sample=4)
    gap = found.predict(log).theta_deg - log.theta_deg
    assert np.abs(gap).max() < 0.25  # five standard deviations of a reading


def test_an_arm_without_an_effect_is_no_doubt(paper: Problem, motion: Plan) -> None:
    rigid = PRESET.nominal().without("gearhead_backlash_deg", "lateral_friction")
    found = identify(emulate_log(motion, rigid), paper, starts=1)
    assert not found.warnings
    assert found["gear2"].value == pytest.approx(0.0, abs=0.1)


def test_an_excitation_right_after_homing_gives_no_warning(paper: Problem, motion: Plan) -> None:
    arm = PRESET.nominal().with_(backlash_deg=4.0, start_state="forward")
    homed = identify(emulate_log(motion, arm), paper, starts=1)
    assert not homed.warnings
    np.testing.assert_allclose(lost_deg(homed.machine), lost_deg(arm), atol=0.03)


def test_a_run_leaves_the_band_where_start_or_arm_differ(
    paper: Problem, plan: Plan, found: Identification
) -> None:
    machine = found.machine.with_(initial_angle_error_deg=False, start_state="forward")
    homed = ARM.with_(initial_angle_error_deg=False, start_state="forward")
    run = compensate(plan, machine)

    def left(arm: Machine, used: Machine = machine) -> Departure | None:
        return departure(emulate_log(run, arm), paper, used, run)

    assert left(homed) is None
    shifted = left(homed.with_(initial_angle_error_deg=[0.0, 1.0, 0.0]))
    unwound = left(homed.with_(start_state="backward"))
    rubbing = left(homed.with_(coulomb_friction_nm=[0.5, 0.45]))
    assert shifted is not None
    assert (shifted.t_s, shifted.joint) == (0.0, 2)
    assert shifted.off_deg == pytest.approx(1.0, abs=0.1)
    for each, is_arm in ((shifted, False), (unwound, False), (rubbing, True)):
        assert each is not None
        assert each.is_arm == is_arm
    assert left(homed.with_(coulomb_friction_nm=[0.5, 0.45]), machine.with_(worth=WIDE)) is None


WIDE = {"tested": True, "improves": True, "half_width_deg": 5.0}


def test_most_machines_stay_in_the_band_of_all(paper: Problem, plan: Plan) -> None:
    logs = [emulate_log(plan, PRESET, sample=k, seed=1) for k in range(20)]  # not those of the band
    assert sum(departure(log, paper, PRESET, plan) is not None for log in logs) <= 4


def test_the_machine_is_one_like_any_other(
    found: Identification, tmp_path: Path, paper: Problem
) -> None:
    path = found.save(tmp_path / "mine.toml")
    assert load_machine(path) == found.machine
    assert found.machine.worth is not None
    assert load_machine(path).worth == found.machine.worth
    assert not found.machine.worth.tested
    text = path.read_text("utf-8")
    assert "One number stands for several. lost motion: backlash, friction" in text
    problem = load_problem(
        Path(__file__).parents[2] / "problems/paper.toml", {"machine": found.machine.to_dict()}
    )
    assert Machine.from_table(problem.machine) == found.machine
    assert found.machine.effects["initial_play"] == PRESET.effects["initial_play"]
    assert not found.machine.effects["backlash_deg"].varies
    (tmp_path / "none.toml").write_text("a = 1\n", "utf-8")
    with pytest.raises(InputError, match=r"\[machine\]"):
        load_machine(tmp_path / "none.toml")


def test_doubts_are_told(paper: Problem, motion: Plan, plan: Plan) -> None:
    one_way = identify(emulate_log(plan, ARM, sample=1), paper, starts=1)
    assert any("joint 2, joint 3 never reverses" in text for text in one_way.warnings)
    assert "backlash of gearhead 1" in one_way.untold
    assert min(one_way[key].spread for key in ("w2", "w3")) > 0.5
    heavy = identify(emulate_log(motion, ARM.with_(fidelity="dynamic")), paper, starts=1)
    assert any("has an effect that the model lacks (inertia" in text for text in heavy.warnings)
    # What the model lacks does not become gear ratios, lags and friction (5.8, 14.6 %, 88 ms and
    # 0.77 N m before), which stay near the preset's.
    ratios = [abs(heavy[key].value) for key in ("ratio2", "ratio3")]
    assert max(ratios) < 3
    assert max(heavy[key].value for key in ("lag2", "lag3")) < 45
    assert heavy["friction3"].value == pytest.approx(heavy["friction3"].preset, rel=0.2)


@pytest.mark.parametrize(
    ("joint", "off"),
    [
        (1, 1.0),
        (2, -5.0),
        *(pytest.param(*each, marks=pytest.mark.campaign) for each in ((1, 5.0), (2, 1.0))),
    ],
)
def test_an_encoder_whose_zero_is_off_is_named(
    paper: Problem, motion: Plan, found: Identification, joint: int, off: float
) -> None:
    log = emulate_log(motion, ARM, sample=3)
    shift = np.deg2rad(off) * (np.arange(3) == joint - 1)
    shifted = identify(replace(log, theta=log.theta + shift), paper, starts=1)
    zero = shifted[f"zero{joint}"]
    assert abs(zero.value - off) < 3 * zero.spread < 0.25
    (text,) = shifted.warnings
    assert text.startswith(f"theta{joint} reads {shifted[f'zero{joint}'].value:.2f} +- 0.0")
    np.testing.assert_allclose(lost_deg(shifted.machine), lost_deg(found.machine), atol=0.03)
    for key, true in (("ratio2", 1.0), ("ratio3", -0.9)):  # one degree moved the latter by 1.15 %
        assert abs(shifted[key].value - true) < 3 * shifted[key].spread < 0.9
    prediction = shifted.predict(replace(log, theta=log.theta + shift))
    assert np.std(prediction.theta - shift - log.theta, axis=0).max() < np.deg2rad(0.06)


@pytest.mark.parametrize(
    "sample", [0, *(pytest.param(k, marks=pytest.mark.campaign) for k in range(1, 8))]
)
def test_zeros_that_are_right_give_no_warning(paper: Problem, motion: Plan, sample: int) -> None:
    found = identify(emulate_log(motion, PRESET, sample=sample, seed=sample), paper, starts=1)
    assert not found.warnings
    assert "zero1" not in {each.parameter.key for each in found.estimates}


@pytest.mark.campaign
def test_an_arm_of_four_joints_is_found(tmp_path: Path) -> None:
    problem = load_problem(Path(__file__).parents[2] / "problems/four-joint.toml")
    arm = PRESET.with_(backlash_deg=[2.0, 3.1, 3.6], shaft_stiffness_nm_per_rad=[3.0, 3.3, 3.6])
    found = identify(emulate_log(excitation(problem), arm.nominal()), problem, starts=1)
    np.testing.assert_allclose(lost_deg(found.machine, 4), lost_deg(arm, 4), atol=0.03)


def test_numpy_and_the_kernel_agree_on_a_log(paper: Problem, plan: Plan, use: Any) -> None:
    parameters = Parameters(PRESET, paper.system)  # type: ignore[arg-type]
    one = LogModel(emulate_log(plan, ARM), paper, parameters)
    x = np.stack([np.zeros(len(parameters.rows)), np.full(len(parameters.rows), 0.3)])
    offsets = np.deg2rad([[0.1, -0.2, 0.3], [0.0, 0.0, 0.0]])
    compiled = one.angles(x, offsets)
    use(None)
    np.testing.assert_allclose(one.angles(x, offsets), compiled, atol=1e-9)


def test_machines_of_parameters_have_them(paper: Problem) -> None:
    """Lost motion whatever its parts, and what is off in the preset is not looked for."""
    parameters = Parameters(PRESET, paper.system)  # type: ignore[arg-type]
    x = np.linspace(-0.8, 0.8, len(parameters.rows))
    values = dict(zip([row.key for row in parameters.rows], parameters.values(x), strict=True))
    machine = parameters.machine(x)
    wanted = np.rad2deg([values["w2"], values["w3"]])
    np.testing.assert_allclose(lost_deg(machine), wanted, rtol=1e-5)
    lags = machine.mean("viscous_friction_nms_per_rad") / machine.mean("shaft_stiffness_nm_per_rad")
    np.testing.assert_allclose(lags, [values["lag2"], values["lag3"]], rtol=1e-5)
    friction = machine.mean("coulomb_friction_nm")  # which loads the contacts
    np.testing.assert_allclose(friction, [values["friction2"], values["friction3"]], rtol=1e-5)
    rigid = Parameters(PRESET.without("shaft_stiffness_nm_per_rad"), paper.system)  # type: ignore[arg-type]
    keys = [row.key for row in rigid.rows]
    assert "lag2" not in keys
    assert rigid.machine(np.zeros(len(keys))).mean("backlash_deg") == pytest.approx(
        PRESET.mean("backlash_deg")[0]
    )
    ideal = Parameters(Machine.ideal(), paper.system)  # type: ignore[arg-type]
    keys = [row.key for row in ideal.rows]
    assert keys == ["w2", "w3", "ratio2", "ratio3", "gain2", "bias1", "bias2"]
    loose = ideal.machine(np.eye(len(keys))[0])
    assert loose.mean("backlash_deg")[0] > 0.5


def test_an_arm_with_inertia_is_among_those_looked_for(paper: Problem, motion: Plan) -> None:
    """Friction, backlash and twist apart; what the links did before the drive turned is left out.

    Looking for it takes two minutes; results/identification has such arms.
    """
    own: dict[str, Any] = {
        "coulomb_friction_nm": [0.167, 0.155],
        STIFFNESS: [3.9, 2.8],
        "backlash_deg": [4.4, 1.9],
        "servo_bandwidth_rad_s": [50.0, 90.0],
    }
    arm = PRESET.nominal().with_(
        **own, initial_play={"value": 0.0, "spread": 0.7}, fidelity="dynamic"
    )
    parameters = Parameters(Machine.prototype(fidelity="dynamic"), paper.system)  # type: ignore[arg-type]
    friction, stiffness = np.array(own["coulomb_friction_nm"]), arm.mean(STIFFNESS)
    lost = np.deg2rad(lost_deg(arm))
    viscous = arm.mean("viscous_friction_nms_per_rad") / stiffness
    values = {
        **{f"w{j}": w for j, w in enumerate(lost, 2)},
        **{f"friction{j}": f for j, f in enumerate(friction, 2)},
        **{f"twist{j}": share for j, share in enumerate(friction / stiffness / lost, 2)},
        **{f"lag{j}": lag for j, lag in enumerate(viscous, 2)},
        **{f"servo{i}": 0.005 + 1 / bandwidth for i, bandwidth in ((1, 50), (2, 90))},
    }
    rows = parameters.rows
    x = np.array([(values.get(row.key, row.value) - row.value) / row.prior for row in rows])
    machine = parameters.machine(x)
    for name, wanted in own.items():
        np.testing.assert_allclose(machine.mean(name), wanted, rtol=1e-5)
    log = emulate_log(motion, arm, sample=3)
    one = LogModel(log, paper, parameters)
    assert 4 < log.t[one.known] < 12
    gap = (one.angles(x[None], one.settled_offsets(x[None]))[0] - log.theta)[one.known :]
    np.testing.assert_allclose(np.sqrt(np.mean(gap**2, axis=0)), one.noise, rtol=0.25)
    assert model.known_row(log) < 1 / log.interval_s


@pytest.mark.parametrize(("noise", "step"), [(0.03, 0.0), (0.03, 0.088), (0.2, 0.0)])
def test_noise_is_read_from_the_log(motion: Plan, noise: float, step: float) -> None:
    machine = ARM.with_(encoder_resolution_deg=step, encoder_noise_deg=noise)
    log = emulate_log(motion, machine)
    expected = np.hypot(noise, step / np.sqrt(12))
    np.testing.assert_allclose(np.rad2deg(reading_noise(log)), expected, rtol=0.12)


def test_what_cannot_be_identified_is_refused(paper: Problem, motion: Plan) -> None:
    log = emulate_log(motion, ARM)

    def refused(words: str, logs: Any, problem: Problem = paper, **more: Any) -> None:
        with pytest.raises(InputError, match=words):
            identify(logs, problem, **more)

    still = replace(log, theta=log.theta * np.array([1.0, 1.0, 0.0]))
    refused("theta3 moves by less than 1 degree", still)
    refused("at least one log", [])
    refused("read_log", "runs/1.csv")
    refused("starts = 0", log, starts=0)
    refused("has 3 joints", log, Problem.manipulator([5, 5], [20, 20]))
    car = load_problem(Path(__file__).parents[2] / "problems/car.toml")
    refused("only machines of arms with friction disks", log, car)
    assert isinstance(log, Log)
