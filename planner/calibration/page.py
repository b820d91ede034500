"""The page that goes with a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.calibration.fit import Fit
from planner.calibration.identify import ENCODER_DEG, READ_DEG, READ_PERCENT, SPEEDS, Data, leading
from planner.calibration.ranges import FITTED, FIXED
from planner.calibration.statements import STATEMENTS, Motion
from planner.machine import Machine
from planner.schema.machine import EFFECTS

_HEAD = """# The prototype preset: calibrated, not measured

The paper gives no data sheet of its prototype. It says that the error of theta3 reached 5 degrees
(Fig. 9, eq. 29), that the speed of the motors was controlled precisely (Fig. 10), and blames
backlash of the bevel gears, the low stiffness of the long shaft, transmission parts of low
resolution and a lack of drive torque. `Machine.prototype()` has the most probable parameters given
that and the range of parts of each kind. Made by

    planner calibrate --out results/calibration

The experiment's travel and inputs are not printed; it is replaced by the paper's polynomial law at
the travel of least peak input that stays inside the chart's domain.

![errors, motor speeds, and what is left of each range](calibration.png)
"""


def page(
    fit: Fit,
    settings: Mapping[str, Any],
    data: Sequence[Data],
    motions: Mapping[str, Motion],
    medians: Mapping[str, Sequence[float]],
    machines: int,
) -> str:
    """Markdown.

    Args:
        fit: The most probable parameters.
        settings: The preset's entries for them.
        data: What can be told from what.
        motions: The nominal machine, by fidelity.
        medians: Median of the largest error of each angle over machines with spreads, deg.
        machines: How many.
    """
    return "\n".join(
        [
            _HEAD,
            "## What the paper says, and what the preset does\n",
            _statements(fit),
            "## The two fidelities\n",
            _fidelities(motions, medians, machines),
            "## Parameters\n",
            _parameters(settings, data),
            "## What can be identified\n",
            _identified(data),
            "## Not fitted\n",
            _fixed(),
        ]
    )


def _statements(fit: Fit) -> str:
    rows = [
        [s.text, f"{s.target:g} {s.unit}", f"{s.tolerance:g} {s.unit}", f"{found:.2f} {s.unit}"]
        for s, found in zip(STATEMENTS, fit.found, strict=True)
    ]
    return _table(["statement", "target", "taken as known to", "preset"], rows)


def _fidelities(
    motions: Mapping[str, Motion], medians: Mapping[str, Sequence[float]], machines: int
) -> str:
    rows = []
    for name, motion in motions.items():
        largest, gap = motion.largest[0], motion.statements[0, 1:]
        rows.append(
            [name, _degrees(largest), _degrees(motion.error[0, -1]), _degrees(medians[name]),
             " / ".join(f"{g:.2f}" for g in gap)]
        )  # fmt: skip
    head = ["fidelity", "largest errors (deg)", "at the end (deg)"]
    head += [f"median largest of {machines} machines (deg)", "motors off (% of peak, rms)"]
    still, moving = (motions[name].error[0] for name in ("quasi-static", "dynamic"))
    apart = np.max(np.abs(still - moving), axis=0)
    text = f"theta1 / theta2 / theta3. The two differ by at most {_degrees(apart)} deg at any time."
    more = (
        " theta2 is off by as much as theta3, since both joints are given equal parts; the paper"
        " does not say how far theta2 was off."
    )
    return _table(head, rows) + "\n" + text + more + "\n"


def _parameters(settings: Mapping[str, Any], data: Sequence[Data]) -> str:
    rows = []
    for i, r in enumerate(FITTED):
        value = settings[r.name]
        shown = (
            f"{value['value']:g} ± {value['spread']:g}" if isinstance(value, dict) else f"{value:g}"
        )
        left = [f"{d.left[i]:.2f}" for d in data]
        rows.append([f"`{r.name}`", EFFECTS[r.name].unit or "1", f"{r.low:g} ... {r.high:g}", shown,
                     *left, r.source])  # fmt: skip
    head = ["parameter", "unit", "range (95 %)", "preset"]
    text = (
        "± is the spread from machine to machine. The columns after it tell which part of the range"
        " is left once something is known: 1 means not identifiable from it.\n\n"
    )
    return text + _table([*head, *(d.name for d in data), "source of the range"], rows)


def _identified(data: Sequence[Data]) -> str:
    text = (
        "Singular values of the sensitivity of what is observed, in units of its error of reading,"
        " to the parameters, in units of their ranges (dynamic fidelity). Along a direction with a"
        " value above 1 the data say more than the range does; along the others nothing is known"
        f" but the range. Curves read off a figure: {READ_DEG:g} deg, {READ_PERCENT:g} % of the"
        f" peak; encoders: {ENCODER_DEG:g} deg, at {', '.join(f'{f:g}' for f in SPEEDS)} times the"
        " duration.\n\n"
    )
    rows = []
    for d in data:
        values = ", ".join(f"{s:.3g}" for s in d.singular[:8])
        blind = [f"`{r.name}`" for r, left in zip(FITTED, d.left, strict=True) if left > 0.9]
        rows.append(
            [d.name, str(d.count), f"{d.rank} of {len(d.left)}", values, "; ".join(blind) or "none"]
        )
    table = _table(
        ["data", "numbers", "identified directions", "largest singular values",
         "parameters left as they were (> 0.9)"], rows
    )  # fmt: skip
    said = data[0]
    lines = [
        f"{k + 1}. s = {said.singular[k]:.3g}: "
        + ", ".join(f"{part:+.2f} `{name}`" for name, part in leading(said, k).items())
        for k in range(3)
    ]
    return (
        text + table + "\nWhat the paper's words fix is the first of these directions and nothing"
        " else (parts of a unit vector of standardised logarithms):\n\n" + "\n".join(lines) + "\n\n"
        "So one number cannot tell wind-up (friction over stiffness), play and creep apart: a"
        " machine with more of one and less of another fits as well. Half of a joint's play goes"
        " into its error, all of its wind-up does, and the range of the latter is the wider one:"
        " hence the weights. Torque limits and the capacity of the contacts, the paper's 'lack of"
        " drive torque', are not reached at the paper's speed, so that nothing is learnt of them.\n"
    )


def _fixed() -> str:
    effects = Machine.prototype().to_dict()
    rows = []
    for name, why in FIXED.items():
        value = effects[name]
        shown = (
            f"{value['value']:g} ± {value['spread']:g}" if isinstance(value, dict) else f"{value:g}"
        )
        rows.append([f"`{name}`", shown, EFFECTS[name].unit or "1", why])
    return _table(["parameter", "preset", "unit", "why"], rows)


def _degrees(numbers: Any) -> str:
    return " / ".join(f"{x:.2f}" for x in numbers)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
