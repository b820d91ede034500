"""Recorded runs with their plan and prediction, and the residuals after identification."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.errors import expect
from planner.machine.identification.identify import Identification
from planner.plan.plan import Plan, expect_plan
from planner.plan.recorded.log import Log, expect_log
from planner.report.figures.style import COLOURS, GRID_STYLE, grid, heading, legend, symbol
from planner.support.arrays import Array
from planner.support.package import Figure

RECORDED_STYLE = {"color": COLOURS[0], "linewidth": 1.0}
PLAN_STYLE = {"color": "black", "linewidth": 1.1, "linestyle": "--", "zorder": 3}
PREDICTION_STYLE = {"color": COLOURS[1], "linewidth": 1.2}
MEAN_S = 0.3
"""Window of the running mean, s; the mean shows differences that the encoders' steps hide."""


def plot_run(
    log: Log, plan: Plan, prediction: Log | None = None, *, axes: Any = None
) -> tuple[Figure, Any]:
    """Plot the angles of a recorded run, of its plan and of a machine's prediction over time.

    Below each angle, the reading minus the plan and the reading minus the prediction are shown
    pale, with their running means over 0.3 s. The curve of a compensated plan is the motion that
    the plan expects of its machine, instead of the original path.

    Args:
        log: The run; its first nonzero command is taken to be that of the plan (`Log.part` cuts off
            earlier commands).
        plan: The executed plan.
        prediction: A machine's motion under the log's commands: `Identification.predict(log)`.
        axes: Axes to draw into: two rows, one column for each joint.

    Returns:
        The figure and its axes, shape (2, n).

    Raises:
        InputError: If `log` or `plan` has the wrong type, or `axes` do not fit.
    """
    expect_log(log)
    expect_plan(plan)
    joints = log.theta.shape[1]
    figure, axes, ours = grid(2, joints, axes, size=(3.4, 2.1), share=("all", "none"))
    t = log.t - log.start_s(plan)
    planned = log.theta_deg - log.errors_deg(plan)[1]
    compensated = plan.compensates is not None
    name_of_plan = f"motion that the {plan.label} plan expects" if compensated else "plan"
    for i in range(joints):
        above, below = axes[0, i], axes[1, i]
        above.plot(t, log.theta_deg[:, i], **RECORDED_STYLE, label="recorded")
        above.plot(t, planned[:, i], **PLAN_STYLE, label=name_of_plan)
        _differences(below, t, log.theta_deg[:, i] - planned[:, i], PLAN_STYLE)
        if prediction is not None:
            above.plot(t, prediction.theta_deg[:, i], **PREDICTION_STYLE, label="prediction")
            left = log.theta_deg[:, i] - prediction.theta_deg[:, i]
            _differences(below, t, left, PREDICTION_STYLE)
        name = symbol(f"theta{i + 1}")
        above.set_ylabel(f"{name} (deg)")
        below.set_ylabel(f"recorded minus, {name} (deg)")
        below.set_xlabel("time from the first command (s)")
    heading(figure, f"Recorded run: {log.source}", ours=ours)
    legend(figure, axes, axes[0, 0].get_legend_handles_labels()[0], ours=ours)
    return figure, axes


def _differences(ax: Any, t: Array, values: Array, style: dict[str, Any]) -> None:
    """Draw values at equally spaced times t in a pale colour, and their running mean on top."""
    window = np.ones(min(len(t), 1 + 2 * round(MEAN_S / 2 * (len(t) - 1) / float(t[-1] - t[0]))))
    mean = np.convolve(values, window, "same") / np.convolve(np.ones_like(values), window, "same")
    ax.plot(t, values, color=style["color"], linewidth=0.5, alpha=0.25, zorder=1)
    ax.plot(t, mean, **style)


def identification_figure(result: Identification) -> tuple[Figure, Any]:
    """Plot readings minus prediction of every run, and what the runs say about each parameter.

    Each run has one row, for the identified machine and, paler, for the preset; a run kept out of
    the fit comes last. The bottom row shows how far each parameter is from the preset, with its
    spread as error bar, in standard deviations of its prior.

    Args:
        result: The result of `planner.identify`.

    Raises:
        InputError: If `result` is not an `Identification`.
    """
    from planner.report.figures.notebook_figure import NotebookFigure  # slow to import

    expect(Identification, result, "planner.identify(logs, problem) makes one")
    runs = [*result.logs, *([] if result.kept_out is None else [result.kept_out])]
    figure = NotebookFigure(figsize=(10.5, 2.2 * len(runs) + 2.6), layout="constrained")
    every: Any = figure.subplots(len(runs) + 1, 1)
    for ax, log in zip(every, runs, strict=False):
        best, before = result.predict(log), result.predict(log, result.preset)
        for i in range(log.theta.shape[1]):
            looks = {"color": COLOURS[i], "linewidth": 0.8}
            ax.plot(log.t, log.theta_deg[:, i] - before.theta_deg[:, i], **looks, alpha=0.3)
            left = log.theta_deg[:, i] - best.theta_deg[:, i]
            ax.plot(log.t, left, **looks, label=symbol(f"theta{i + 1}"))
        note = " (kept out of the fit)" if log is result.kept_out else ""
        ax.set_title(f"{log.source}{note}", fontsize=9, loc="left")
        ax.set_ylabel("read minus predicted (deg)", fontsize=8)
        ax.grid(**GRID_STYLE)
    every[0].legend(fontsize=8, title="pale: the preset", ncols=3)
    every[-2].set_xlabel("time (s)")
    estimates = result.estimates
    shift = [(e.value - e.preset) * e.parameter.scale / e.parameter.prior for e in estimates]
    spread = [e.spread * e.parameter.scale / e.parameter.prior for e in estimates]
    places = np.arange(len(estimates))
    every[-1].errorbar(places, shift, yerr=spread, fmt="o", color=COLOURS[0], markersize=4)
    every[-1].axhline(0, color="#888888", linewidth=0.8)
    every[-1].set_xticks(places, [e.parameter.key for e in estimates], fontsize=8)
    every[-1].set_ylabel("from the preset\n(deviations of the prior)", fontsize=8)
    every[-1].grid(**GRID_STYLE)
    return figure, every
