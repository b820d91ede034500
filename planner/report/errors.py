"""How large the error on the machine is, over many sampled machines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from planner.comparison import FEEDBACK
from planner.errors import InputError
from planner.report.style import colours, grid, legend
from planner.systems.base import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_errors(errors: Mapping[str, ArrayLike | None], *, ax: Any = None) -> tuple[Figure, Any]:
    """Share of machines with an error below each value; median and 95th percentile as dots.

    Plans with feedback are dotted, in the colour of the plan without.

    Args:
        errors: For each plan its error index E on every sampled machine, shape (samples,), degrees;
            None for a plan that was not replayed (it keeps its colour).
        ax: Axes to draw into.

    Returns:
        The figure and its axes.

    Raises:
        InputError: If no plan was replayed.
    """
    known = {k: np.asarray(e, dtype=float) for k, e in errors.items() if e is not None}
    if not known:
        raise InputError("no plan was replayed, so there are no errors to draw")
    colour = colours(list(errors))
    ours = ax is None
    figure, axes = grid(1, 1, ax, size=(6.4, 4.0))
    ax = axes[0, 0]
    for label, error in known.items():
        _distribution(ax, label, np.sort(error), colour[label])
    if _decades(list(known.values())) > 1.0:
        ax.set_xscale("log")
        from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    else:
        ax.set_xlim(left=0)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("error index E (deg): largest joint error during the motion, eq. (29)")
    ax.set_ylabel("share of machines with a smaller error")
    count = max(len(e) for e in known.values())
    ax.set_title(f"Error on {count} emulated machines", fontsize=11)
    legend(figure, ax, ax.get_legend_handles_labels()[0], ours=ours, abreast=1)
    return figure, ax


def _distribution(ax: Any, label: str, error: Array, colour: str) -> None:
    share = np.arange(1, len(error) + 1) / len(error)
    median, high = np.percentile(error, [50, 95])
    text = f"{label}: median {median:.3g}, 95 % {high:.3g} deg"
    closed = label.endswith(FEEDBACK)
    style, fill = (":", "white") if closed else ("-", colour)
    ax.step(error, share, style, where="post", color=colour, linewidth=1.8, label=text)
    ax.plot([median, high], [0.5, 0.95], "o", color=colour, markerfacecolor=fill, markersize=5)


def _decades(errors: list[Array]) -> float:
    every = np.concatenate(errors)
    low = float(np.percentile(every, 1))
    return float(np.log10(np.max(every) / low)) if low > 0 else 0.0
