"""Inputs over time against their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.report.style import (
    LIMIT,
    TAG,
    Curve,
    Plans,
    curves,
    grid,
    heading,
    legend,
    line,
    symbol,
    times,
)
from planner.systems.base import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERSHOOT = 1.6
"""The view reaches this many times the limit; what goes beyond is named with its peak."""

FAR = 5.0
"""Without a limit peaks are cut off only where they reach so many times what is usual."""


def plot_inputs(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """u₁ and u₂ over time with their limits as lines, all plans in each of two panels.

    Peaks far beyond the limits (or, where there are none, beyond most of the motion) are cut off
    and named over the panel, so that the rest stays readable.

    Args:
        plans: One plan, several, or several by label; those without real inputs are left out.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).

    Raises:
        InputError: If no plan is executable or `axes` do not fit.
    """
    drawn = curves(plans, executable=True)
    problem = drawn[0].plan.problem
    ours = axes is None
    figure, axes = grid(1, 2, axes, size=(4.8, 3.4))
    samples = [(curve, times(curve.plan)) for curve in drawn]
    for i, (ax, coordinate) in enumerate(zip(axes.flat, problem.system.inputs, strict=True)):
        values = [(curve, t, curve.plan.u(t)[:, i]) for curve, t in samples]
        for curve, t, u in values:
            ax.plot(t, u, color=curve.colour, linestyle=curve.dashes, linewidth=1.6)
        _frame(ax, values, float(problem.limits.input[i]))
        ax.set_ylabel(f"{symbol(coordinate.name)} ({coordinate.unit})")
        ax.set_xlabel("time (s)")
    heading(figure, f"Inputs and limits: {problem.name}", ours=ours)
    legend(figure, axes, [line(curve) for curve in drawn], ours=ours)
    return figure, axes


def _frame(ax: Any, values: Sequence[tuple[Curve, Array, Array]], limit: float) -> None:
    """Limits as lines, a view that stays readable, and a note on each peak outside it."""
    low, high = view(values, limit)
    ax.set_ylim(low, high)
    if np.isfinite(limit):
        for sign in (-1, 1):
            ax.axhline(sign * limit, color=LIMIT, linestyle=":", linewidth=1.4)
        ax.text(0.995, limit, "limit", transform=ax.get_yaxis_transform(), ha="right", va="bottom",
                fontsize=8, color=LIMIT, zorder=5, bbox=TAG)  # fmt: skip
    beyond = 0
    for curve, t, u in values:
        k = int(np.argmax(np.abs(u)))
        if not low <= u[k] <= high:
            _note(ax, curve, float(t[k]), float(u[k]), beyond)
            beyond += 1


def _note(ax: Any, curve: Curve, time: float, value: float, above: int) -> None:
    """Name a peak that lies outside the view over the axes, and mark where it leaves."""
    up = value > 0
    mark = {"color": curve.colour, "markersize": 7, "clip_on": False, "zorder": 5}
    place = ax.get_xaxis_transform()
    ax.plot([time], [float(up)], "^" if up else "v", transform=place, **mark)
    ax.annotate(
        f"{curve.label} peaks at {value:.3g}, t = {time:.2g} s",
        (0.5, 1.0),
        (0, 6 + 12 * above),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="center",
        fontsize=8.5,
        color=curve.colour,
    )


def view(values: Sequence[tuple[Curve, Array, Array]], limit: float) -> tuple[float, float]:
    """Lowest and highest value to show of inputs (curve, times, values) under a limit."""
    every = np.concatenate([u for _, _, u in values])
    most = float(np.max(np.abs(every)))
    # Times crowd towards the ends of pieces, so that a quantile over them would follow the peaks.
    usual = max(float(np.quantile(np.abs(np.interp(_even(t), t, u)), 0.9)) for _, t, u in values)
    bound = OVERSHOOT * max(limit if np.isfinite(limit) else 0.0, 1.5 * usual)
    if not np.isfinite(limit) and most < FAR * usual:
        bound = 1.08 * most
    bound = min(bound, 1.08 * max(most, 1.02 * limit if np.isfinite(limit) else 0.0))
    bound = max(bound, 1e-9)
    one_sided = float(np.min(every)) > -0.02 * bound and not np.isfinite(limit)
    return (-0.05 * bound if one_sided else -bound), bound


def _even(t: Array) -> Array:
    return np.linspace(t[0], t[-1], 400)
