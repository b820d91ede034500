"""verify and load_plan against an integrator of the tests' own, on plans and on damaged files."""

from __future__ import annotations

from pathlib import Path

import pytest
from outside_judge import campaign


@pytest.mark.parametrize(
    ("plans", "damages"), [(2, 16), pytest.param(200, 500, marks=pytest.mark.campaign)]
)
def test_both_judges_agree(plans: int, damages: int, tmp_path: Path) -> None:
    """No false accept, no false refusal; and there is something of both to tell apart."""
    tally, told = campaign(plans, damages, 25, tmp_path)
    assert not told
    assert tally["plans as they are", "both accept"] == plans
    for outcome in ("both accept", "both refuse", "no form"):
        assert sum(count for (_, each), count in tally.items() if each == outcome) >= damages / 10
