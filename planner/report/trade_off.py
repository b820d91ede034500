"""A trade-off curve as one picture: what is bought, what the machine makes of it, by which path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.pareto import Point, TradeOff
from planner.report.style import COLOURS, grid, heading, symbol

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = {
    "effort": "effort: integral of u1^2 + u2^2 dt",
    "duration": "duration (s)",
    "peak": "largest input, share of its limit",
}
KNEE = {"marker": "o", "markersize": 11, "fillstyle": "none", "markeredgewidth": 1.8}


def plot_trade_off(curve: TradeOff, *, axes: Any = None) -> tuple[Figure, Any]:
    """Response against cost, errors on machines against cost, and the paths of three points.

    Args:
        curve: The curve.
        axes: Three axes to draw into.

    Returns:
        The figure and its axes, shape (1, 3).

    Raises:
        InputError: If `axes` do not fit.
    """
    ours = axes is None
    figure, axes = grid(1, 3, axes, size=(4.3, 3.6))
    _responses(axes[0, 0], curve)
    _machines(axes[0, 1], curve)
    _paths(axes[0, 2], curve)
    k = curve.knee
    heading(
        figure,
        f"{curve.problem.name}: at the knee (ring) {curve.kind} {_cost(curve, k):.3g} buys"
        f" a passive block of {k.passive_deg:.2g} deg instead of {curve.points[0].passive_deg:.2g}",
        ours=ours,
    )
    return figure, axes


def _responses(ax: Any, curve: TradeOff) -> None:
    cost = curve.cost
    for colour, label, values in (
        (COLOURS[0], "total", [p.total_deg for p in curve.points]),
        (COLOURS[1], "passive block", [p.passive_deg for p in curve.points]),
    ):
        ax.plot(cost, values, ".-", color=colour, label=label)
        ax.plot(cost[curve.knee_index], values[curve.knee_index], color=colour, **KNEE)
    floor = curve.points[0].floor_deg
    ax.axhline(floor, color="#555555", linestyle=":", label="irreducible")
    ax.set_ylim(bottom=0)
    ax.set_xlabel(AXES[curve.kind])
    ax.set_ylabel("response at the end (deg, one standard deviation)")
    ax.legend(fontsize=8)


def _machines(ax: Any, curve: TradeOff) -> None:
    cost, at = curve.cost, curve.knee_index
    rows = (
        (COLOURS[0], "design errors alone, 95 %", "errors_alone", "terminal_p95_deg"),
        (COLOURS[3], "whole machine, 95 %", "machine", "terminal_p95_deg"),
        (COLOURS[4], "whole machine, median", "machine", "terminal_median_deg"),
    )
    for colour, label, which, key in rows:
        found = [getattr(p, which) for p in curve.points]
        if any(f is None for f in found):
            continue
        values = [f[key] for f in found]
        ax.plot(cost, values, ".-", color=colour, label=label)
        ax.plot(cost[at], values[at], color=colour, **KNEE)
    ax.set_ylim(bottom=0)
    ax.set_xlabel(AXES[curve.kind])
    ax.set_ylabel("largest joint error at the end (deg)")
    ax.legend(fontsize=8)


def _paths(ax: Any, curve: TradeOff) -> None:
    system = curve.problem.system
    chosen = dict.fromkeys([0, curve.knee_index, len(curve.points) - 1])
    for colour, k in zip(COLOURS, chosen, strict=False):
        point = curve.points[k]
        q = point.plan.q(np.linspace(0, point.plan.duration, 800))
        turns = f", {point.reversals} reversals" if point.reversals else ", one way"
        label = f"{curve.kind} {_cost(curve, point):.3g}{turns}"
        ax.plot(np.rad2deg(q[:, 0] - q[0, 0]), np.rad2deg(q[:, 1]), color=colour, label=label)
    ax.set_xlabel(f"travel of {symbol(system.coordinates[0].name)} (deg)")
    ax.set_ylabel(f"{symbol(system.coordinates[1].name)} (deg)")
    ax.legend(fontsize=8)


def _cost(curve: TradeOff, point: Point) -> float:
    return point.effort if curve.kind == "effort" else point.limit
