"""Heat maps of what errors do to the end of a plan, and how the response grows along it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.differences import MachineEntry, MachineSensitivity
from planner.report.style import COLOURS, grid, heading, legend, symbol
from planner.sensitivity import PAPER_SPREAD, Sensitivity
from planner.systems.base import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAP = "Blues"
"""Light for no response, dark for the largest."""


def plot_sensitivity(
    found: Sensitivity, spread: Mapping[str, float] = PAPER_SPREAD, *, ax: Any = None
) -> tuple[Figure, Any]:
    """Degrees of each angle at the end for one reference error of each parameter.

    Boxes mark the passive block, dots what start and goal alone decide (irreducible).

    Args:
        found: The sensitivities.
        spread: Standard deviations; where there is none the usual size is taken.
        ax: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    names = [found.plan.problem.system.coordinates[i].name for i in found.angles]
    first = found.plan.problem.system.coordinates[0].name
    kept = [p for p, name in enumerate(found.parameters) if name != f"start {first}"]
    labels = [
        f"{_named(found.parameters[p])}\n{_size(found.reference(spread)[p], found.units[p])}"
        for p in kept
    ]
    values = found.contribution_deg(spread)[:, kept]
    figure, ax, ours = _heat(values, [symbol(n) for n in names], labels, ax)
    for row, column in np.argwhere(found.irreducible[np.ix_(found.angles, kept)]):
        ax.plot(column - 0.38, row - 0.34, "o", color="#D55E00", markersize=4)
    _box_passive(ax, found, kept)
    total, floor = found.total_deg(spread), found.floor_deg(spread)
    text = (
        f"{found.plan.method}: total {total:.4g} deg, of it irreducible (dots) {floor:.4g};"
        f" passive block (boxes) {found.passive_block_deg(spread):.3g}"
    )
    heading(figure, text, ours=ours)
    return figure, ax


def plot_machine_sensitivity(
    found: MachineSensitivity, *, most: int = 24, ax: Any = None
) -> tuple[Figure, Any]:
    """Degrees of each angle at the end for one spread (or step) of each parameter of the machine.

    Args:
        found: The sensitivities.
        most: Parameters shown: those of the largest response.
        ax: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    loud = [e for e in found.entries if not e.silent]
    loud = sorted(loud, key=lambda e: -float(np.max(np.abs(e.contribution))))[:most]
    labels = [f"{entry_name(e)}: {e.reference:.3g} {e.unit}".strip() for e in loud]
    values = np.stack([e.contribution for e in loud], axis=0)
    angles = [symbol(n) for n in found.angles]
    figure, ax, ours = _heat(values, labels, angles, ax, tall=True)
    nominal = ", ".join(f"{e:.2g}" for e in found.nominal_error_deg)
    text = f"{found.plan.method} on the machine; nominal errors {nominal} deg"
    heading(figure, text, ours=ours)
    return figure, ax


def plot_responses(
    found: Sensitivity, spread: Mapping[str, float] = PAPER_SPREAD, *, ax: Any = None
) -> tuple[Figure, Any]:
    """Standard deviation of each angle along the plan, degrees.

    Args:
        found: The sensitivities.
        spread: Standard deviations of the errors.
        ax: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    ours = ax is None
    figure, axes = grid(1, 1, ax, size=(6.4, 3.4))
    ax = axes[0, 0]
    for k, (i, values) in enumerate(zip(found.angles, found.along_deg(spread).T, strict=True)):
        name = symbol(found.plan.problem.system.coordinates[i].name)
        ax.plot(found.t, values, color=COLOURS[k % len(COLOURS)], linewidth=1.6, label=name)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("standard deviation (deg)")
    heading(figure, f"Response to the design errors along the {found.plan.method} plan", ours=ours)
    legend(figure, ax, ax.get_legend_handles_labels()[0], ours=ours)
    return figure, ax


def _heat(
    values: Array, rows: Sequence[str], columns: Sequence[str], ax: Any, *, tall: bool = False
) -> tuple[Figure, Any, bool]:
    ours = ax is None
    size = (4.6, 0.28 * len(rows) + 0.9) if tall else (0.72 * len(columns), 0.5 * len(rows) + 1.2)
    figure, axes = grid(1, 1, ax, size=size)
    ax = axes[0, 0]
    ax.grid(False)
    shade = np.abs(values) ** 0.5  # small responses stay visible beside large ones
    ax.imshow(shade, cmap=MAP, aspect="auto", vmin=0, vmax=max(float(np.max(shade)), 1e-12) * 1.3)
    for (i, j), value in np.ndenumerate(values):
        if abs(value) >= 5e-4:
            ax.text(j, i, f"{value:.2g}", ha="center", va="center", fontsize=8)
    ax.set_yticks(range(len(rows)), rows, fontsize=8)
    ax.set_xticks(range(len(columns)), columns, fontsize=7 if not tall else 9)
    ax.tick_params(length=0)
    return figure, ax, ours


def _box_passive(ax: Any, found: Sensitivity, kept: Sequence[int]) -> None:
    from matplotlib.patches import Rectangle

    system = found.plan.problem.system
    passive = [k for k, i in enumerate(found.angles) if i >= 2]
    for name in (f"start {system.coordinates[1].name}", f"gain {system.inputs[1].name}"):
        column = kept.index(found.parameters.index(name))
        for row in passive:
            ax.add_patch(
                Rectangle(
                    (column - 0.47, row - 0.47), 0.94, 0.94, fill=False, edgecolor="black", lw=1.2
                )
            )


def entry_name(entry: MachineEntry) -> str:
    """A machine's parameter in words, without the unit that its key ends in."""
    unit = r"(?<!_per)_(deg|nm|s|rad_s2?|nm_per_rad|nms_per_rad|kgm2)$"
    words = re.sub(unit, "", entry.effect).replace("_nm", "_torque").replace("_", " ")
    return f"{words} {entry.element}".strip()


def _named(parameter: str) -> str:
    word, _, which = parameter.partition(" ")
    return f"{word} {symbol(which)}" if which else symbol(f"k{word[1:]}").replace("k", "K")


def _size(value: float, unit: str) -> str:
    if unit == "1":
        return f"{100 * value:.3g} %"
    if unit == "rad":
        return f"{np.rad2deg(value):.3g} deg"
    return f"{value:.3g} {unit}"
