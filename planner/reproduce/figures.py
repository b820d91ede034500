"""Our versions of the paper's Figs 4–10."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.report import plot_arm, plot_inputs, plot_joints, plot_z
from planner.report.replays import median_sample, plot_replays
from planner.report.style import grid, heading
from planner.report.z import z2_band
from planner.reproduce.cases import POINT, Cases

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VALID = "same law, travel chosen inside the domain"


def figures(cases: Cases) -> dict[str, Figure]:
    """File name (without ending) to figure."""
    free = {"no constraint point": cases.free}
    point = {f"constraint point ({POINT[0]:g} s, {POINT[1]:g})": cases.point}
    return {
        "fig4-z-no-point": plot_z(free)[0],
        "fig5-z-with-point": plot_z(point)[0],
        "fig5-no-real-theta1": _finding(cases),
        "fig6-joints": plot_joints({VALID: cases.valid})[0],
        "fig7-inputs": plot_inputs({VALID: cases.valid})[0],
        "fig8-arm": plot_arm({VALID: cases.valid})[0],
        "fig9-joints-machine": plot_replays({VALID: cases.replay})[0],
        "fig10-motors-machine": _motors(cases),
    }


def _finding(cases: Cases) -> Figure:
    """z₂ of Fig. 5 with the band −g(z₃) < z₂ < 0 in which a real θ₁ exists."""
    figure, axes = grid(1, 1, size=(6.4, 4.0))
    ax, t = axes[0, 0], np.linspace(0, cases.point.duration, 2001)
    z2 = cases.point.z(t)[:, 1]
    low, high = z2_band(cases.point, t)
    ax.fill_between(t, low, high, color="#DCEAF5", label="a real $\\theta_1$ exists")
    ax.plot(t, low, color="#5B8DB8", linewidth=1, label="$-g(z_3)$")
    outside = z2 < low
    ax.plot(t, z2, color="black", linewidth=1.6, label="$z_2$ of the paper's Fig. 5")
    no_angle = np.where(outside, z2, np.nan)
    ax.plot(t, no_angle, color="#B00020", linewidth=2.6, label="no real $\\theta_1$")
    ax.plot(*POINT, "o", color="black", markersize=6, label="constraint point")
    ax.axhline(0, color="grey", linewidth=0.8)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("$z_2$")
    ax.legend(loc="lower left", fontsize=9)
    heading(figure, "z2 stays negative, and yet there is no arm for it", ours=True)
    return figure


def _motors(cases: Cases) -> Figure:
    """Speeds of both motors of the sample of median error, against the command."""
    run = cases.replay
    figure, axes = grid(1, 2, size=(4.2, 3.0))
    commanded, k = run.plan.u(run.t), median_sample(run)
    for i, ax in enumerate(axes[0]):
        ax.plot(run.t, commanded[:, i], "k--", linewidth=1.1, label="command")
        ax.plot(run.t, run.motor_rates[k, :, i], color="#0072B2", linewidth=1.4, label="motor")
        ax.set_xlabel("time (s)")
        ax.set_ylabel(f"$u_{i + 1}$ (rad/s)")
    axes[0, 0].legend(fontsize=9)
    heading(figure, "Motor speeds on the emulated prototype (one machine)", ours=True)
    return figure
