"""What is shown of plans and comparisons: figures, tables, films.

Every `plot_*` function takes plans (or replays), draws into axes of yours or a new figure, and
returns both: `figure, axes = plot_z({"one": plan, "other": plan2})`.
"""

from typing import TYPE_CHECKING

from planner.lazy import import_when_used

if TYPE_CHECKING:
    from planner.report.animation import animate
    from planner.report.arm import plot_arm
    from planner.report.errors import plot_errors
    from planner.report.html import write_report
    from planner.report.inputs import plot_inputs
    from planner.report.joints import plot_joints
    from planner.report.load import load_comparison
    from planner.report.replays import plot_replays
    from planner.report.responses import plot_machine_sensitivity, plot_responses, plot_sensitivity
    from planner.report.trade_off import plot_trade_off
    from planner.report.z import plot_z

_HOMES = {
    "animation": "animate",
    "arm": "plot_arm",
    "errors": "plot_errors",
    "html": "write_report",
    "inputs": "plot_inputs",
    "joints": "plot_joints",
    "load": "load_comparison",
    "replays": "plot_replays",
    "responses": "plot_machine_sensitivity plot_responses plot_sensitivity",
    "trade_off": "plot_trade_off",
    "z": "plot_z",
}
import_when_used(__name__, _HOMES)

__all__ = [
    "animate",
    "load_comparison",
    "plot_arm",
    "plot_errors",
    "plot_inputs",
    "plot_joints",
    "plot_machine_sensitivity",
    "plot_replays",
    "plot_responses",
    "plot_sensitivity",
    "plot_trade_off",
    "plot_z",
    "write_report",
]
