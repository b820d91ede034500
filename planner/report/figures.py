"""All figures of a comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

from planner.report.arm import drawable, plot_arm
from planner.report.efforts import plot_efforts
from planner.report.errors import plot_errors
from planner.report.inputs import plot_inputs
from planner.report.joints import plot_joints
from planner.report.replays import plot_replays
from planner.report.z import plot_z

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.comparison import Comparison


def figures(comparison: Comparison) -> dict[str, Figure]:
    """Figures by name; those for which no plan has what they show are left out."""
    plans = comparison.plans
    found = [plan for plan in plans.values() if plan is not None]
    out: dict[str, Figure] = {}
    if found:
        out["z"] = plot_z(plans)[0]
    if any(plan.executable for plan in found):
        out["joints"] = plot_joints(plans)[0]
        out["inputs"] = plot_inputs(plans)[0]
        if drawable(comparison.problem.system):
            out["arm"] = plot_arm(plans)[0]
    replays = {row.label: row.replay for row in comparison.rows}
    if any(runs is not None and runs.angles for runs in replays.values()):
        errors = {k: None if runs is None else runs.index_E_deg for k, runs in replays.items()}
        out["errors"] = plot_errors(errors)[0]
        out["effort"] = plot_efforts(comparison)[0]
        out["replay"] = plot_replays(replays)[0]
    return out
