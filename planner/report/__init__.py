"""Figures, films and pages of plans and comparisons.

`figures` (one `plot_*` each), `film`, `charts` (in a browser), `page` (a comparison there),
`panels` (what of plans is drawn, for all of these),
`folders` (all of it in a folder) and `saved` (read back), `export` (a plan for other programs).

Every `plot_*` function takes plans (or replays), draws into axes of yours or a new figure, and
returns both: `figure, axes = plot_z({"one": plan, "other": plan2})`. `plot_mechanism` takes an arm,
`plot_design` a study of designs.
"""

from typing import TYPE_CHECKING

from planner.support.package import import_when_used

if TYPE_CHECKING:
    from planner.report.figures.arm import plot_arm
    from planner.report.figures.design import plot_design
    from planner.report.figures.mechanism import plot_mechanism
    from planner.report.figures.on_the_machine import plot_efforts, plot_errors, plot_replays
    from planner.report.figures.over_time import plot_inputs, plot_joints, plot_map, plot_z
    from planner.report.figures.robustness import (
        plot_budget,
        plot_machine_sensitivity,
        plot_responses,
        plot_sensitivity,
        plot_trade_off,
    )
    from planner.report.film import animate
    from planner.report.page.page import write_report
    from planner.report.saved import load_comparison

_HOMES = {
    "figures.arm": "plot_arm",
    "figures.design": "plot_design",
    "figures.mechanism": "plot_mechanism",
    "figures.on_the_machine": "plot_efforts plot_errors plot_replays",
    "figures.over_time": "plot_inputs plot_joints plot_map plot_z",
    "figures.robustness": "plot_budget plot_machine_sensitivity plot_responses "
    "plot_sensitivity plot_trade_off",
    "film": "animate",
    "page.page": "write_report",
    "saved": "load_comparison",
}
import_when_used(__name__, _HOMES)

__all__ = [
    "animate",
    "load_comparison",
    "plot_arm",
    "plot_budget",
    "plot_design",
    "plot_efforts",
    "plot_errors",
    "plot_inputs",
    "plot_joints",
    "plot_machine_sensitivity",
    "plot_map",
    "plot_mechanism",
    "plot_replays",
    "plot_responses",
    "plot_sensitivity",
    "plot_trade_off",
    "plot_z",
    "write_report",
]
