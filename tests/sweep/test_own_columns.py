"""Columns of a sweep: those that it has, and those that a row declares, are filled."""

from __future__ import annotations

from dataclasses import make_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from databases import query

import planner
from planner import Replay
from planner.comparison import rows
from planner.machine.replay import ERRORS, STATISTICS, MotionError, Statistic
from planner.sweep.case import RESULTS
from planner.verification.summary import Heading, figure

MACHINES = 3
OVERSHOOT = "overshoot_p95_deg"
OTHERWISE = ("why", "advice", "traceback", "plan")
"""Columns of refused cases, and of cases whose plans are kept."""


def overshoot_deg(run: Replay) -> Any:
    """Largest angle of joint 3 beyond the plan's, over the recorded motion, (S,)."""
    return np.rad2deg((run.q[..., 3] - run.plan.trajectory.q(run.t)[..., 3]).max(axis=1))


@pytest.fixture
def new_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """A statistic of motions as CONTRIBUTING says, and figures with each combination of flags."""
    monkeypatch.setitem(ERRORS, "overshoot", MotionError("joint 3 beyond the plan", overshoot_deg))
    monkeypatch.setitem(STATISTICS, OVERSHOOT, Statistic("overshoot", 95))
    fields: list[Any] = [(OVERSHOOT, float, rows._statistic(OVERSHOOT))]
    for files in (False, True):
        of = {"files": files, "replay": lambda run: float(len(run.numbers))}
        fields.append((f"of_replay_{files}", float, figure(Heading("x"), **of)))
        of = {"files": files, "replay": lambda run: (1.0, 2.0), "default": (np.nan, np.nan)}
        heads = (Heading("a", key=f"a_{files}"), Heading("b", key=f"b_{files}"))
        fields.append((f"pair_{files}", tuple, figure(*heads, **of)))
        plan = {"files": files, "plan": lambda plan, _: plan.duration}
        fields.append((f"of_plan_{files}", float, figure(Heading("y"), **plan)))
        fields.append((f"bare_{files}", float, figure(**plan)))
        fields.append((f"of_nothing_{files}", float, figure(Heading("z"), files=files)))
    made = make_dataclass("Row", fields, bases=(rows.Row,), frozen=True, repr=False)
    monkeypatch.setattr(rows, "Row", made)
    for name in rows.sweep_columns():
        monkeypatch.setitem(RESULTS, name, "REAL")  # type: ignore[arg-type]


@pytest.mark.usefixtures("new_columns")
def test_a_sweep_fills_every_column(paper: planner.Problem, tmp_path: Path) -> None:
    problem = paper.changed({"goal.travel": 0.82, "limits": {}})
    replays = {"samples": MACHINES, "seed": 4}
    tables = {"problem": problem.to_dict(), "methods": ["polynomial"], "replay": replays}
    grid = {"grid": {"goal.duration": [10.0]}}
    db = tmp_path / "x.sqlite"
    planner.run_sweep({**tables, **grid}, db, workers=0)
    names = [name for name in RESULTS if name not in OTHERWISE]
    assert set(rows.sweep_columns()) <= set(names)
    (values,) = query(db, f"SELECT {', '.join(names)} FROM cases")
    row = dict(zip(names, values, strict=True))
    assert [name for name, value in row.items() if value is None] == []
    assert not any("of_nothing" in name for name in names)
    assert {key: row[key] for key in ("a_True", "b_True", "a_False", "b_False")} == {
        "a_True": 1.0, "b_True": 2.0, "a_False": 1.0, "b_False": 2.0,
    }  # fmt: skip
    plan = planner.solve(problem.changed({"goal.duration": 10.0}), "polynomial")
    run = planner.replay(plan, samples=MACHINES, seed=4, record_s=max(0.02, plan.duration / 500))
    assert row[OVERSHOOT] == pytest.approx(np.percentile(overshoot_deg(run), 95), rel=1e-12)
    assert row[OVERSHOOT] == run.to_dict()[OVERSHOOT]


def test_a_statistic_of_motions_takes_all_machines_whatever_is_kept(
    paper: planner.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ERRORS, "overshoot", MotionError("joint 3 beyond the plan", overshoot_deg))
    plan = planner.solve(paper.changed({"goal.travel": 0.82, "limits": {}}), "polynomial")
    found = {
        kept: Statistic("overshoot", 95).of(planner.replay(plan, samples=MACHINES, motions=kept))
        for kept in (None, 0, 1)
    }
    assert found[0] == found[1] == found[None]
