"""What a robot of ROS 2 is sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import planner


@pytest.fixture
def sent(tmp_path: Path) -> Callable:
    """`sent(plan, rate_hz, joint_names)`: the message of the file that `planner.export` writes."""
    yaml = pytest.importorskip("yaml")

    def send(
        plan: planner.Plan, rate_hz: float = 100, joint_names: Sequence[str] | None = None
    ) -> Any:
        path = planner.export(
            plan, tmp_path / "sent.yaml", rate_hz=rate_hz, joint_names=joint_names
        )
        return yaml.safe_load(path.read_text("utf-8"))

    return send
