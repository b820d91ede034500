"""Joint angles over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.style import (
    LIMIT,
    Plans,
    axis_label,
    curves,
    grid,
    heading,
    legend,
    line,
    shown,
    times,
)
from planner.systems.base import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_joints(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """θ₁ … θₙ over time in degrees (lengths in metres), one panel a coordinate, all plans in each.

    Start and goal are dots; limits are drawn where the motion comes near them.

    Args:
        plans: One plan, several, or several by label; those without real angles are left out.
        axes: Axes to draw into, one a coordinate after the first.

    Returns:
        The figure and its axes, shape (rows, columns).

    Raises:
        InputError: If no plan is executable or `axes` do not fit.
    """
    drawn = curves(plans, executable=True)
    problem = drawn[0].plan.problem
    count = problem.system.size - 1
    ours = axes is None
    figure, axes = grid(*shape(count), axes, share=("all", "none"))
    panels = list(axes.flat)
    for curve in drawn:
        t = times(curve.plan)
        q = curve.plan.q(t)
        for i, ax in enumerate(panels[:count], start=1):
            values = shown(q[:, i], problem.system.coordinates[i].unit)
            ax.plot(t, values, color=curve.colour, linestyle=curve.dashes, linewidth=1.6)
    longest = max(curve.plan.duration for curve in drawn)
    for i, ax in enumerate(panels[:count], start=1):
        unit = problem.system.coordinates[i].unit
        ends = shown(np.array([problem.start[i], problem.goal[i]]), unit)
        ax.plot([0, longest], ends, "o", color="black", markersize=4, clip_on=False, zorder=5)
        draw_limits(ax, shown(problem.limits.joint[i : i + 1], unit))
        ax.set_ylabel(axis_label(problem.system.coordinates[i]))
    for ax in panels[count:]:
        ax.set_visible(False)
    for ax in panels[max(0, count - axes.shape[1]) : count]:  # those with nothing below
        ax.tick_params(labelbottom=True)
        ax.set_xlabel("time (s)")
    what = "Joint angles" if hasattr(problem.system, "arm_points") else "Coordinates"
    heading(figure, f"{what}: {problem.name}", ours=ours)
    legend(figure, axes, [line(curve) for curve in drawn], ours=ours)
    return figure, axes


def shape(count: int) -> tuple[int, int]:
    """Rows and columns for `count` panels, at most four abreast."""
    rows = -(-count // 4)
    return rows, -(-count // rows)


def draw_limits(ax: Any, limit: Array, near: float = 0.75) -> None:
    """Lines at ± limit (1,), where what is drawn comes near; leaves the view as it is otherwise."""
    low, high = ax.get_ylim()
    for value in (-float(limit[0]), float(limit[0])):
        reach = high if value > 0 else -low
        if np.isfinite(value) and reach > near * abs(value):
            ax.axhline(value, color=LIMIT, linestyle=":", linewidth=1.2)
