"""Figures of plans as pictures: each panel of `planner.report.panels` on its own axes.

Inputs with their limits, joint angles, chained coordinates with the domain in which they map to
real angles, and the map of the first two joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.machine.machine import Machine
from planner.report import panels
from planner.report.figures.arm import COLOUR_MAP
from planner.report.figures.style import (
    DOMAIN_COLOUR,
    LABEL_BOX,
    LIMIT_COLOUR,
    OUTSIDE_COLOUR,
    Curve,
    Plans,
    Sharing,
    curves,
    escape_math,
    grid,
    heading,
    legend,
    line,
    shade_holds,
    symbol,
    time_label,
    times,
    write_beside,
)
from planner.report.panels import PLAN_FIGURES, Panel, PlanCurves, PlanePanel, TimePanel
from planner.support.arrays import Array
from planner.support.package import Figure
from planner.support.user_tables import allowed_hint

EXIT_STYLE = {"marker": "x", "color": "#B00020", "markersize": 8, "linestyle": "none"}
DOT_STYLE = {"marker": "o", "color": "black", "markersize": 4, "linestyle": "none"}
HOLLOW_STYLE = DOT_STYLE | {"marker": "D", "markerfacecolor": "none"}
Panels = Sequence[Panel]
PANEL_SIZES = {"inputs": (4.8, 3.4), "map": (6.4, 4.6)}
"""Width and height of one panel of a figure, inches, where they differ from the usual size."""


def plot_inputs(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot u₁ and u₂ over time in two panels, with all plans in both and limits as lines.

    Peaks far beyond the limits (or, without limits, far beyond most of the motion) are cut off and
    named above the panel, so that the rest stays readable.

    Args:
        plans: One plan, several, or several by label; plans that are not executable (no real inputs
            at some time) are left out.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).

    Raises:
        InputError: If no plan is executable or `axes` do not fit.
    """
    return plot("inputs", plans, axes)


def plot_joints(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot θ₁ … θₙ over time in degrees (lengths in metres); one panel per coordinate.

    Start and goal are dots, waypoints with a time diamonds. Limits are drawn if the motion comes
    close to them.

    Args:
        plans: One plan, several, or several by label; plans that are not executable (no real angles
            at some time) are left out.
        axes: Axes to draw into, one per coordinate after the first.

    Returns:
        The figure and its axes, shape (rows, columns).

    Raises:
        InputError: If no plan is executable or `axes` do not fit.
    """
    return plot("joints", plans, axes)


def plot_map(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot paths in the plane of θ₁ and θ₂, degrees, with the chart that contains the start.

    The chart is the region in which the chained coordinates are valid. The plane outside is shaded.
    Start and goal are dots, joint limits dotted lines.

    Args:
        plans: One plan, several, or several by label; plans that are not executable (no real angles
            at some time) are left out.
        axes: Axes to draw into.

    Returns:
        The figure and its axes, shape (1, 1).

    Raises:
        InputError: If no plan is executable, the system is not an arm of two or more joints, or
            `axes` do not fit.
    """
    return plot("map", plans, axes)


def plot_z(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot z₂ with its domain shaded, and z₃ … z_N, over time; one column per plan.

    For the manipulator, the shaded band is where a real θ₁ exists, given θ₂ … θₙ: for n = 3 and
    θ₂ > 0 it is −g(z₃) < z₂ < 0. If the domain has further conditions (n > 3, and other
    systems), a row with the least margin of the full domain is added; margins < 0 are shaded.

    Args:
        plans: One plan, several, or several by label; also plans that are not executable.
        axes: Axes to draw into: rows × plans of them, in reading order.

    Returns:
        The figure and its axes, shape (rows, plans); of more than four plans, at most four abreast.

    Raises:
        InputError: If there is nothing to draw or `axes` do not fit.
    """
    return plot("z", plans, axes)


def plot(
    name: str, plans: Plans, axes: Any = None, machine: Machine | None = None
) -> tuple[Figure, Any]:
    """Draw a figure of `PLAN_FIGURES`: all plans in each panel, or one column per plan.

    Args:
        name: Name of the figure.
        plans: One plan, several, or several by label; plans without the figure are left out.
        axes: Axes to draw into, one per panel.
        machine: The machine whose effects the figure shows; by default that of the plans' problem.

    Returns:
        The figure and its axes, shape (rows, columns).

    Raises:
        InputError: If the name is unknown, there is nothing to draw, or `axes` do not fit.
    """
    if name not in PLAN_FIGURES:
        raise InputError(f"no figure '{name}'; {allowed_hint(name, list(PLAN_FIGURES))}")
    kind = PLAN_FIGURES[name]
    drawn = curves(plans, executable=kind.executable)
    problem = drawn[0].plan.problem
    if not kind.fits(problem.system):
        raise InputError(f"a {problem.system.kind} has no figure '{name}'")
    plan_curves = [PlanCurves(k, c.plan, times(c.plan), machine) for k, c in enumerate(drawn)]
    ours = axes is None
    if kind.columns:
        figure, axes = _columns([kind.panels([one]) for one in plan_curves], drawn, axes)
    else:
        figure, axes = _panels(kind.panels(plan_curves), drawn, axes)
    heading(figure, f"{kind.title}: {problem.name}", ours=ours)
    entries = [] if kind.columns else [line(curve) for curve in drawn]
    legend(figure, axes, entries + _entries(axes), ours=ours, abreast=3 if axes.size > 1 else 2)
    return figure, axes


def _panels(plan_panels: Panels, drawn: Sequence[Curve], axes: Any) -> tuple[Figure, Any]:
    """Draw a figure with all plans in each panel; return the figure and its axes."""
    over_time = isinstance(plan_panels[0], TimePanel)
    share: tuple[Sharing, Sharing] = ("all" if over_time else "none", "none")
    rows = -(-len(plan_panels) // 4)
    size = PANEL_SIZES.get(plan_panels[0].id, (3.4, 2.6))
    figure, axes, _ = grid(rows, -(-len(plan_panels) // rows), axes, size=size, share=share)
    every = list(axes.flat)
    for ax, panel in zip(every, plan_panels, strict=False):
        _draw(ax, panel, drawn)
    for ax in every[len(plan_panels) :]:
        ax.set_visible(False)
    if over_time:
        first = max(0, len(plan_panels) - axes.shape[1])
        for ax in every[first : len(plan_panels)]:  # panels with none below
            ax.tick_params(labelbottom=True)
            ax.set_xlabel(time_label(curve.plan for curve in drawn))
    return figure, axes


def _columns(plans: Sequence[Panels], drawn: Sequence[Curve], axes: Any) -> tuple[Figure, Any]:
    """Draw a figure with one column per plan, at most four abreast; a plan's panels with the same
    id share axes."""
    columns = [[list(same) for _, same in groupby(each, attrgetter("id"))] for each in plans]
    down = 1 if axes is not None else -(-len(drawn) // 4)
    abreast, deep = -(-len(drawn) // down), len(columns[0])
    figure, axes, _ = grid(deep * down, abreast, axes, share=("all", "row"))
    for k, (curve, column) in enumerate(zip(drawn, columns, strict=True)):
        places = axes[deep * (k // abreast) :, k % abreast][:deep]
        for ax, same in zip(places, column, strict=True):
            _draw_same(ax, same, drawn)
            if k % abreast:
                ax.set_ylabel("")
        places[0].set_title(curve.title, fontsize=10)
        places[-1].set_xlabel(time_label([curve.plan]))
        places[-1].tick_params(labelbottom=True)
    for ax in axes[-deep:, (len(drawn) - 1) % abreast + 1 :].flat:
        ax.set_visible(False)
    for row, cells in enumerate(zip(*columns, strict=True)):
        view = panels.common_view([panel for cell in cells for panel in cell])
        for ax in axes[row::deep].flat if view else ():
            ax.set_ylim(view)
    return figure, axes


# -- panels on axes -----------------------------------------------------------------------------


def _draw(ax: Any, panel: Panel, drawn: Sequence[Curve]) -> None:
    """Draw a panel with one curve per plan."""
    if isinstance(panel, TimePanel):
        _frame(ax, panel, drawn)
    elif isinstance(panel, PlanePanel):
        _plane(ax, panel)
    for series in panel.series:
        look = drawn[series.plan].look
        if isinstance(panel, PlanePanel):
            look = look | {"label": dict(panel.key).get("path")}
        ax.plot(_times(series, drawn) if series.x is None else series.x, series.y, **look)
    if isinstance(panel, TimePanel) and panel.view:
        _view(ax, panel, drawn)


def _draw_same(ax: Any, same: Sequence[Any], drawn: Sequence[Curve]) -> None:
    """Draw one plan's panels on the same axes; each curve is thinner than the one before."""
    _frame(ax, same[0], drawn)
    names = [symbol(panel.title) for panel in same]
    ax.set_ylabel(names[0] if len(same) == 1 else f"{names[0]} … {names[-1]}")
    for k, panel in enumerate(same):
        (series,) = panel.series
        curve = drawn[series.plan]
        t, y = _times(series, drawn), series.y
        late = k / max(1, len(same) - 1)
        looks = {"linewidth": 2.0 - 0.7 * late, "alpha": 1 - 0.4 * late}
        ax.plot(t, y, color=curve.colour, linestyle=curve.dashes, **looks)
        if panel.id == "z":
            _name(ax, names[k], t, y)


def _name(ax: Any, name: str, t: Array, y: Array) -> None:
    """Write a curve's name where its magnitude is largest."""
    top = int(np.argmax(np.abs(y)))
    late = t[top] > (t[0] + t[-1]) / 2
    ax.margins(y=0.15)
    side, shift = ("right", -3) if late else ("left", 3)
    write_beside(ax, name, (t[top], y[top]), (shift, 5), ha=side, fontsize=9)


def _times(series: panels.Series, drawn: Sequence[Curve]) -> Array:
    """Return the times of a curve, s; 0 is the start of the path, after any preparatory motion."""
    plan = drawn[series.plan].plan
    return np.asarray(times(plan) - plan.lead_s if series.t is None else series.t)


def _frame(ax: Any, panel: TimePanel, drawn: Sequence[Curve]) -> None:
    """Draw a panel over time without its curves: limits, shades, dots and labels."""
    for number in {series.plan for series in panel.series}:
        shade_holds(ax, drawn[number].plan)
    unit = escape_math(panel.unit)
    ax.set_ylabel(symbol(panel.title) + (f" ({unit})" if unit else ""))
    if panel.band:
        low, high = panel.band.low, panel.band.high
        t = _times(panel.series[0], drawn)
        label = r"domain: a real $\theta_1$ exists"
        ax.fill_between(t, low, high, color=DOMAIN_COLOUR, label=label, linewidth=0)
        edge = np.where(np.abs(low) > np.abs(high), low, high)
        ax.plot(t, edge, color="#7FA8C4", linewidth=0.8)
    if panel.id == "z2":
        ax.axhline(0, color="#888888", linewidth=0.8)
    if panel.floor is not None:
        least = min(float(np.min(series.y)) for series in panel.series)
        bottom = min(panel.floor - 0.02, 1.1 * least)
        label = "outside the domain"
        ax.axhspan(bottom, panel.floor, color=OUTSIDE_COLOUR, label=label, linewidth=0)
    for value in panel.limits:
        ax.axhline(value, color=LIMIT_COLOUR, linestyle=":", linewidth=1.4)
    if panel.marks:
        t, value = np.transpose(panel.marks)
        ax.plot(t, value, **EXIT_STYLE, label="leaves or re-enters the domain")
    if panel.ends:
        longest = max(curve.plan.duration - curve.plan.lead_s for curve in drawn)
        ax.plot([0, longest], panel.ends, **DOT_STYLE, clip_on=False, zorder=5)
    if panel.stops:
        t, value = np.transpose(panel.stops)
        ax.plot(t, value, **HOLLOW_STYLE, zorder=5)


def _view(ax: Any, panel: TimePanel, drawn: Sequence[Curve]) -> None:
    """Set the range of values that a panel shows, label the limit, and note each peak outside."""
    ax.set_ylim(panel.view)
    if panel.limits:
        ax.text(0.995, max(panel.limits), "limit", transform=ax.get_yaxis_transform(),
                ha="right", va="bottom", fontsize=8, color=LIMIT_COLOUR, zorder=5,
                bbox=LABEL_BOX)  # fmt: skip
    for above, peak in enumerate(panel.notes):
        curve, up = drawn[peak.plan], peak.value > 0
        mark = {"color": curve.colour, "markersize": 7, "clip_on": False, "zorder": 5}
        place = ax.get_xaxis_transform()
        ax.plot([peak.t], [float(up)], "^" if up else "v", transform=place, **mark)
        words = f"{curve.label} peaks at {peak.value:.3g}, t = {peak.t:.2g} s"
        look = {"xycoords": "axes fraction", "textcoords": "offset points", "color": curve.colour}
        ax.annotate(words, (0.5, 1.0), (0, 6 + 12 * above), ha="center", fontsize=8.5, **look)


def _plane(ax: Any, panel: PlanePanel) -> None:
    """Draw a panel in the plane at equal scale, without its paths."""
    from matplotlib import colormaps
    from matplotlib.patches import Circle, Rectangle

    x_label, up = (f"{symbol(name)} ({escape_math(panel.unit)})" for name in panel.names)
    ax.set(xlabel=x_label, ylabel=up)
    ax.set_aspect("equal", adjustable="box")
    ax.set_title("; ".join(filter(None, [panel.title, panel.note])), fontsize=10)
    meanings = dict(panel.key)
    if panel.view:
        ax.set(xlim=panel.view[0], ylim=panel.view[1])
    if panel.region:
        ax.set_facecolor(OUTSIDE_COLOUR)
        (west, east), (south, north) = panel.region
        looks: dict[str, Any] = {"facecolor": "white", "edgecolor": "#B00020", "zorder": 0.3}
        ax.add_patch(Rectangle((west, south), east - west, north - south, **looks))
        ax.plot([], [], "s", color=OUTSIDE_COLOUR, label=meanings.get("below"))
    for axis, value in panel.limits:
        draw = ax.axhline if axis else ax.axvline
        draw(value, color=LIMIT_COLOUR, linestyle=":", linewidth=1.4, label=meanings.get("limit"))
    for x, y, radius in panel.discs:
        ax.add_patch(Circle((x, y), radius, color="0.55", alpha=0.6, zorder=1))
    for k, pose in enumerate(panel.poses):
        colour = colormaps[COLOUR_MAP](k / max(1, len(panel.poses) - 1))
        look = {"color": colour, "linewidth": 1.8, "markersize": 2.5, "alpha": 0.75}
        ax.plot(*np.transpose(pose), "-o", **look, label=meanings.get("ramp"))
    for tip in panel.tips:
        ax.plot(*tip, **HOLLOW_STYLE, zorder=5)
    for (x, y), word in zip(panel.ends, ("start", "goal"), strict=False):
        ax.plot([x], [y], **DOT_STYLE, zorder=5)
        write_beside(ax, word, (x, y), (6, -10))


def _entries(axes: Any) -> list[Any]:
    """Return one legend entry for each label that appears in any of the axes."""
    pairs = (zip(*ax.get_legend_handles_labels(), strict=True) for ax in axes.flat)
    return list({label: handle for each in pairs for handle, label in each}.values())
