"""The errors a plan is designed against: which, and how large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from planner.errors import InputError
from planner.linearised import Parameter, parameters
from planner.schema.desensitised import DesensitisedOptions
from planner.systems.base import TriangularSystem


def spreads(system: TriangularSystem, options: DesensitisedOptions) -> dict[str, float]:
    """Standard deviation of each error by its name, in SI units; those without any are left out.

    Raises:
        InputError: If a list does not have one number an input, joint or constant, or all are zero.
    """
    families: dict[str, list[Parameter]] = {}
    for parameter in parameters(system):
        families.setdefault(parameter.family, []).append(parameter)
    starts = families["start"][1:]
    angles = [p for p in starts if p.unit == "rad"]
    lengths = [p for p in starts if p.unit != "rad"]
    given = [
        ("gain", families["gain"], options.gain, 1.0),
        ("bias", families["bias"], options.bias, 1.0),
        ("delay_s", families["delay"], options.delay_s, 1.0),
        ("stretch", families["stretch"], options.stretch, 1.0),
        ("start_deg", angles, options.start_deg, np.pi / 180),
        ("start_m", lengths, options.start_m, 1.0),
        ("gear", families.get("gear", []), options.gear, 1.0),
    ]
    out: dict[str, float] = {}
    for key, members, numbers, unit in given:
        out |= _family(key, members, numbers, unit)
    if not out:
        raise InputError(
            "method.desensitised: every spread is zero, so there is nothing to plan against; give"
            " gain, start_deg, bias, delay_s, stretch or gear a value"
        )
    return out


def _family(
    key: str, members: Sequence[Parameter], numbers: float | list[float], unit: float
) -> Mapping[str, float]:
    values = numbers if isinstance(numbers, list) else [numbers] * len(members)
    if len(values) != len(members):
        names = ", ".join(p.name for p in members) or "no parameter of this system"
        raise InputError(
            f"method.desensitised.{key} has {len(values)} values; give one number, or"
            f" {len(members)} for {names}"
        )
    named = zip(members, values, strict=True)
    return {p.name: float(value) * unit for p, value in named if value > 0}
