"""Figures of robustness: how errors of the plan and the machine move the end of a motion.

These are heat maps for one plan, responses along the plan, bars that compare several plans, error
budgets, and trade-off curves between response and cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from planner.errors import expect
from planner.plan.measures import effort_unit
from planner.problem.tables.machine_effects import effect_words
from planner.report.figures.style import (
    COLOURS,
    LIMIT_COLOUR,
    colour_of,
    colours,
    escape_math,
    grid,
    heading,
    legend,
    symbol,
)
from planner.robustness.budget import Budget, Cost, total
from planner.robustness.machine_sensitivity import MachineSensitivity, entry_name
from planner.robustness.sensitivities import Sensitivities
from planner.robustness.sensitivity import PAPER_SPREAD, Sensitivity, size_of
from planner.robustness.sobol import Index
from planner.robustness.trade_off import TradeOff
from planner.support.arrays import Array
from planner.support.package import Figure
from planner.support.tables import number

COLOUR_MAP = "Blues"
"""Colour map; light for no response, dark for the largest."""


def plot_sensitivity(
    found: Sensitivity, spread: Mapping[str, float] = PAPER_SPREAD, *, axes: Any = None
) -> tuple[Figure, Any]:
    """Draw the error of each angle at the end, degrees, for one reference error of each parameter.

    Boxes mark the passive block: the response of the joints without a motor (θ₂ … θₙ) to the start
    of θ₁ and the gain of u₂. Dots mark the floor, the entries that depend only on start and goal.

    Args:
        found: The sensitivities.
        spread: Standard deviation of each parameter, which is its reference error; a parameter
            without one gets a typical size (see `Sensitivity.reference`).
        axes: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    expect(Sensitivity, found, "planner.sensitivity(plan) makes one")
    names = [found.plan.problem.system.coordinates[i].name for i in found.angles]
    first = found.plan.problem.system.coordinates[0].name
    columns = [p for p, name in enumerate(found.parameters) if name != f"start {first}"]
    labels = [
        f"{parameter_symbol(found.parameters[p])}\n"
        + size_of(found.reference(spread)[p], found.units[p])
        for p in columns
    ]
    values = found.contribution_deg(spread)[:, columns]
    figure, ax, ours = _heat_map(values, [symbol(n) for n in names], labels, axes)
    for row, column in np.argwhere(found.floor[np.ix_(found.angles, columns)]):
        ax.plot(column - 0.38, row - 0.34, "o", color=COLOURS[1], markersize=4)
    _box_passive(ax, found, columns)
    total, floor = found.total_deg(spread), found.floor_deg(spread)
    text = (
        f"{found.plan.method}: total {total:.4g} deg, of it the floor (dots) {floor:.4g};"
        f" passive block (boxes) {found.passive_block_deg(spread):.3g}"
    )
    heading(figure, text, ours=ours)
    return figure, ax


def plot_machine_sensitivity(
    found: MachineSensitivity, *, most: int = 24, axes: Any = None
) -> tuple[Figure, Any]:
    """Draw the error of each angle at the end, degrees, for one spread of each machine parameter.

    The spread is the standard deviation between machines. A parameter without one changes by a
    step.

    Args:
        found: The sensitivities.
        most: Largest number of parameters shown; those with the largest response are chosen.
        axes: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    expect(MachineSensitivity, found, "planner.machine_sensitivity(plan) makes one")
    loud = found.loudest[:most]
    labels = [f"{entry_name(e)}: {e.reference:.3g} {e.unit}".strip() for e in loud]
    values = np.stack([e.contribution for e in loud], axis=0)
    figure, ax, ours = _heat_map(values, labels, [*map(symbol, found.angles)], axes, tall=True)
    nominal = ", ".join(f"{e:.2g}" for e in found.nominal_error_deg)
    heading(figure, f"{found.plan.method} on the machine; nominal errors {nominal} deg", ours=ours)
    return figure, ax


def plot_responses(
    found: Sensitivity, spread: Mapping[str, float] = PAPER_SPREAD, *, axes: Any = None
) -> tuple[Figure, Any]:
    """Plot the standard deviation of each angle along the plan, degrees, that errors of the
    parameters cause.

    Args:
        found: The sensitivities.
        spread: Standard deviation of each parameter's error, by name.
        axes: Axes to draw into.

    Returns:
        The figure and its axes.
    """
    expect(Sensitivity, found, "planner.sensitivity(plan) makes one")
    figure, axes, ours = grid(1, 1, axes, size=(6.4, 3.4))
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


def _heat_map(
    values: Array, rows: Sequence[str], columns: Sequence[str], axes: Any, *, tall: bool = False
) -> tuple[Figure, Any, bool]:
    size = (4.6, 0.28 * len(rows) + 0.9) if tall else (0.72 * len(columns), 0.5 * len(rows) + 1.2)
    figure, axes, ours = grid(1, 1, axes, size=size)
    ax = axes[0, 0]
    ax.grid(False)
    shade = np.abs(values) ** 0.5  # small responses stay visible beside large ones
    most = max(float(np.max(shade)), 1e-12)
    ax.imshow(shade, cmap=COLOUR_MAP, aspect="auto", vmin=0, vmax=1.3 * most)
    for (i, j), value in np.ndenumerate(values):
        if abs(value) >= 5e-4:
            ax.text(j, i, f"{value:.2g}", ha="center", va="center", fontsize=8)
    ax.set_yticks(range(len(rows)), rows, fontsize=8)
    ax.set_xticks(range(len(columns)), columns, fontsize=7 if not tall else 9)
    ax.tick_params(length=0)
    return figure, ax, ours


def _box_passive(ax: Any, responses: Sensitivity, columns: Sequence[int]) -> None:
    from matplotlib.patches import Rectangle

    system = responses.plan.problem.system
    passive = [k for k, i in enumerate(responses.angles) if i >= 2]
    for name in (f"start {system.coordinates[1].name}", f"gain {system.inputs[1].name}"):
        column = columns.index(responses.parameters.index(name))
        for row in passive:
            corner = (column - 0.47, row - 0.47)
            ax.add_patch(Rectangle(corner, 0.94, 0.94, fill=False, edgecolor="black", lw=1.2))


def parameter_symbol(parameter: str) -> str:
    """Return the label of a plan's parameter, with mathematical symbols for Matplotlib."""
    word, _, which = parameter.partition(" ")
    return f"{word} {symbol(which)}" if which else symbol(f"k{word[1:]}").replace("k", "K")


PALE = 0.35
"""Opacity of the bars of totals, so that those of the passive blocks stand out."""

BAR_SPAN = 0.8
"""Width of a group of bars, one group per error, relative to the distance between groups."""


def plot_sensitivities(found: Sensitivities, *, axes: Any = None) -> tuple[Figure, Any]:
    """Draw each plan's passive block, total, and response to each error, as bars.

    Args:
        found: The sensitivities.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).

    Raises:
        InputError: If `axes` do not fit.
    """
    expect(Sensitivities, found, "planner.sensitivities(plans) makes one")
    figure, axes, ours = grid(1, 2, axes, size=(5.4, max(0.34 * len(found.plans) + 1.8, 3.0)))
    _sums(axes[0, 0], found)
    _errors(axes[0, 1], found)
    heading(figure, found.sentence, ours=ours)
    return figure, axes


def _sums(ax: Any, result: Sensitivities) -> None:
    """Draw bars of each plan's passive block and total, and a line at the floor."""
    from matplotlib.patches import Patch  # slow to import

    labels, spread = list(result.plans), result.spread
    places, colour = np.arange(len(labels)), list(colours(labels).values())
    rows = (
        ("total", [each.total_deg(spread) for each in result.plans.values()], -0.2, PALE),
        ("passive block", list(result.passive_block_deg.values()), 0.2, 1.0),
    )
    handles = []
    for name, values, offset, alpha in rows:
        bars = ax.barh(places + offset, values, height=0.36, color=colour, alpha=alpha)
        ax.bar_label(bars, fmt="%.3f", fontsize=8, padding=2)
        handles.append(Patch(color=LIMIT_COLOUR, alpha=alpha, label=name))
    floor = max(each.floor_deg(spread) for each in result.plans.values())
    handles.append(ax.axvline(floor, color=LIMIT_COLOUR, linestyle=":", label="floor"))
    ax.set_yticks(places, [escape_math(label) for label in labels])
    ax.set_ylim(len(labels) - 0.4, -1.2)  # room for the legend above the bars
    ax.margins(x=0.15)
    ax.set_xlabel("response at the end (deg, one standard deviation)")
    ax.legend(handles=handles, fontsize=8, loc="upper right", ncols=3)


def _errors(ax: Any, result: Sensitivities) -> None:
    """Draw bars side by side: each plan's response to one standard deviation of each error."""
    names, responses = result.responses
    sizes = result.sizes
    colour, width = colours(list(responses)), BAR_SPAN / len(responses)
    for k, (label, values) in enumerate(responses.items()):
        places = np.arange(len(names)) + (k - (len(responses) - 1) / 2) * width
        ax.bar(places, values, width, color=colour[label], label=escape_math(label))
    texts = [f"{parameter_symbol(n)}\n{size_of(*s)}" for n, s in zip(names, sizes, strict=True)]
    ax.set_xticks(range(len(names)), texts, fontsize=8)
    ax.set_ylabel("response at the end (deg)")
    ax.legend(fontsize=8)


def plot_budget(budget: Budget, *, axes: Any = None) -> tuple[Figure, Any]:
    """Draw what each machine effect adds to the error E and to its variance, as bars.

    Error bars are 95 % intervals. `planner.robustness.budget.Cost` explains the four kinds.

    Args:
        budget: The budget.
        axes: Two axes to draw into.

    Returns:
        The figure and its axes, shape (1, 2).
    """
    expect(Budget, budget, "planner.error_budget(plan) makes one")
    costs, places = budget.costs, np.arange(len(budget.costs))
    figure, axes, ours = grid(1, 2, axes, size=(5.2, 0.3 * len(costs) + 1.2), share=("none", "all"))
    left, right = axes[0]
    off, alone = "saved by switching it off", "alone, all others off"
    _bars(left, places - 0.2, [c.saves_deg for c in costs], _reach(costs, "saves"), 0, off)
    _bars(left, places + 0.2, [c.alone_deg for c in costs], _reach(costs, "alone"), 1, alone)
    left.set_xlabel("error index E (deg)")
    labels = {"between": "its spread between machines", "switch": "switching it on or off"}
    for k, (kind, label) in enumerate(labels.items()):
        indices = [getattr(c, kind) or Index(np.nan, np.nan, np.nan, np.nan) for c in costs]
        values, half = [i.total for i in indices], [i.total_half for i in indices]
        _bars(right, places + (k - 0.5) * 0.4, values, half, 2 + k, label)
    right.set_xlabel("total Sobol index: share of the variance of E")
    right.set_xlim(left=min(0.0, right.get_xlim()[0]), right=min(1.2, right.get_xlim()[1]))
    left.set_yticks(places, [effect_words(c.name) for c in costs])
    left.set_ylim(len(costs) - 0.4, -0.6)
    if ours:
        figure.suptitle(f"Error budget of {budget.plan.method}: {total(budget)}", fontsize=11)
    handles = [h for ax in (left, right) for h in ax.get_legend_handles_labels()[0]]
    legend(figure, axes, handles, ours=ours, abreast=4)
    return figure, axes


def _bars(ax: Any, places: Any, values: Any, reach: Any, colour: int, label: str) -> None:
    style = {"height": 0.38, "color": COLOURS[colour], "label": label}
    ax.barh(places, values, xerr=reach, error_kw={"linewidth": 0.9, "ecolor": "#444444"}, **style)


def _reach(costs: tuple[Cost, ...], kind: str) -> Any:
    """Return the lengths of error bars below and above each cost, shape (2, effects), degrees.

    `kind` is "saves" or "alone". A length is 0 if the interval is unknown.
    """
    middle = np.array([getattr(c, f"{kind}_deg") for c in costs])
    ends = np.array([getattr(c, f"{kind}_interval_deg") for c in costs]).reshape(-1, 2)
    return np.nan_to_num(np.maximum([middle - ends[:, 0], ends[:, 1] - middle], 0.0))


AXIS_LABELS = {
    "effort": "effort: integral of u1^2 + u2^2 dt ({unit})",
    "duration": "duration (s)",
    "peak": "largest input, share of its limit",
}
KNEE_STYLE = {"marker": "o", "markersize": 11, "fillstyle": "none", "markeredgewidth": 1.8}


def plot_trade_off(curve: TradeOff, *, axes: Any = None) -> tuple[Figure, Any]:
    """Plot a trade-off curve: response and errors on machines against cost, and three paths.

    The paths are those of the first point of the curve, of its knee and of its last point.

    Args:
        curve: The curve.
        axes: Three axes to draw into.

    Returns:
        The figure and its axes, shape (1, 3).

    Raises:
        InputError: If `axes` do not fit.
    """
    expect(TradeOff, curve, "planner.trade_off(problem) makes one")
    figure, axes, ours = grid(1, 3, axes, size=(4.3, 3.6))
    _responses(axes[0, 0], curve)
    _machines(axes[0, 1], curve)
    _paths(axes[0, 2], curve)
    heading(figure, f"{curve.problem.name}: {knee_sentence(curve)} (rings: the knee)", ours=ours)
    return figure, axes


PASSIVE_SHARE = 0.99
"""Share of the first point's passive block below which `knee_sentence` reports the passive block at
the knee; above, the change would not be visible, and the sentence reports the total."""


def knee_sentence(curve: TradeOff) -> str:
    """Return a sentence (without full stop) on gain and cost of a trade-off curve's knee."""
    first, knee = curve.points[0], curve.knee
    unit = {"effort": f" {effort_unit(curve.problem.system)}", "duration": " s", "peak": ""}
    cost = f"{curve.kind} {number(curve.cost[curve.knee_index])}{unit[curve.kind]}"
    if knee is first:
        return f"the first point, {cost}, is the knee: a higher cost gains little"
    what, before, after = "a total", first.total_deg, knee.total_deg
    if knee.passive_deg < PASSIVE_SHARE * first.passive_deg:
        what, before, after = "a passive block", first.passive_deg, knee.passive_deg
    both = f"{number(after, 4)} deg instead of {number(before, 4)}"
    return f"at the knee {cost} gives {what} of {both}"


def _responses(ax: Any, curve: TradeOff) -> None:
    cost = curve.cost
    for colour, label, values in (
        (COLOURS[0], "total", [p.total_deg for p in curve.points]),
        (COLOURS[1], "passive block", [p.passive_deg for p in curve.points]),
    ):
        ax.plot(cost, values, ".-", color=colour, label=label)
        ax.plot(cost[curve.knee_index], values[curve.knee_index], color=colour, **KNEE_STYLE)
    ax.axhline(curve.points[0].floor_deg, color="#555555", linestyle=":", label="floor")
    ax.set_ylim(bottom=0)
    ax.set_xlabel(_cost_label(curve))
    ax.set_ylabel("response at the end (deg, one standard deviation)")
    ax.legend(fontsize=8)


def _machines(ax: Any, curve: TradeOff) -> None:
    cost, knee = curve.cost, curve.knee_index
    for colour, label, which in (
        (colour_of("collocation"), "machine, plan as it is", "machine"),
        (colour_of("collocation compensated"), "machine, compensated", "compensated"),
        (COLOURS[0], "design errors alone", "errors_alone"),
    ):
        replays = [getattr(p, which) or {} for p in curve.points]
        values = [f.get("end_p95_deg", np.nan) for f in replays]
        none = sum("refused" in f for f in replays)
        if none == len(replays):
            continue
        label += f" (not possible for {none} of {len(replays)})" if none else ""
        ax.plot(cost, values, ".-", color=colour, label=label)
        ax.plot(cost[knee], values[knee], color=colour, **KNEE_STYLE)
    ax.set_ylim(0, 1.35 * ax.get_ylim()[1])  # room for the legend above every curve
    ax.set_xlabel(_cost_label(curve))
    ax.set_ylabel("largest joint error at the end (deg, 95 %)")
    ax.legend(fontsize=8, loc="upper right")


def _paths(ax: Any, curve: TradeOff) -> None:
    system = curve.problem.system
    chosen = dict.fromkeys([0, curve.knee_index, len(curve.points) - 1])
    for colour, k in zip(COLOURS, chosen, strict=False):
        point = curve.points[k]
        q = point.plan.q(np.linspace(0, point.plan.duration, 800))
        label = f"{curve.kind} {curve.cost[k]:.3g}, {reversals(point.reversals)}"
        ax.plot(np.rad2deg(q[:, 0] - q[0, 0]), np.rad2deg(q[:, 1]), color=colour, label=label)
    ax.set_xlabel(f"travel of {symbol(system.coordinates[0].name)} (deg)")
    ax.set_ylabel(f"{symbol(system.coordinates[1].name)} (deg)")
    ax.legend(fontsize=8)


def reversals(count: int) -> str:
    """Return the number of reversals of the drive in words."""
    return {0: "one way", 1: "1 reversal"}.get(count, f"{count} reversals")


def _cost_label(curve: TradeOff) -> str:
    return AXIS_LABELS[curve.kind].format(unit=effort_unit(curve.problem.system))
