"""Pictures of sweeps and of design studies: the trade-off, and figures of merit over designs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.errors import expect
from planner.report.figures.style import (
    COLOURS,
    colours,
    escape_math,
    grid,
    heading,
    legend,
    make_logarithmic,
    write_beside,
)
from planner.support.files import toml
from planner.support.package import Figure
from planner.support.tables import number
from planner.sweep.design.figures import CONTACT_LOAD, DesignFigure, DesignRow
from planner.sweep.design.result import DesignStudy
from planner.sweep.results import Record, statuses_by_method

COLOUR_MAP = "Blues"
"""Colour map; dark for large values."""

TAKEN_COLOUR, PRESENT_COLOUR = COLOURS[1], COLOURS[2]
SLIP_COLOUR, OTHER_COLOUR = "#B00020", "#9A9A9A"

LOG_RATIO = 5.0
"""Factor between values of a figure of merit above which the axis or shade is logarithmic."""

MAX_LABELS = 8
"""Largest number of labelled points of the Pareto front; more labels would overlap."""


def plot_design(study: DesignStudy, *, axes: Any = None) -> tuple[Figure, Any]:
    """Draw the Pareto front, and maps or bars of the most important figures of merit.

    Figures of merit are maps if the designs form a grid over two numeric design variables,
    otherwise bars. A ring, box or colour marks the recommended design, a cross or the word "slips"
    contacts that would slip, hatching or words a design that cannot be built.

    Args:
        study: The study.
        axes: Six axes to draw into, or None for a new figure.

    Returns:
        The figure and its axes, shape (2, 3).

    Raises:
        InputError: If `axes` do not fit.
    """
    expect(DesignStudy, study, "planner.design_study(file) makes one")
    bars = _variables(study) is None
    high = 0.24 * len(study.rows) + 1.0 if bars else 3.3
    figure, axes, ours = grid(2, 3, axes, size=(4.4, max(high, 3.3)))
    _front(axes[0, 0], study)
    for ax, each in zip(axes.flat[1:], _decisive_figures(study), strict=False):
        (_bars if bars else _map)(ax, study, each)
    for ax in axes.flat[1 + len(_decisive_figures(study)) :]:
        ax.set_axis_off()
    choice = study.recommended
    answer = "no design solves a task" if choice is None else f"take {choice.design.name}"
    heading(figure, f"{study.title}: {answer}", ours=ours)
    legend(figure, axes, axes[0, 0].get_legend_handles_labels()[0], ours=ours, abreast=5)
    return figure, axes


def _decisive_figures(study: DesignStudy) -> list[DesignFigure]:
    """Return the up to five figures of merit to draw.

    These are, in order: those of the front, the contacts' load, tasks with a one-way motion, tasks
    solved by a second method, errors at the end.
    """
    by_key = {figure.key: figure for figure in study.figures}
    solved = [key for key in by_key if key.startswith("solved ")]
    after = [key for key in ("compensated_end_deg", "end_deg") if key in by_key]
    keys = [*(f.key for f in study.front_by), CONTACT_LOAD, "one_way", *solved[1:2], *after]
    return [by_key[key] for key in dict.fromkeys(keys)][:5]


def _front(ax: Any, study: DesignStudy) -> None:
    """Plot the designs and their Pareto front.

    The axes are the front's first two figures of merit, or the only one and the contacts' load. A
    line joins the front if these are all its figures.
    """
    x, *rest = study.front_by
    y = rest[0] if rest else next(f for f in study.figures if f.key == CONTACT_LOAD)
    built = [row for row in study.rows if row.figures]
    solved = f"solved {study.input.reaching}"
    most = max((row[solved] for row in built), default=0.0)
    fewer = [r for r in built if r[solved] < most]
    slipping = [r for r in built if r[solved] == most and not r.holds]
    holding = [r for r in built if r[solved] == most and r.holds]
    edges = []
    for figure, axis in ((x, ax.xaxis), (y, ax.yaxis)):
        edges.append(_scale_axis(axis, [r[figure.key] for r in holding or built]))
        axis.set_label_text(_figure_title(study, figure))
    for label, marker, colour, rows in (
        ("solves fewer tasks", "v", OTHER_COLOUR, fewer),
        ("contacts slip (at an edge: beyond it)", "x", SLIP_COLOUR, slipping),
        ("beaten by another", "o", OTHER_COLOUR, [r for r in holding if r not in study.front]),
    ):
        if rows:
            values = ([r[figure.key] for r in rows] for figure in (x, y))
            places = (np.clip(v, *edge) for v, edge in zip(values, edges, strict=True))
            look = {"marker": marker, "color": colour, "s": 30, "zorder": 3, "clip_on": False}
            ax.scatter(*places, label=label or None, **look)
    front = sorted(study.front, key=lambda row: row[x.key])
    line = [r[x.key] for r in front], [r[y.key] for r in front]
    joined = "-" if len(study.front_by) <= 2 else ""  # a front of more figures is no curve here
    ax.plot(*line, f"o{joined}", color=COLOURS[0], zorder=3, label="no other design beats these")
    ring = {"s": 130, "facecolor": "none", "linewidth": 2.0, "zorder": 4}
    present = next((row for row in built if not row.design.values), None)
    for row, colour, label in (
        (present, PRESENT_COLOUR, "as it is"),
        (study.recommended, TAKEN_COLOUR, "recommended"),
    ):
        if row is not None and not np.isnan([row[x.key], row[y.key]]).any():
            ax.scatter(row[x.key], row[y.key], edgecolor=colour, label=label, **ring)
    some = np.linspace(0, len(front) - 1, min(len(front), MAX_LABELS)).round().astype(int)
    for row in (front[k] for k in some):
        words = ", ".join(number(v) for v in row.design.values.values() if not isinstance(v, list))
        if not row.design.values:  # marked by its ring already
            continue
        name = escape_math(words or row.design.name)
        write_beside(ax, name, (row[x.key], row[y.key]), (5, 5), fontsize=7, zorder=2)


def _scale_axis(axis: Any, values: Sequence[float]) -> tuple[float, float]:
    """Set and return the ends of an axis, logarithmic if the values are far apart."""
    numbers = [v for v in values if np.isfinite(v)] or [0.0, 1.0]
    low, high = min(numbers), max(numbers)
    if low > 0 and high > LOG_RATIO * low:
        make_logarithmic(axis)
        room = (high / low) ** 0.12
        ends = low / room, high * room
    else:
        room = 0.12 * (high - low) or 0.1 * abs(high) or 1.0
        ends = low - room, high + room
    axis.axes.set(**{f"{axis.axis_name}lim": ends})
    return ends


def _figure_title(study: DesignStudy, figure: DesignFigure) -> str:
    words = {
        CONTACT_LOAD: "contacts: load over that of slip",
        "motor_torque_nm": "torque of motor 1",
        "motor_power_w": "power of motor 1",
        "one_way": f"tasks of {study.tasks} with a one-way motion",
        "spread_deg": "spread at the end on the machine",
        "E_deg": "error E on the machine",
        "end_deg": "error at the end on 95 % of the machines",
        "compensated_end_deg": "error at the end, compensated, on 95 %",
    }
    title = words.get(figure.key, figure.title)
    if figure.key.startswith("solved "):
        title = f"tasks of {study.tasks} solved by {figure.key.removeprefix('solved ')}"
    return escape_math(f"{title} ({figure.unit})" if figure.unit else title)


def _value(study: DesignStudy, figure: DesignFigure, row: DesignRow) -> tuple[float, str]:
    """Return a design's figure of merit as number and text; a share of tasks becomes a count."""
    value = row.figures.get(figure.key, np.nan)
    if figure.reduction == "part":
        return value * study.tasks, number(value * study.tasks, 4)
    return value, number(value, 2)


def _variables(study: DesignStudy) -> tuple[str, str] | None:
    """Return the names of the two design variables of the maps; None unless designs form a grid."""
    rows = [row.design.values for row in study.rows if row.design.values]
    keys = list(rows[0]) if rows else []
    if len(keys) != 2 or any(values.keys() != rows[0].keys() for values in rows):
        return None
    if any(isinstance(value, list) for values in rows for value in values.values()):
        return None
    across, up = (len({values[k] for values in rows}) for k in keys)
    return (keys[0], keys[1]) if min(across, up) > 1 and across * up <= 2 * len(rows) else None


def _map(ax: Any, study: DesignStudy, figure: DesignFigure) -> None:
    """Draw one figure of merit as a map over two design variables, one cell per design."""
    from matplotlib.patches import Rectangle

    variables = _variables(study)
    assert variables is not None
    rows = [row for row in study.rows if row.design.values]
    across, up = ([row.design.values[key] for row in rows] for key in variables)
    columns, lines = sorted(set(across)), sorted(set(up))
    shade = np.full((len(lines), len(columns)), np.nan)
    places = [(columns.index(x), lines.index(y)) for x, y in zip(across, up, strict=True)]
    for (i, j), row in zip(places, rows, strict=True):
        shade[j, i] = _value(study, figure, row)[0]
    finite = shade[np.isfinite(shade)]
    if finite.size and finite.min() > 0 and finite.max() > LOG_RATIO * finite.min():
        shade, finite = np.log(shade), np.log(finite)
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    room = max(high - low, 1e-9)
    ax.grid(False)
    ax.imshow(
        shade, cmap=COLOUR_MAP, origin="lower", aspect="auto", vmin=low, vmax=high + 0.35 * room
    )
    for (i, j), row in zip(places, rows, strict=True):
        look: dict[str, Any] = {"fill": False}
        if row.design.refused:
            look |= {"hatch": "////", "edgecolor": OTHER_COLOUR, "linewidth": 0.0}
            ax.add_patch(Rectangle((i - 0.5, j - 0.5), 1, 1, **look))
            continue
        dark = np.isfinite(shade[j, i]) and (shade[j, i] - low) / room > 0.75
        text = _value(study, figure, row)[1]
        ink = "white" if dark else "black"
        ax.text(i, j, text, ha="center", va="center", fontsize=8, color=ink)
        if not row.holds:
            ax.plot(i + 0.36, j + 0.34, "x", color=SLIP_COLOUR, markersize=6, markeredgewidth=1.6)
        if row is study.recommended:
            look |= {"edgecolor": TAKEN_COLOUR, "linewidth": 2.4, "zorder": 5}
            ax.add_patch(Rectangle((i - 0.47, j - 0.47), 0.94, 0.94, **look))
    ax.set_xticks(range(len(columns)), [number(v) for v in columns])
    ax.set_yticks(range(len(lines)), [number(v) for v in lines])
    ax.set_xlabel(variables[0])
    ax.set_ylabel(variables[1])
    ax.set_title(_figure_title(study, figure), fontsize=9)


def _bars(ax: Any, study: DesignStudy, figure: DesignFigure) -> None:
    """Draw one figure of merit as bars, one per design."""
    values = [_value(study, figure, row) for row in study.rows]
    most = max((v for v, _ in values if np.isfinite(v)), default=1.0)
    for k, (row, (value, text)) in enumerate(zip(study.rows, values, strict=True)):
        colour = COLOURS[0] if row.design.values else PRESENT_COLOUR
        colour = TAKEN_COLOUR if row is study.recommended else colour
        if row.design.refused:
            ax.text(0, k, " cannot be built", va="center", fontsize=7, color=OTHER_COLOUR)
        elif np.isfinite(value):
            ax.barh(k, value, color=colour, height=0.7)
            slips = "" if row.holds else "  slips"
            ink = "black" if row.holds else SLIP_COLOUR
            ax.text(value, k, f" {text}{slips}", va="center", fontsize=7, color=ink)
    names = [escape_math(row.design.name) for row in study.rows]
    ax.set_yticks(range(len(names)), names, fontsize=7)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlim(min(0.0, min((v for v, _ in values if np.isfinite(v)), default=0.0)), 1.2 * most)
    ax.set_title(_figure_title(study, figure), fontsize=9)


def draw_sweep(columns: Sequence[str], records: Sequence[Record], title: str = "") -> Figure:
    """Draw the solved cases of each method, the effort of each solved case, and E if replayed.

    Refused cases are crosses at the bottom. If only one key is varied and its values are numbers,
    these values are the horizontal axis; otherwise the axis names the points of the sweep, or
    counts them if there are many.

    Args:
        columns: Names of the columns; those before `method` are the varied keys.
        records: The finished cases; `planner.sweep.results.read` gives both.
        title: Title above the figure.
    """
    counts = statuses_by_method(records)
    colour = colours(list(counts))
    rows = [("effort", "effort")]
    if any(record["E_median_deg"] is not None for record in records):
        rows.append(("E_median_deg", "median E (deg)"))
    figure, axes, _ = grid(1, 1 + len(rows), size=(4.6, max(2.8, 0.5 * len(counts) + 1.4)))
    ax = axes[0, 0]
    for k, (label, statuses) in enumerate(counts.items()):
        solved, total = statuses["solved"], statuses.total()
        ax.barh(k, total, color="#E8E8E8")
        ax.barh(k, solved, color=colour[label])
        ax.text(0.02 * total, k, f"{label}: {solved} of {total}", va="center", bbox=_PAPER)
    ax.set_yticks([])
    ax.invert_yaxis()
    ax.set_xlabel("solved cases")
    ax.xaxis.get_major_locator().set_params(integer=True)
    keys = columns[: columns.index("method")]
    places, names = _places(keys, records)
    for ax, (key, text) in zip(axes[0, 1:], rows, strict=True):
        for j, label in enumerate(counts):
            aside = 0.2 * (j - (len(counts) - 1) / 2) if names else 0.0  # no dot hides another
            mine = [
                (x + aside, r) for x, r in zip(places, records, strict=True) if r["method"] == label
            ]
            dots = [(x, r[key]) for x, r in mine if r["solved"] and r[key] is not None]
            if dots:
                ax.plot(*np.transpose(dots), "o", color=colour[label], label=label, alpha=0.8)
            refused = [x for x, r in mine if not r["solved"]]
            look = {"color": colour[label], "label": f"{label}: refused", "markersize": 4}
            height = [0.02 + 0.03 * j] * len(refused)
            ax.plot(refused, height, "x", transform=ax.get_xaxis_transform(), **look)
        ax.set_xlabel(", ".join(keys) if len(names) <= MOST_NAMES else POINT)
        if 0 < len(names) <= MOST_NAMES:
            ax.set_xticks(range(1, len(names) + 1), names, rotation=40, ha="right", fontsize=8)
        elif names:
            ax.xaxis.get_major_locator().set_params(integer=True)
        ax.set_ylabel(f"{text}; x: refused")
        if ax.has_data():
            make_logarithmic(ax.yaxis)
    heading(figure, title, ours=True)
    return figure


MOST_NAMES = 20
"""Most points of a sweep whose names fit below an axis."""

_PAPER = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
"""Look of the box behind the counts, which keeps the counts readable on every colour."""


POINT = "point (in the order of the sweep)"


def _places(keys: Sequence[str], records: Sequence[Record]) -> tuple[list[float], list[str]]:
    """Return the place of each case along the horizontal axis, and the names of the places 1, 2 …;
    no names if the places are the values of the varied key."""
    if len(keys) == 1 and all(type(r[keys[0]]) in (int, float) for r in records):
        return [float(r[keys[0]]) for r in records], []
    points: dict[str, int] = {}
    texts = (", ".join(toml(r[key]) for key in keys) for r in records)
    return [float(points.setdefault(text, len(points) + 1)) for text in texts], list(points)
