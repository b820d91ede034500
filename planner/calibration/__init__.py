"""The prototype preset, calibrated against what the paper says of its experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.calibration.fit import Fit, fit, rounded
from planner.calibration.identify import Data, identify
from planner.calibration.page import page
from planner.calibration.picture import picture
from planner.calibration.ranges import FITTED, FIXED, SPREADS, Range
from planner.calibration.statements import STATEMENTS, Motion, calibration_plan, move, nominal
from planner.files import folder
from planner.machine import Machine
from planner.plan import Plan
from planner.replay import Replay, replay

__all__ = ["FITTED", "FIXED", "Calibration", "Range", "calibrate", "write"]

MACHINES = 500
"""Samples whose median is compared with the paper."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Calibration:
    """What `calibrate` found.

    Attributes:
        plan: The plan that stands for the paper's experiment.
        fit: The most probable parameters.
        data: What the paper's words, its curves and better records tell about them.
        motions: The plan on the nominal machine, by fidelity.
        replays: The plan on machines with all spreads, by fidelity.
    """

    plan: Plan
    fit: Fit
    data: tuple[Data, ...]
    motions: dict[str, Motion]
    replays: dict[str, Replay]

    @property
    def settings(self) -> dict[str, Any]:
        """The fitted part of the prototype preset, as it stands in `planner.machine.presets`."""
        return {name: setting(name, value) for name, value in self.fit.parameters.items()}

    def to_dict(self) -> dict[str, Any]:
        """The preset's entries, the paper's statements, and what is identified; JSON-ready."""
        statements = [
            {"text": s.text, "target": s.target, "unit": s.unit, "found": float(value)}
            for s, value in zip(STATEMENTS, self.fit.found, strict=True)
        ]
        identified = [
            {
                "data": d.name,
                "rank": d.rank,
                "singular_values": d.singular.tolist(),
                "left": dict(zip(self.settings, d.left.tolist(), strict=True)),
            }
            for d in self.data
        ]
        return {"preset": self.settings, "statements": statements, "identified": identified}


def setting(name: str, value: float) -> Any:
    """A number, or value and spread for what differs from machine to machine."""
    spread = SPREADS.get(name)
    return {"value": value, "spread": rounded(value * spread)} if spread else value


def calibrate(progress: Progress | None = None, seed: int = 0) -> Calibration:
    """Fit the prototype to the paper, and find out what the paper cannot tell.

    Args:
        progress: Called with what is being done and the share done, 0 … 1.
        seed: Of the machines with spreads.
    """
    say = progress or (lambda what, share: None)
    say("planning the paper's motion", 0.0)
    plan = calibration_plan()
    say("fitting", 0.05)
    found = fit(plan)
    say("finding out what can be told", 0.5)
    data = identify(plan, found)
    say("replaying in both fidelities", 0.75)
    machine = nominal(found.parameters)
    spread = {name: setting(name, value) for name, value in found.parameters.items()}
    motions, replays = {}, {}
    for fidelity in ("quasi-static", "dynamic"):
        motions[fidelity] = move(plan, machine.with_(fidelity=fidelity), [found.parameters])
        many = Machine.prototype(step_s=machine.step_s, fidelity=fidelity, **spread)
        replays[fidelity] = replay(plan, many, MACHINES, seed, record_s=None)
    return Calibration(plan, found, data, motions, replays)


def write(calibration: Calibration, path: str | Path) -> Path:
    """Write README.md and the figure.

    Args:
        calibration: What to write.
        path: The folder; an earlier run's is replaced, and only when all is written.

    Raises:
        InputError: If the folder cannot be written or holds something else.
    """
    c = calibration
    medians = {
        name: np.median(run.largest_error_deg, axis=0).tolist() for name, run in c.replays.items()
    }
    with folder(path) as place:
        figure = picture(c.plan, c.motions, c.data)
        figure.savefig(place / "calibration.png", dpi=110, bbox_inches="tight")
        text = page(c.fit, c.settings, c.data, c.motions, medians, MACHINES)
        (place / "README.md").write_text(text, encoding="utf-8")
    return Path(path)
