"""The prototype preset is what the calibration gives, and what cannot be told is not told."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import main

import planner.paper.calibrate as calibration
import planner.paper.fit as fitting
from planner import Machine
from planner.paper.calibrate import Calibration, calibrate, write
from planner.paper.fit import (
    BOUNDS,
    FITTED_PARAMETERS,
    FIXED_PARAMETERS,
    TOLERANCES,
    Fit,
    move,
    nominal_machine,
    statement_values,
    values,
)

COMMAND = import_module("planner.cli.paper")


@pytest.fixture(scope="module")
def made() -> Calibration:
    def fit(*given: Any, **changes: Any) -> Fit:
        with pytest.MonkeyPatch.context() as coarse:
            if changes:  # of another friction, to be told from the preset's, no more
                coarse.setattr(fitting, "FIT_TOLERANCE", 0.2)
            return fitting.fit(*given, **changes)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "fit", fit)
        patch.setattr(calibration, "MACHINES", 200)
        patch.setattr(calibration, "LATERAL_FRICTIONS", (0.3,))
        return calibrate()


def test_the_preset_is_the_calibration(made: Calibration) -> None:
    """To a unit of the last of its three digits, so that it holds on any computer."""
    preset = Machine.prototype().to_dict()
    for name, setting in made.settings.items():
        for ours, theirs in zip(parts(preset[name]), parts(setting), strict=True):
            assert ours == pytest.approx(theirs, rel=1e-2), name
            assert float(f"{ours:.3g}") == ours
    fit = coordinates(preset_values())
    assert np.max(np.abs(fit - made.fit.x)) < 0.02  # of a standard deviation of the range


def coordinates(parameters: dict[str, float]) -> np.ndarray:
    """The inverse of `values`."""
    return np.array([np.log(parameters[r.key] / r.centre) / r.width for r in FITTED_PARAMETERS])


def parts(setting: object) -> list[float]:
    numbers = setting.values() if isinstance(setting, dict) else [setting]
    return [float(x) for part in numbers for x in np.atleast_1d(part)]


def preset_values() -> dict[str, float]:
    """The preset's fitted parameters, by their keys."""
    preset = Machine.prototype().to_dict()
    place = {r.key: 0 if r.joint is None else r.joint - 2 for r in FITTED_PARAMETERS}
    return {r.key: parts(preset[r.name])[place[r.key]] for r in FITTED_PARAMETERS}


def test_it_says_what_the_paper_says(made: Calibration) -> None:
    theta3, theta2, *motors, torque = made.fit.values
    assert theta3 == pytest.approx(5.0, abs=0.1)  # as it is read off the figure
    assert theta2 < 5.01  # E is the largest of all joints; 0.01 by the digits of the preset
    assert 10 < torque < 30  # % of the limit
    assert max(motors) < 0.5  # % of the peak
    for run in made.replays.values():
        assert np.median(run.largest_error_deg[:, 2]) == pytest.approx(5.2, abs=0.5)


def test_friction_sideways_is_bounded_from_above_and_no_more(made: Calibration) -> None:
    """The usual ratio is met by parts within their ranges; 0.3 is not."""
    distance = {ratio: fit.distance for ratio, fit in made.sideways.items()}
    assert list(distance) == [0.1, 0.3]
    assert distance[0.1] < 1.5 < 3 < distance[0.3]
    for fit in made.sideways.values():
        assert fit.values[0] == pytest.approx(5.0, abs=0.1)
        assert fit.values[1] < 5.01


@pytest.mark.campaign
def test_friction_sideways_up_to_a_fifth_is_met(made: Calibration) -> None:
    assert made.fit.distance < fitting.fit(made.plan, lateral_friction=0.2).distance < 1.5


def test_a_bound_counts_where_it_is_exceeded(made: Calibration) -> None:
    """Without it theta2 is above 5 degrees; a bound that is kept moves nothing."""

    def fitted(bound: float) -> Fit:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fitting, "TARGETS", np.array([5.0, bound, 0.0, 0.0, 100.0]))
            patch.setattr(fitting, "FIT_TOLERANCE", 0.2)
            return fitting.fit(made.plan)

    loose, looser = fitted(5.5), fitted(7.0)
    assert 5.1 < loose.values[1] < 5.4
    assert loose.values[0] == pytest.approx(5.0, abs=0.02)
    assert np.array_equal(loose.x, looser.x)
    assert np.linalg.norm(made.fit.x) > np.linalg.norm(loose.x) + 0.01


def test_every_effect_of_the_prototype_has_a_reason() -> None:
    fitted = [r.name for r in FITTED_PARAMETERS]
    assert set(fitted) | set(FIXED_PARAMETERS) == set(Machine.prototype().effects)
    assert not set(fitted) & set(FIXED_PARAMETERS)
    for r in FITTED_PARAMETERS:
        assert r.low < preset_values()[r.key] < r.high
        assert r.source
        assert values(coordinates({q.key: q.high for q in FITTED_PARAMETERS}))[
            r.key
        ] == pytest.approx(r.high)


def test_the_papers_words_fix_one_direction_and_curves_more(made: Calibration) -> None:
    words, curves, records = made.data
    assert words.rank == 1
    assert 1 < curves.rank < records.rank <= len(FITTED_PARAMETERS)
    assert np.all(words.remaining <= 1 + 1e-12)
    names = [r.key for r in FITTED_PARAMETERS]
    assert words.remaining[names.index("torque_limit_nm")] == pytest.approx(1, abs=1e-6)
    assert words.remaining[names.index("friction_capacity_nm")] > 0.99  # only by what slides
    assert words.remaining[names.index("coulomb_friction_nm of joint 3")] < 0.7
    assert np.mean(records.remaining) < np.mean(curves.remaining) < np.mean(words.remaining)


def test_sensitivities_foretell_what_a_changed_machine_does(made: Calibration) -> None:
    """Along the identified direction the error moves as the singular value says; across, not."""
    words, size = made.data[0], 0.2
    known, unknown = words.directions[0], words.directions[5]
    points = [values(made.fit.x + size * d) for d in (0 * known, known, unknown)]
    seen = (statement_values(made.plan, points) / TOLERANCES)[:, ~BOUNDS]
    assert np.linalg.norm(seen[1] - seen[0]) == pytest.approx(size * words.singular[0], rel=0.1)
    assert np.linalg.norm(seen[2] - seen[0]) < 0.01 * size * words.singular[0]
    assert (
        np.linalg.norm(np.log(list(points[2].values())) - np.log(list(points[0].values()))) > 0.03
    )


def test_half_of_a_joints_own_play_goes_into_its_error(made: Calibration) -> None:
    machine = nominal_machine(made.fit.parameters).without("backlash_deg")
    none, second, third = (
        move(made.plan, machine.with_(backlash_deg=gaps), [{"creep": 0.003}]).largest[0, 2]
        for gaps in ([0.0, 0.0], [2.7, 0.0], [0.0, 2.7])
    )
    assert third - none == pytest.approx(2.7 / 2, rel=0.05)
    assert second == pytest.approx(none, abs=0.05)


def test_the_folder(made: Calibration, tmp_path: Path) -> None:
    place = write(made, tmp_path / "calibration")
    text = (place / "README.md").read_text()
    assert "planner calibrate --out results/calibration" in text
    assert all(f"`{r.key}`" in text and r.source in text for r in FITTED_PARAMETERS)
    assert all(f"`{name}`" in text for name in FIXED_PARAMETERS)
    rows = [line for line in text.splitlines() if line.startswith("| largest error of theta")]
    for row, target, joint in zip(rows, ("5 deg", "at most 5 deg"), (2, 1), strict=True):
        found = made.motions["quasi-static"].largest[0, joint]
        assert f"| {target} |" in row
        assert f"| {found:.2f} deg |" in row
    assert (place / "calibration.png").stat().st_size > 10_000


def test_the_command(
    made: Calibration, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(COMMAND, "run_calibration", lambda progress, seed: made)
    assert main(["calibrate", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["preset"] == made.settings
    assert found["identified"][0]["rank"] == 1
    assert main(["calibrate"]) == 0
    assert "coulomb_friction_nm" in capsys.readouterr().out


def test_a_folder_of_other_things_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(COMMAND, "run_calibration", lambda progress, seed: pytest.fail("worked"))
    (tmp_path / "mine.txt").write_text("keep")
    assert main(["calibrate", "--out", str(tmp_path)]) == 2
    assert "holds files that are not from an earlier run" in capsys.readouterr().err
