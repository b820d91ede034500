"""Sensitivities as a folder, written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.differences import MachineSensitivity
from planner.display import csv_text
from planner.files import folder, write_text
from planner.jsonable import jsonable
from planner.report.responses import plot_machine_sensitivity, plot_responses, plot_sensitivity
from planner.sensitivity import Sensitivity


def save_sensitivity(
    found: Sensitivity,
    machine: MachineSensitivity | None,
    spread: Mapping[str, float],
    path: str | Path,
    extra: Mapping[str, Any] | None = None,
) -> Path:
    """Write sensitivity.json, matrix.csv, plan.json, heat-map.png, along.png and machine.png.

    Args:
        found: Of a plan's own parameters.
        machine: Of the machine's, or None.
        spread: Standard deviations of the errors.
        path: The folder; an earlier run's is replaced, and only when all is written.
        extra: Further keys of sensitivity.json.

    Raises:
        InputError: If the folder cannot be written or holds something else; nothing is left behind.
    """
    with folder(path) as place:
        data = {
            **(extra or {}),
            **found.to_dict(spread),
            "machine": None if machine is None else machine.to_dict(),
        }
        text = json.dumps(jsonable(data), indent=1, allow_nan=False)
        write_text(place / "sensitivity.json", text + "\n")
        write_text(place / "matrix.csv", _csv(found))
        found.plan.save(place / "plan.json")
        plot_sensitivity(found, spread)[0].savefig(place / "heat-map.png", dpi=120)
        plot_responses(found, spread)[0].savefig(place / "along.png", dpi=120)
        if machine is not None:
            plot_machine_sensitivity(machine)[0].savefig(place / "machine.png", dpi=120)
    return Path(path)


def _csv(found: Sensitivity) -> str:
    """S(T): one row a coordinate, one column a parameter, units beside the names."""
    named = zip(found.parameters, found.units, strict=True)
    rows = [["coordinate", *(f"{name} ({unit})" for name, unit in named)]]
    for c, row in zip(found.plan.problem.system.coordinates, found.terminal, strict=True):
        rows.append([f"{c.name} ({c.unit})", *(f"{value:.10g}" for value in row)])
    return csv_text(rows)
