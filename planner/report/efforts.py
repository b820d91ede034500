"""Effort against error on the machine: what a plan costs and what it is worth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.comparison import Row
from planner.errors import InputError
from planner.report.style import colours, grid, legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from planner.comparison import Comparison


CLOSED = "the same plan with feedback"


def plot_efforts(comparison: Comparison, *, ax: Any = None) -> tuple[Figure, Any]:
    """Effort of each plan against its error on the machines.

    The dot is the median of E with its 95 % interval, the line reaches up to the 95th percentile.
    Plans with feedback have hollow dots in their plan's colour, joined to those without.

    Args:
        comparison: What to draw; rows without replay are left out.
        ax: Axes to draw into.

    Returns:
        The figure and its axes.

    Raises:
        InputError: If no plan was replayed.
    """
    rows = [row for row in comparison.rows if np.isfinite([row.effort, row.E_median_deg]).all()]
    if not rows:
        raise InputError("no plan was replayed, so there are no errors to draw")
    colour = colours([row.spec for row in comparison.rows if not row.feedback])
    ours = ax is None
    figure, axes = grid(1, 1, ax, size=(6.4, 4.6))
    ax = axes[0, 0]
    for row in rows:
        _draw(ax, row, colour[row.spec])
    _join(ax, rows, colour)
    _scale(ax.xaxis, [row.effort for row in rows])
    _scale(ax.yaxis, [row.E_median_deg for row in rows])
    ax.set_xlabel("effort: integral of u1^2 + u2^2 dt")
    ax.set_ylabel("error index E (deg): median to 95 %")
    ax.set_title(f"Effort against error on {comparison.samples} emulated machines", fontsize=11)
    handles = ax.get_legend_handles_labels()[0]
    if any(row.feedback for row in rows):
        handles += ax.plot([], [], "o", color="#444444", markerfacecolor="white", label=CLOSED)
    legend(figure, ax, handles, ours=ours, abreast=2)
    return figure, ax


def _scale(axis: Any, values: list[float]) -> None:
    """Logarithmic where values differ by more than ten times, with plain numbers on it."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if max(values) <= 10 * min(values):
        return
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _draw(ax: Any, row: Row, colour: str) -> None:
    low, high = row.E_median_interval_deg
    ax.plot([row.effort] * 2, [row.E_median_deg, row.E_p95_deg], color=colour, linewidth=1.0)
    ax.plot([row.effort] * 2, [low, high], color=colour, linewidth=4.0, alpha=0.5)
    ax.plot(
        [row.effort],
        [row.E_median_deg],
        "o",
        color=colour,
        markerfacecolor="white" if row.feedback else colour,
        label=None if row.feedback else row.label if row.solved else f"{row.label} (refused)",
        linestyle="none",
    )
    ax.plot([row.effort], [row.E_p95_deg], "_", color=colour, markersize=9)


def _join(ax: Any, rows: list[Row], colour: dict[str, str]) -> None:
    free = {row.spec: row for row in rows if not row.feedback}
    for row in rows:
        if row.feedback and row.spec in free:
            before = free[row.spec]
            ax.annotate(
                "",
                (row.effort, row.E_median_deg),
                (before.effort, before.E_median_deg),
                arrowprops={"arrowstyle": "->", "color": colour[row.spec], "linestyle": ":"},
            )
