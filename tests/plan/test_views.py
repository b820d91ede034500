"""Replays as frames and datasets."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.support.package import how_to_install

PAPER = Path(__file__).parents[2] / "problems/paper.toml"


@pytest.fixture(scope="module")
def replay() -> planner.Replay:
    problem = planner.load_problem(
        PAPER, {"goal.travel": 0.825, "limits": {}, "goal.duration": 3.0}
    )
    plan = planner.solve(problem, "polynomial")
    return planner.replay(plan, samples=[4, 7, 9], seed=2, record_s=0.1)


def test_a_frame_has_a_row_a_machine(replay: planner.Replay) -> None:
    pytest.importorskip("pandas")
    frame = replay.to_frame()
    assert list(frame.index) == [4, 7, 9]
    np.testing.assert_array_equal(frame["E_deg"], replay.index_E_deg)
    np.testing.assert_array_equal(frame["terminal_theta3_deg"], replay.terminal_error_deg[:, 2])
    np.testing.assert_array_equal(frame["backlash_deg_2"], replay.draws["backlash_deg"][1])
    np.testing.assert_array_equal(
        frame["friction_capacity_nm"], replay.draws["friction_capacity_nm"][0]
    )
    assert "creep" not in frame, "what is the same for all machines is no column"
    assert frame.attrs["seed"] == 2


def test_a_dataset_names_samples_times_and_angles(replay: planner.Replay) -> None:
    pytest.importorskip("xarray")
    data = replay.to_xarray()
    angle = data.q.sel(sample=7, coordinate="theta2")
    np.testing.assert_array_equal(angle, replay.q[1, :, 2])
    np.testing.assert_array_equal(data.time, replay.t)
    np.testing.assert_array_equal(data.motor_rates.sel(input="u2"), replay.motor_rates[:, :, 1])
    assert data.unit_of_q.sel(coordinate="theta2") == "rad"


@pytest.mark.parametrize(("library", "view"), [("pandas", "to_frame"), ("xarray", "to_xarray")])
def test_a_library_that_is_missing_is_named(
    replay: planner.Replay, library: str, view: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    for owner in (replay, replay.plan):
        says = f"needs {library}; install it with: {how_to_install('tables')}"
        with pytest.raises(planner.InputError, match=re.escape(says)):
            getattr(owner, view)()
