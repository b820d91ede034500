"""Curves over time: inputs against their limits, joint angles, chained coordinates.

Chained coordinates are drawn with the domain in which they map to real angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.plan.measures import worst_margin
from planner.plan.plan import Plan
from planner.report.figures.style import (
    DOMAIN,
    LIMIT,
    OUTSIDE,
    TAG,
    Curve,
    Plans,
    axis_label,
    curves,
    grid,
    heading,
    legend,
    line,
    shown,
    symbol,
    time_label,
    times,
)
from planner.support.arrays import Array
from planner.systems.chained_form import chained_form
from planner.systems.manipulator import Manipulator
from planner.systems.triangular_system import TriangularSystem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OVERSHOOT = 1.6
"""The view reaches this many times the limit; what goes beyond is named with its peak."""

FAR = 5.0
"""Without a limit peaks are cut off only where they reach so many times what is usual."""


def plot_inputs(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot Plot u₁ and u₂ over time with their limits as lines, all plans in each of two panels.

    Peaks far beyond the limits (or, without limits, far beyond most of the motion) are cut off and
    named above the panel, so that the rest stays readable.

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
        values = [(curve, t - curve.plan.lead_s, curve.plan.u(t)[:, i]) for curve, t in samples]
        for curve, t, u in values:
            ax.plot(t, u, color=curve.colour, linestyle=curve.dashes, linewidth=1.6)
        _frame(ax, values, float(problem.limits.input[i]))
        ax.set_ylabel(f"{symbol(coordinate.name)} ({coordinate.unit})")
        ax.set_xlabel(time_label(curve.plan for curve in drawn))
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


def view(values: Sequence[tuple[Any, Array, Array]], limit: float) -> tuple[float, float]:
    """Lowest and highest value to show of inputs (whose, times, values) under a limit."""
    every = np.concatenate([u for _, _, u in values])
    most = float(np.max(np.abs(every)))
    # Times crowd towards the ends of pieces, so that a quantile over them would follow the peaks.
    evenly = (np.interp(np.linspace(t[0], t[-1], 400), t, u) for _, t, u in values)
    usual = max(float(np.quantile(np.abs(u), 0.9)) for u in evenly)
    bound = OVERSHOOT * max(limit if np.isfinite(limit) else 0.0, 1.5 * usual)
    if not np.isfinite(limit) and most < FAR * usual:
        bound = 1.08 * most
    bound = min(bound, 1.08 * max(most, 1.02 * limit if np.isfinite(limit) else 0.0))
    bound = max(bound, 1e-9)
    one_sided = float(np.min(every)) > -0.02 * bound and not np.isfinite(limit)
    return (-0.05 * bound if one_sided else -bound), bound


def plot_joints(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot θ₁ … θₙ over time in degrees (lengths in metres); one panel per coordinate.

    Start and goal are dots; limits are drawn where the motion comes near them.

    Args:
        plans: One plan, several, or several by label; those without real angles are left out.
        axes: Axes to draw into, one per coordinate after the first.

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
            own = t - curve.plan.lead_s
            ax.plot(own, values, color=curve.colour, linestyle=curve.dashes, linewidth=1.6)
    longest = max(curve.plan.duration - curve.plan.lead_s for curve in drawn)
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
        ax.set_xlabel(time_label(curve.plan for curve in drawn))
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


EXIT = {"marker": "x", "color": "#B00020", "markersize": 8, "linestyle": "none"}


def plot_z(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot Plot z₂ with its domain shaded, and z₃ … z_N, over time; one column per plan.

    For the manipulator the shaded band is where a real θ₁ exists, given the later angles: for n = 3
    and θ₂ > 0 it is −g(z₃) < z₂ < 0. If the domain has further conditions (n > 3, and other
    systems), a row with the least margin of the full domain is added; margins < 0 are shaded.

    Args:
        plans: One plan, several, or several by label; also plans that are not executable.
        axes: Axes to draw into: rows × plans of them, in reading order.

    Returns:
        The figure and its axes, shape (rows, plans).

    Raises:
        InputError: If there is nothing to draw or `axes` do not fit.
    """
    shown = curves(plans)
    problem = shown[0].plan.problem
    rows = [_draw_z2]
    if not has_band(problem.system) or problem.system.size > 4:
        rows.append(_draw_margin)
    if problem.system.size > 2:
        rows.append(_draw_rest)
    ours = axes is None
    figure, axes = grid(len(rows), len(shown), axes, share=("col", "row"))
    for column, curve in enumerate(shown):
        for row, draw in enumerate(rows):
            draw(axes[row, column], curve, first=column == 0)
        axes[0, column].set_title(curve.title, fontsize=10)
        axes[-1, column].set_xlabel(time_label([curve.plan]))
    heading(figure, f"Chained coordinates and their domain: {problem.name}", ours=ours)
    legend(figure, axes, _entries(axes), ours=ours)
    return figure, axes


def z2_band(plan: Plan, t: Array) -> Array:
    """The values of z₂ for which a real θ₁ exists, given the later angles of a manipulator.

    z₂ is affine in cos²θ₁ (n = 2: monotone in cosθ₁), so the band runs between θ₁ = 0 and θ₁ = 90°.

    Args:
        plan: A plan for a `Manipulator`.
        t: Times (m,), seconds.

    Returns:
        Lower and upper edge, shape (2, m); NaN where even the later angles are not real.
    """
    form = chained_form(plan.problem.system)
    q = plan.q(t)
    edges = []
    for theta1 in (0.0, np.pi / 2):
        q[:, 1] = theta1
        edges.append(form.z(q)[:, 1])
    return np.sort(np.array(edges), axis=0)


def has_band(system: TriangularSystem) -> bool:
    """Whether `z2_band` is defined for a system."""
    return isinstance(system, Manipulator)


def _draw_z2(ax: Any, curve: Curve, first: bool) -> None:
    t = times(curve.plan)
    own = t - curve.plan.lead_s
    if has_band(curve.plan.problem.system):
        low, high = z2_band(curve.plan, t)
        label = r"domain: a real $\theta_1$ exists"
        ax.fill_between(own, low, high, color=DOMAIN, label=label, linewidth=0)
        ax.plot(
            own, np.where(np.abs(low) > np.abs(high), low, high), color="#7FA8C4", linewidth=0.8
        )
    ax.axhline(0, color="#888888", linewidth=0.8)
    z2 = curve.plan.z(t)[:, 1]
    ax.plot(own, z2, color=curve.colour, linestyle=curve.dashes, linewidth=1.8)
    if not curve.plan.executable:
        out = np.array(curve.plan.domain.exits_s)
        ax.plot(
            out - curve.plan.lead_s,
            curve.plan.z(out)[:, 1],
            **EXIT,
            label="leaves or re-enters the domain",
        )
    if first:
        ax.set_ylabel("$z_2$")


def _draw_margin(ax: Any, curve: Curve, first: bool) -> None:
    t = times(curve.plan)
    own = t - curve.plan.lead_s
    margin = worst_margin(curve.plan.trajectory.margins(t))
    low = min(-0.02, 1.1 * float(np.min(margin)))
    ax.axhspan(low, 0, color=OUTSIDE, label="outside the domain", linewidth=0)
    ax.plot(own, margin, color=curve.colour, linestyle=curve.dashes, linewidth=1.8)
    if first:
        ax.set_ylabel("least domain margin")


def _draw_rest(ax: Any, curve: Curve, first: bool) -> None:
    """z₃ … z_N, each thinner and fainter than the one before, named where it is largest."""
    t = times(curve.plan)
    own = t - curve.plan.lead_s
    z = curve.plan.z(t)[:, 2:]
    for k, column in enumerate(z.T):
        fade = 1 - 0.4 * k / max(1, z.shape[1] - 1)
        width = 2.2 - 0.9 * k / max(1, z.shape[1] - 1)
        ax.plot(
            own, column, color=curve.colour, linestyle=curve.dashes, linewidth=width, alpha=fade
        )
        top = int(np.argmax(np.abs(column)))
        late = t[top] > t[-1] / 2
        ax.annotate(
            f"$z_{{{k + 3}}}$",
            (own[top], column[top]),
            (-3 if late else 3, 5),
            textcoords="offset points",
            ha="right" if late else "left",
            fontsize=9,
            bbox=TAG,
        )
    ax.margins(y=0.15)
    if first:
        ax.set_ylabel("$z_3$" if z.shape[1] == 1 else f"$z_3$ … $z_{{{z.shape[1] + 2}}}$")


def _entries(axes: Any) -> list[Any]:
    """One legend entry for each label that any of the axes holds."""
    found: dict[str, Any] = {}
    for ax in axes.flat:
        handles, labels = ax.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    return list(found.values())
