"""The motion on the machine against the plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import InputError
from planner.replay import Replay
from planner.report.style import axis_label, colours, grid, heading, legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_replays(
    replays: Replay | Mapping[str, Replay | None], *, axes: Any = None
) -> tuple[Figure, Any]:
    """Angles on the machine and in the plan over time; one row a plan, one column an angle.

    The line is the sample with the median error index E; the shade holds 90 % of the samples.

    Args:
        replays: One replay, or several by label; None for a plan that was not replayed.
        axes: Axes to draw into: plans × angles, in reading order.

    Returns:
        The figure and its axes, shape (plans, angles).

    Raises:
        InputError: If there is nothing to draw or `axes` do not fit.
    """
    if isinstance(replays, Replay):
        replays = {replays.plan.method: replays}
    colour = colours(list(replays))
    runs = {label: run for label, run in replays.items() if run is not None}
    first = next(iter(runs.values()), None)
    if first is None or not first.angles:
        raise InputError("no plan with angles was replayed, so there is nothing to draw")
    ours = axes is None
    angles = first.angles
    figure, axes = grid(len(runs), len(angles), axes, size=(3.4, 2.2), share=("all", "col"))
    for row, (label, run) in enumerate(runs.items()):
        _draw(axes[row], run, colour[label])
        axes[row, 0].set_title(label, fontsize=10, loc="left", color=colour[label])
    for ax in axes[-1]:
        ax.set_xlabel("time (s)")
    text = f"Machine ({first.machine.preset}, {len(first.numbers)} samples) against plan"
    heading(figure, text, ours=ours)
    legend(figure, axes, axes[0, 0].get_legend_handles_labels()[0], ours=ours)
    return figure, axes


def median_sample(run: Replay) -> int:
    """Place in the replay of the sample whose E is the (lower) median."""
    order = np.argsort(run.index_E_deg, kind="stable")
    return int(order[(len(order) - 1) // 2])


def _draw(axes: Any, run: Replay, colour: str) -> None:
    plan = run.plan
    planned, median = np.rad2deg(plan.q(run.t)), median_sample(run)
    for ax, i in zip(axes, run.angles, strict=True):
        low, high = np.rad2deg(np.percentile(run.q[:, :, i], [5, 95], axis=0))
        style = {"color": colour, "linewidth": 0}
        ax.fill_between(run.t, low, high, alpha=0.2, label="90 % of the machines", **style)
        ax.plot(run.t, planned[:, i], "k--", linewidth=1.1, label="plan")
        actual = np.rad2deg(run.q[median, :, i])
        ax.plot(run.t, actual, color=colour, linewidth=1.6, label="machine of median error")
        ax.set_ylabel(axis_label(plan.problem.system.coordinates[i]))
