"""What the charts are fed: plans and panels as plain data, of one shape for page and explorer.

A *plan* has `label`, `refused`, `duration`, the times `t` of its curves, and the number of its
`colour`.

A *panel* has `kind`, `title`, `unit` and `series`. A series belongs to a `plan` (its place in the
list); it has values `y` at that plan's times or at its own `t`, and a `name` and `colour` where
these are not the plan's. Of kind "time" a panel may also have

- `band`: `low` and `high` at the times of the first series, with a `name` or without,
- `limits`: values that lines are drawn at; `floor`: what lies below is shaded; `zero`: in view,
- `ends`: values at start and end; `stops` and `marks`: points [t, value] on the way, of waypoints
  and where the domain is left,
- `view`: least and greatest value shown; `notes`: peaks beyond it,
- `note`: a few words beside the title.

Numbers that do not exist are None. Angles are in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from planner.plan.plan import Plan
from planner.report.figures.over_time import has_band, z2_band
from planner.report.figures.style import PALETTE
from planner.support.arrays import Array
from planner.systems.triangular_system import Coordinate

Panel = dict[str, Any]

TINY = 1e-12
"""What is smaller is rounding, and would be read as a number with an exponent."""

NEAR = 0.75
"""Part of a limit from which on it is drawn."""

DIGITS = 5
"""More significant digits than a screen shows."""

CHARTS = "planner.report.charts"
SCRIPTS = ("scale.js", "chart.js", "over_time.js", "plane.js")
STYLE = "charts.css"


def script(room: str, names: Sequence[str]) -> str:
    """The charts' scripts, and after them those of a package, as one."""
    charts = [source(CHARTS, name) for name in SCRIPTS]
    return "\n".join(charts + [source(room, name) for name in names])


def stylesheet(room: str, name: str) -> str:
    """The charts' style, and after it that of a package; both with the colours of plans."""
    text = Template(source(CHARTS, STYLE) + source(room, name))
    each = range(len(PALETTE))
    return text.substitute(
        classes=" ".join(f".charts .plan-{k} {{ color: var(--plan-{k}); }}" for k in each),
        light=" ".join(f"--plan-{k}: {PALETTE[k][1]};" for k in each),
        dark=" ".join(f"--plan-{k}: {PALETTE[k][2]};" for k in each),
    )


def source(package: str, name: str) -> str:
    """What a file that lies in a package says."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def over_time(title: str, unit: str, series: Sequence[Panel], **more: Any) -> Panel:
    """A panel over time; see above."""
    return {"kind": "time", "title": title, "unit": unit, "series": list(series), **more}


def curve(plan: int, values: Array, **more: Any) -> Panel:
    """A series of a panel over time."""
    return {"plan": plan, "y": to_screen_digits(values), **more}


def band(plan: Plan, t: Array, **more: Any) -> Mapping[str, Any]:
    """What a panel of z₂ has besides its curve: where a real θ₁ exists, and where it is left."""
    if not has_band(plan.problem.system):
        return {}
    low, high = z2_band(plan, t)
    out = np.array([] if plan.executable else plan.domain.exits_s)
    marks = np.stack([out, plan.z(out)[:, 1]], axis=1).tolist()
    return {
        "band": {"low": to_screen_digits(low), "high": to_screen_digits(high), **more},
        "marks": marks,
    }


def near(values: Array, limit: float) -> list[float]:
    """±limit, where values come near it; elsewhere its line would only make the curves small."""
    reach = [(side, np.nanmax(side * values, initial=-np.inf)) for side in (-1, 1)]
    return [side * limit for side, most in reach if np.isfinite(limit) and most > NEAR * limit]


def to_screen_digits(values: Array) -> list[Any]:
    """Numbers to so many significant digits as a screen can show; None for those there are not."""
    values = np.asarray(values, dtype=float)
    finite, size = np.isfinite(values), np.abs(values)
    seen = finite & (size >= TINY)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(np.where(seen, size, 1.0))))
    short = (np.round(np.where(seen, values, 0.0) * scale) / scale).astype(object)
    short[~finite] = None
    out: list[Any] = short.tolist()
    return out


def unit_of(coordinate: Coordinate) -> str:
    """The unit a coordinate is shown in."""
    return "deg" if coordinate.unit == "rad" else coordinate.unit
