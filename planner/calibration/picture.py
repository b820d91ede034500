"""The calibrated prototype beside the paper's motion, and what is known of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.calibration.identify import Data
from planner.calibration.ranges import FITTED
from planner.calibration.statements import Motion
from planner.plan import Plan
from planner.report.style import COLOURS, GRID

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DASHES = {"quasi-static": "-", "dynamic": "--"}


def picture(plan: Plan, motions: Mapping[str, Motion], data: Sequence[Data]) -> Figure:
    """Errors of the joints, speeds of the motors, and the part of each range that is left."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 6.2), dpi=100, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.1, 1.0])
    errors: Any = figure.add_subplot(grid[0, 0])
    motors: Any = figure.add_subplot(grid[1, 0], sharex=errors)
    for axes in (errors, motors):
        axes.grid(**GRID)
        axes.spines[["top", "right"]].set_visible(False)
    _errors(errors, motions)
    _motors(motors, plan, motions)
    _left(figure.add_subplot(grid[:, 1]), data)
    return figure


def _errors(ax: Any, motions: Mapping[str, Motion]) -> None:
    for name, motion in motions.items():
        for i in range(motion.error.shape[2]):
            label = f"$\\theta_{i + 1}$, {name}"
            curve = {"color": COLOURS[i], "linestyle": DASHES[name], "linewidth": 1.5}
            ax.plot(motion.t, motion.error[0, :, i], label=label, **curve)
    for level in (-5, 5):
        ax.axhline(level, color="#555555", linewidth=0.8, linestyle=":")
    ax.set_ylabel("true minus planned (deg)")
    ax.set_title("errors of the nominal machine; dotted: the paper's 5 deg", fontsize=10)
    ax.legend(fontsize=7, ncols=2)


def _motors(ax: Any, plan: Plan, motions: Mapping[str, Motion]) -> None:
    t = next(iter(motions.values())).t
    command = np.where((t < plan.duration)[:, None], plan.u(t), 0.0)
    peak = np.max(np.abs(command), axis=0) / 100
    for i in range(2):
        ax.plot(t, command[:, i], color="#BBBBBB", linewidth=4, label="command" if i else None)
        for name, motion in motions.items():
            speed = motion.motors[0, :, i] * peak[i]
            curve = {"color": COLOURS[i], "linestyle": DASHES[name], "linewidth": 1.2}
            ax.plot(t, speed, label=f"motor {i + 1}, {name}", **curve)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("speed (rad/s)")
    ax.legend(fontsize=7, ncols=2)


def _left(ax: Any, data: Sequence[Data]) -> None:
    share = np.array([d.left for d in data]).T
    ax.imshow(share, cmap="Blues_r", vmin=0, vmax=1, aspect="auto")
    for i, row in enumerate(share):
        for j, part in enumerate(row):
            dark = part < 0.5
            ax.text(j, i, f"{part:.2f}", ha="center", va="center", color="w" if dark else "k")
    ax.set_yticks(range(len(FITTED)), [r.name for r in FITTED], fontsize=8)
    ax.set_xticks(range(len(data)), [fill(d.name, 16) for d in data], fontsize=8)
    ax.set_title("part of each range that is left (1: not identifiable)", fontsize=10)
