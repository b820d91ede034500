"""Sensitivities of several plans as one picture: the part that a plan decides, and the response to
each error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from planner.errors import expect
from planner.report.figures.robustness import parameter_symbol, size_of
from planner.report.figures.style import LIMIT_COLOUR, colours, escape_math, grid, heading
from planner.robustness.sensitivities import Sensitivities

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PALE = 0.35
"""Opacity of the totals, so that the passive blocks stand out."""

BAR_SPAN = 0.8
"""Width of the group of bars over one error, relative to the distance between groups."""


def plot_sensitivities(found: Sensitivities, *, axes: Any = None) -> tuple[Figure, Any]:
    """Draw passive block and total of each plan, and its response to each error.

    Args:
        found: The sensitivities.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).

    Raises:
        InputError: If `axes` do not fit.
    """
    expect(Sensitivities, found, "planner.sensitivities(plans) makes one")
    high = 0.34 * len(found.plans) + 1.8
    figure, axes, ours = grid(1, 2, axes, size=(5.4, max(high, 3.0)))
    _sums(axes[0, 0], found)
    _errors(axes[0, 1], found)
    heading(figure, found.sentence, ours=ours)
    return figure, axes


def _sums(ax: Any, found: Sensitivities) -> None:
    """Draw bars of each plan's passive block and total, and a line at the irreducible part."""
    from matplotlib.patches import Patch  # slow to import

    labels, spread = list(found.plans), found.spread
    places, colour = np.arange(len(labels)), colours(labels)
    rows = (
        ("total", [each.total_deg(spread) for each in found.plans.values()], -0.2, PALE),
        ("passive block", list(found.passive_block_deg.values()), 0.2, 1.0),
    )
    handles = []
    for name, values, offset, alpha in rows:
        colour_list = [colour[label] for label in labels]
        bars = ax.barh(places + offset, values, height=0.36, color=colour_list, alpha=alpha)
        ax.bar_label(bars, fmt="%.3f", fontsize=8, padding=2)
        handles.append(Patch(color=LIMIT_COLOUR, alpha=alpha, label=name))
    floor = max(each.floor_deg(spread) for each in found.plans.values())
    handles.append(ax.axvline(floor, color=LIMIT_COLOUR, linestyle=":", label="irreducible"))
    ax.set_yticks(places, [escape_math(label) for label in labels])
    ax.set_ylim(len(labels) - 0.4, -1.2)  # room for the legend above the bars
    ax.margins(x=0.15)
    ax.set_xlabel("response at the end (deg, one standard deviation)")
    ax.legend(handles=handles, fontsize=8, loc="upper right", ncols=3)


def _errors(ax: Any, found: Sensitivities) -> None:
    """Draw bars side by side: each plan's response to one standard deviation of each error."""
    names, responses = found.responses
    sizes = found.sizes
    colour, width = colours(list(responses)), BAR_SPAN / len(responses)
    for k, (label, values) in enumerate(responses.items()):
        places = np.arange(len(names)) + (k - (len(responses) - 1) / 2) * width
        ax.bar(places, values, width, color=colour[label], label=escape_math(label))
    texts = [f"{parameter_symbol(n)}\n{size_of(*s)}" for n, s in zip(names, sizes, strict=True)]
    ax.set_xticks(range(len(names)), texts, fontsize=8)
    ax.set_ylabel("response of all angles at the end (deg)")
    ax.legend(fontsize=8)
