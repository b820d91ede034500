"""Plans on emulated machines: motion against the plan, effort against error, and the distribution
of the error over many machines.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.comparison.comparison import Comparison
from planner.comparison.rows import Row
from planner.errors import InputError, expect
from planner.machine.replay import Replay
from planner.plan.measures import effort_unit
from planner.plan.spec import Spec
from planner.report.figures.style import (
    REFUSED_SUFFIX,
    Curve,
    axis_label,
    colours,
    grid,
    heading,
    legend,
    make_logarithmic,
    shade_holds,
    time_label,
)
from planner.support.arrays import Array
from planner.support.package import Figure

REPLAY_HINT = "planner.replay(plan) makes one; several are given by label"


def plot_replays(
    replays: Replay | Mapping[str, Replay | None], *, axes: Any = None
) -> tuple[Figure, Any]:
    """Plot angles on the machine and in the plan over time; one row per plan, one column per angle.

    At each time the line is the median of the samples and the shaded band contains 90 % of them.
    Only samples with stored motions count (by default all; the first thousand in a comparison).

    Args:
        replays: One replay, or several by label; None for a plan that was not replayed.
        axes: Axes to draw into: plans × angles, in reading order.

    Returns:
        The figure and its axes, shape (plans, angles).

    Raises:
        InputError: If there is nothing to draw or `axes` do not fit.
    """
    if not isinstance(replays, Mapping):
        expect(Replay, replays, REPLAY_HINT)
        replays = {replays.plan.label: replays}
    colour = colours(list(replays))
    runs = {label: run for label, run in replays.items() if run is not None}
    for run in runs.values():
        expect(Replay, run, REPLAY_HINT)
    first = next(iter(runs.values()), None)
    if first is None or not first.angles:
        raise InputError("no plan with angles was replayed, so there is nothing to draw")
    shape = len(runs), len(first.angles)
    figure, axes, ours = grid(*shape, axes, size=(3.4, 2.2), share=("all", "col"))
    for row, (label, run) in enumerate(runs.items()):
        _draw_replay(axes[row], run, colour[label])
        curve = Curve(label, run.plan, colour[label])
        axes[row, 0].set_title(curve.name, fontsize=10, loc="left", color=curve.colour)
    for ax in axes[-1]:
        ax.set_xlabel(time_label(run.plan for run in runs.values()))
    text = f"Machine ({first.machine.preset}, {len(first.numbers)} samples) against plan"
    heading(figure, text, ours=ours)
    legend(figure, axes, axes[0, 0].get_legend_handles_labels()[0], ours=ours)
    return figure, axes


def median_sample(run: Replay) -> int:
    """Return the index of the sample in the replay whose E is the (lower) median."""
    order = np.argsort(run.index_E_deg, kind="stable")
    return int(order[(len(order) - 1) // 2])


def _draw_replay(axes: Any, run: Replay, colour: str) -> None:
    plan = run.plan
    t = run.t - plan.lead_s
    part = "" if len(run.q) == len(run.numbers) else f"first {len(run.q)} "
    planned = np.rad2deg(plan.trajectory.q(run.t))
    planned[run.t < 0] = np.nan
    for ax, i in zip(axes, run.angles, strict=True):
        shade_holds(ax, plan)
        low, middle, high = np.rad2deg(np.percentile(run.q[:, :, i], [5, 50, 95], axis=0))
        style = {"color": colour, "linewidth": 0}
        ax.fill_between(t, low, high, alpha=0.2, label=f"90 % of the {part}machines", **style)
        ax.plot(t, planned[:, i], "k--", linewidth=1.1, label="plan")
        ax.plot(t, middle, color=colour, linewidth=1.6, label="median machine")
        ax.set_ylabel(axis_label(plan.problem.system.coordinates[i]))


FEEDBACK_LABEL = "the same plan with feedback"


def plot_efforts(comparison: Comparison, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot the effort of each plan against its error index E on the machines.

    A dot is the median of E, a thick bar its 95 % confidence interval; a thin line extends to the
    95th percentile. A plan with feedback has a hollow dot, to which an arrow leads from the same
    plan without feedback.

    Args:
        comparison: The comparison; rows without replay are left out.
        axes: Axes to draw into.

    Returns:
        The figure and its axes.

    Raises:
        InputError: If no plan was replayed.
    """
    expect(Comparison, comparison, "planner.compare(problem) makes one")
    rows = [row for row in comparison.rows if np.isfinite([row.effort, row.E_median_deg]).all()]
    if not rows:
        raise InputError("no plan was replayed, so there are no errors to draw")
    colour = colours([row.spec.text for row in comparison.rows if not row.feedback])
    figure, axes, ours = grid(1, 1, axes, size=(6.4, 4.6))
    ax = axes[0, 0]
    for row in rows:
        _draw_row(ax, row, colour[row.spec.text])
    _join(ax, rows, colour)
    ax.set_xlabel(f"effort: integral of u1^2 + u2^2 dt ({effort_unit(comparison.problem.system)})")
    ax.set_ylabel("error index E (deg), median to 95 %")
    _scale(ax.xaxis, needs_log_axis([row.effort for row in rows]))
    _scale(ax.yaxis, needs_log_axis([row.E_median_deg for row in rows]))
    ax.set_title(f"Effort against error on {comparison.samples} emulated machines", fontsize=11)
    handles = ax.get_legend_handles_labels()[0]
    if any(row.feedback for row in rows):
        handles += ax.plot(
            [], [], "o", color="#444444", markerfacecolor="white", label=FEEDBACK_LABEL
        )
    legend(figure, ax, handles, ours=ours, abreast=2)
    return figure, ax


def needs_log_axis(values: ArrayLike) -> bool:
    """Return whether an axis should be logarithmic: values span more than a factor of ten."""
    every = np.asarray(values, dtype=float)
    return bool(np.min(every) > 0 and np.max(every) > 10 * np.min(every))


def _scale(axis: Any, log: bool) -> None:
    """Make an axis logarithmic, and say so in its label, if `log`; else start the axis at zero."""
    if not log:
        axis.axes.set(**{f"{axis.axis_name}lim": (0, None)})
        return
    make_logarithmic(axis)
    axis.set_label_text(f"{axis.get_label_text()}, log scale")


def _draw_row(ax: Any, row: Row, colour: str) -> None:
    low, high = row.E_median_interval_deg
    ax.plot([row.effort] * 2, [row.E_median_deg, row.E_p95_deg], color=colour, linewidth=1.0)
    ax.plot([row.effort] * 2, [low, high], color=colour, linewidth=4.0, alpha=0.5)
    label = None if row.feedback else row.label + REFUSED_SUFFIX * (not row.solved)
    look = {"color": colour, "markerfacecolor": "white" if row.feedback else colour, "label": label}
    ax.plot([row.effort], [row.E_median_deg], "o", linestyle="none", **look)
    if not row.solved:
        ax.plot([row.effort], [row.E_median_deg], "x", color="white", markersize=4)
    ax.plot([row.effort], [row.E_p95_deg], "_", color=colour, markersize=9)


def _join(ax: Any, rows: list[Row], colour: dict[str, str]) -> None:
    """Draw an arrow from each plan without feedback to the same plan with feedback."""
    without = {row.spec.text: (row.effort, row.E_median_deg) for row in rows if not row.feedback}
    for row in rows:
        if row.feedback and row.spec.text in without:
            look = {"arrowstyle": "->", "color": colour[row.spec.text], "linestyle": ":"}
            ax.annotate("", (row.effort, row.E_median_deg), without[row.spec.text], arrowprops=look)


def plot_errors(
    errors: Mapping[str, ArrayLike | None], *, refused: Collection[str] = (), axes: Any = None
) -> tuple[Figure, Any]:
    """Plot the share of machines whose error is below each value, with dots at median and 95 %.

    Curves of plans with feedback are dotted, in the colour of the same plan without feedback;
    curves of refused plans are dashed.

    Args:
        errors: For each plan its error index E on every sampled machine, shape (samples,), degrees;
            None for a plan that was not replayed (its colour stays reserved).
        refused: Labels of refused plans that were replayed for study.
        axes: Axes to draw into.

    Returns:
        The figure and its axes.

    Raises:
        InputError: If no plan was replayed.
    """
    expect(Mapping, errors, "give errors by label, as in {'mine': replay.index_E_deg}")
    arrays = {k: np.asarray(e, dtype=float) for k, e in errors.items() if e is not None}
    if not arrays:
        raise InputError("no plan was replayed, so there are no errors to draw")
    colour = colours(list(errors))
    figure, axes, ours = grid(1, 1, axes, size=(6.4, 4.0))
    ax = axes[0, 0]
    for label, error in arrays.items():
        _distribution(ax, label, np.sort(error), colour[label], label in refused)
    ax.set_ylim(0, 1.02)
    ax.set_xlabel("error index E (deg): largest joint error during the motion, eq. (29)")
    _scale(ax.xaxis, needs_log_axis(error_range(list(arrays.values()))))
    ax.set_ylabel("share of machines")
    ax.set_title(f"Error on {max(map(len, arrays.values()))} emulated machines", fontsize=11)
    legend(figure, ax, ax.get_legend_handles_labels()[0], ours=ours, abreast=1)
    return figure, ax


def _distribution(ax: Any, label: str, error: Array, colour: str, refused: bool) -> None:
    share = np.arange(1, len(error) + 1) / len(error)
    median, high = np.percentile(error, [50, 95])
    errors = f"median {median:.3g}, 95 % {high:.3g}" if len(error) > 1 else f"{median:.3g}"
    text = f"{label}{REFUSED_SUFFIX * refused}: {errors} deg"
    style, fill = ("--" if refused else "-", colour)
    if Spec.of_label(label).feedback:
        style, fill = ":", "white"
    ax.step(error, share, style, where="post", color=colour, linewidth=1.8, label=text)
    ax.plot([median, high], [0.5, 0.95], "o", color=colour, markerfacecolor=fill, markersize=5)


def error_range(errors: list[Array]) -> tuple[float, float]:
    """Return the first percentile of all errors and the largest error, as ends of an axis."""
    every = np.concatenate(errors)
    return float(np.percentile(every, 1)), float(np.max(every))
