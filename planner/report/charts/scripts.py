"""The scripts and the style of charts in a browser, for whoever joins them with its own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from string import Template

from planner.report.figures.style import PALETTE

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
