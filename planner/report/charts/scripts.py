"""Join the charts' scripts and style sheet with those of another package."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from string import Template

from planner.report.figures.style import PALETTE

CHARTS = "planner.report.charts"
SCRIPTS = ("scale.js", "chart.js", "over_time.js", "plane.js")
STYLE = "charts.css"


def script(room: str, names: Sequence[str]) -> str:
    """Return the charts' scripts followed by the script files `names` of the package `room`."""
    charts = [source(CHARTS, name) for name in SCRIPTS]
    return "\n".join(charts + [source(room, name) for name in names])


def stylesheet(room: str, name: str) -> str:
    """Return the charts' style sheet and the style sheet `name` of the package `room` as one text.

    It defines the plans' colours on light and on dark.
    """
    each = range(len(PALETTE))
    return Template(source(CHARTS, STYLE) + source(room, name)).substitute(
        classes=" ".join(f".charts .plan-{k} {{ color: var(--plan-{k}); }}" for k in each),
        light=" ".join(f"--plan-{k}: {PALETTE[k][1]};" for k in each),
        dark=" ".join(f"--plan-{k}: {PALETTE[k][2]};" for k in each),
    )


def source(package: str, name: str) -> str:
    """Return the text of a file in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")
