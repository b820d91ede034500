"""Compensation of an arm whose state before the start is known: what is taken up already stays."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Machine, Plan, Problem, compensate, replay, solve


@pytest.fixture(scope="module")
def plan(paper: Problem) -> Plan:
    return solve(paper, "collocation")


@pytest.mark.parametrize("state", ["forward", "backward"])
def test_the_nominal_machine_ends_at_the_goal_from_a_state_that_is_known(
    plan: Plan, state: str
) -> None:
    machine = Machine.prototype(start_state=state).nominal()
    better = compensate(plan, machine)
    run = replay(better, machine)
    assert run.terminal_E_deg[0] < 0.05
    assert better.notes["end_state"] == pytest.approx(run.end_state[0], abs=1e-3)
    unwound = compensate(plan, machine.with_(start_state="unwound"))
    assert replay(unwound, machine).terminal_E_deg[0] > 2  # as one that is not told ends
    if state == "forward":
        assert better.lead_s == 0
    else:  # twice the lost motion is to be taken up
        assert better.lead_s > unwound.lead_s
        assert np.isfinite(better.lead_s)
