"""The results of a sweep as one picture: what each method solves, and at what effort."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.report.figures.style import colours, grid, make_logarithmic
from planner.sweep.results import Record, solved_by_method

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_sweep(columns: Sequence[str], records: Sequence[Record]) -> Figure:
    """Draw the solved cases of each method, the effort of each solved case, and E if replayed.

    Refused cases have no dot. If only one key is varied and its values are numbers, these values
    are the horizontal axis; otherwise the axis counts the points of the sweep.

    Args:
        columns: Names of the columns; those before `method` are the varied keys.
        records: The finished cases; `planner.sweep.results.read` gives both.
    """
    counts = solved_by_method(records)
    colour = colours(list(counts))
    rows = [("effort", "effort of the solved cases")]
    if any(record["E_median_deg"] is not None for record in records):
        rows.append(("E_median_deg", "median E of the solved cases (deg)"))
    figure, axes, _ = grid(1, 1 + len(rows), size=(4.6, max(2.8, 0.5 * len(counts) + 1.4)))
    ax = axes[0, 0]
    for k, (label, (solved, total)) in enumerate(counts.items()):
        ax.barh(k, total, color="#E8E8E8")
        ax.barh(k, solved, color=colour[label])
        ax.text(0.02 * total, k, f"{label}: {solved} of {total}", va="center", bbox=_PAPER)
    ax.set_yticks([])
    ax.invert_yaxis()
    ax.set_xlabel("solved cases")
    ax.xaxis.get_major_locator().set_params(integer=True)
    places, name = _places(columns[: columns.index("method")], records)
    for ax, (key, text) in zip(axes[0, 1:], rows, strict=True):
        for label in counts:
            mine = [
                (places[k], r[key])
                for k, r in enumerate(records)
                if r["method"] == label and r["solved"] and r[key] is not None
            ]
            if mine:
                ax.plot(*np.transpose(mine), "o", color=colour[label], label=label, alpha=0.8)
        ax.set_xlabel(name)
        if name == POINT:
            ax.xaxis.get_major_locator().set_params(integer=True)
        ax.set_ylabel(text)
        if ax.has_data():
            make_logarithmic(ax.yaxis)
    return figure


_PAPER = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
"""Look of the box behind the counts, which keeps the counts readable on every colour."""


POINT = "point (in the order of the sweep)"


def _places(keys: Sequence[str], records: Sequence[Record]) -> tuple[list[float], str]:
    """Return the position of each case along the horizontal axis, and the label of the axis."""
    if len(keys) == 1 and all(type(r[keys[0]]) in (int, float) for r in records):
        return [float(r[keys[0]]) for r in records], keys[0]
    points: dict[str, int] = {}
    texts = (repr([r[key] for key in keys]) for r in records)
    return [float(points.setdefault(text, len(points) + 1)) for text in texts], POINT
