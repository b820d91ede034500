"""Chained coordinates over time, with the domain in which they map to real angles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.chained import chained_form
from planner.domain import worst_margin
from planner.plan import Plan
from planner.report.style import (
    DOMAIN,
    OUTSIDE,
    TAG,
    Curve,
    Plans,
    curves,
    grid,
    heading,
    legend,
    times,
)
from planner.systems.base import Array, TriangularSystem
from planner.systems.manipulator import Manipulator

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXIT = {"marker": "x", "color": "#B00020", "markersize": 8, "linestyle": "none"}


def plot_z(plans: Plans, *, axes: Any = None) -> tuple[Figure, Any]:
    """z₂ with its domain shaded, and z₃ … z_N, over time; one column a plan.

    For the manipulator the shaded band is where a real θ₁ exists, given the later angles: for n = 3
    and θ₂ > 0 it is −g(z₃) < z₂ < 0. Where the domain asks more than that (n > 3, and other
    systems) a row with the least margin of the full domain is added, with the region < 0 shaded.

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
        axes[-1, column].set_xlabel("time (s)")
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
    if has_band(curve.plan.problem.system):
        low, high = z2_band(curve.plan, t)
        label = r"domain: a real $\theta_1$ exists"
        ax.fill_between(t, low, high, color=DOMAIN, label=label, linewidth=0)
        ax.plot(t, np.where(np.abs(low) > np.abs(high), low, high), color="#7FA8C4", linewidth=0.8)
    ax.axhline(0, color="#888888", linewidth=0.8)
    z2 = curve.plan.z(t)[:, 1]
    ax.plot(t, z2, color=curve.colour, linestyle=curve.dashes, linewidth=1.8)
    if not curve.plan.executable:
        out = np.array(curve.plan.domain.exits_s)
        ax.plot(out, curve.plan.z(out)[:, 1], **EXIT, label="leaves or re-enters the domain")
    if first:
        ax.set_ylabel("$z_2$")


def _draw_margin(ax: Any, curve: Curve, first: bool) -> None:
    t = times(curve.plan)
    margin = worst_margin(curve.plan.trajectory.margins(t))
    low = min(-0.02, 1.1 * float(np.min(margin)))
    ax.axhspan(low, 0, color=OUTSIDE, label="outside the domain", linewidth=0)
    ax.plot(t, margin, color=curve.colour, linestyle=curve.dashes, linewidth=1.8)
    if first:
        ax.set_ylabel("least domain margin")


def _draw_rest(ax: Any, curve: Curve, first: bool) -> None:
    """z₃ … z_N, each thinner and fainter than the one before, named where it is largest."""
    t = times(curve.plan)
    z = curve.plan.z(t)[:, 2:]
    for k, column in enumerate(z.T):
        fade = 1 - 0.4 * k / max(1, z.shape[1] - 1)
        width = 2.2 - 0.9 * k / max(1, z.shape[1] - 1)
        ax.plot(t, column, color=curve.colour, linestyle=curve.dashes, linewidth=width, alpha=fade)
        top = int(np.argmax(np.abs(column)))
        late = t[top] > t[-1] / 2
        ax.annotate(
            f"$z_{{{k + 3}}}$",
            (t[top], column[top]),
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
