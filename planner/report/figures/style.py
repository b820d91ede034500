"""Common style of all figures: one colour per plan, names with units, grids of axes.

Figures are made with `matplotlib.figure.Figure` itself, not with pyplot, so they need no display
and leave no global state. A notebook shows the figure that a function returns.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from planner.errors import InputError
from planner.plan.plan import Plan, expect_plan
from planner.plan.recorded.log import RECORDED
from planner.plan.spec import Spec
from planner.support.arrays import Array
from planner.support.calculus.extremes import sample_times
from planner.support.package import Figure
from planner.support.tables import clean_text
from planner.systems.triangular_system import Coordinate, TriangularSystem

PALETTE = (
    ("#0072B2", "#0072b2", "#5aaae6"),
    ("#D55E00", "#d55e00", "#f08a4b"),
    ("#009E73", "#009e73", "#35c79c"),
    ("#CC79A7", "#b85a93", "#e2a0c4"),
    ("#E69F00", "#b87a00", "#f0b64a"),
    ("#56B4E9", "#3a9ad9", "#93d1f7"),
    ("#000000", "#1b1e22", "#e5e6e3"),
    ("#882255", "#882255", "#d97fab"),
    ("#999933", "#7d7d1f", "#c6c65a"),
    ("#332288", "#332288", "#a79be8"),
    ("#117733", "#0f6a2e", "#a9e5a0"),
)
"""Plans' colours, each in three variants: for pictures, and for a browser on light and on dark.

The colours are distinct for all common kinds of colour vision (M. Okabe, K. Ito, 2008; P. Tol,
2021)."""

COLOURS = tuple(picture for picture, _, _ in PALETTE)

METHOD_COLOURS = {
    "polynomial": 0,
    "polynomial:points=auto": 1,
    "polynomial compensated": 9,
    "sinusoid": 2,
    "sinusoid compensated": 10,
    "collocation": 3,
    "collocation compensated": 6,
    "convex": 5,
    "piecewise": 4,
    "desensitised": 7,
    "sinusoid_steps": 8,
}
"""Index in `PALETTE` of each method's colour in all figures. A second plan of the same method, and
a plan of a method that is missing here, take a colour that is still free in the picture."""

DOMAIN_COLOUR = "#DCEBF5"
OUTSIDE_COLOUR = "#F3D9D0"
LIMIT_COLOUR = "#555555"
LABEL_BOX = {"boxstyle": "square,pad=0.1", "color": "white", "alpha": 0.7}
"""Look of the box behind a text on curves."""

GRID_STYLE = {"color": "#DDDDDD", "linewidth": 0.6}

REFUSED_SUFFIX = " (refused)"
"""Suffix of a refused plan's label, in legends and titles."""

Sharing = Literal["none", "all", "row", "col"]

Plans = Plan | Sequence[Plan] | Mapping[str, Plan | None]
"""One plan, several, or several by label; a label without a plan only reserves its colour."""


@dataclass(frozen=True)
class Curve:
    """A plan and how figures draw it.

    Attributes:
        label: Name in legends and titles.
        plan: The plan.
        colour: Colour, the same in all figures.
        followed: Whether the plan's compensated plan, which has the same path, is drawn too.
    """

    label: str
    plan: Plan
    colour: str
    followed: bool = False

    @property
    def look(self) -> dict[str, Any]:
        """Colour, dashes and width of the line; wide and pale below a compensated plan."""
        wide = {"linewidth": 4.5, "alpha": 0.45} if self.followed else {"linewidth": 1.6}
        return {"color": self.colour, "linestyle": self.dashes, **wide}

    @property
    def refused(self) -> bool:
        """Whether the plan is refused and drawn only for study."""
        fine = self.plan.verified or self.plan.status in ("solved", RECORDED)
        return not fine or not self.plan.executable

    @property
    def dashes(self) -> str:
        """Style of the line: dashed if the plan is refused."""
        return "--" if self.refused else "-"

    @property
    def name(self) -> str:
        """Label of the plan, with a suffix if the plan is refused."""
        return f"{self.label}{REFUSED_SUFFIX}" if self.refused else self.label

    @property
    def title(self) -> str:
        """Name of the plan, wrapped for narrow panels."""
        label = self.label.replace(":", ":\n", 1) if len(self.label) > 24 else self.label
        return f"{label}\nrefused" if self.refused else label


def curves(plans: Plans, *, executable: bool = False) -> list[Curve]:
    """Return the plans with labels and colours; leaving out a plan changes no other's colour.

    Args:
        plans: One plan, several, or several by label.
        executable: Whether to leave out plans that are not executable.

    Raises:
        InputError: If `plans` contains something else than plans, or no plan is left to draw.
    """
    if isinstance(plans, str) or not isinstance(plans, Iterable):
        expect_plan(plans)
        plans = {plans.label: plans}
    listed: list[Any] = list(plans.values() if isinstance(plans, Mapping) else plans)
    for plan in listed:
        if plan is not None or not isinstance(plans, Mapping):
            expect_plan(plan)
    if not isinstance(plans, Mapping):
        names = {f"{k + 1}: {plan.label}": plan.label for k, plan in enumerate(listed)}
        plans = dict(zip(names, listed, strict=True))
        colour = {label: COLOURS[k] for label, k in colour_numbers(names, names).items()}
    else:
        colour = colours(list(plans))
    specs = {label: Spec.of_label(label) for label in plans}
    paths = {spec.plain for spec in specs.values() if spec.compensated and not spec.feedback}
    drawn_curves = [
        Curve(label, plan, colour[label], specs[label] in paths)  # drawn by the compensated plan
        for label, plan in plans.items()
        if plan is not None and (plan.executable or not executable)
    ]
    if not drawn_curves:
        raise InputError(f"there is no {'executable ' * executable}plan to draw")
    return drawn_curves


def colours(labels: Sequence[str]) -> dict[str, str]:
    """Return each plan's colour by label; a plan has the same colour with and without feedback."""
    return {label: COLOURS[k] for label, k in colour_numbers(labels).items()}


def colour_numbers(labels: Iterable[str], names: Mapping[str, str] | None = None) -> dict[str, int]:
    """Return the index in `PALETTE` of each plan's colour, by label.

    A plan has the colour of its method, unless an earlier plan has taken it. `names` are the plans'
    usual labels, by label, if the labels are others.
    """
    names = names or {}
    specs = {k: replace(Spec.of_label(names.get(k, k)), feedback=False) for k in labels}
    groups = {label: label if label in names else spec.label for label, spec in specs.items()}
    usual = {
        groups[label]: METHOD_COLOURS.get(
            spec.text, METHOD_COLOURS.get(replace(spec, settings=()).text)
        )
        for label, spec in specs.items()
    }
    spare = [k for k in range(len(PALETTE)) if k not in usual.values()]
    number: dict[str, int] = {}
    for k, (plan, one) in enumerate(usual.items()):
        if one is None or one in number.values():
            one = spare.pop(0) if spare else k % len(PALETTE)
        number[plan] = one
    return {label: number[plan] for label, plan in groups.items()}


def colour_of(method: str) -> str:
    """Return the colour of a method's plans in pictures."""
    return COLOURS[METHOD_COLOURS[method]]


def times(plan: Plan, count: int = 1500) -> Array:
    """Return the times (m,), s, at which to draw a plan, denser near the ends of its pieces."""
    return sample_times(plan.t, max(count, 12 * (len(plan.t) - 1)))


def shade_holds(ax: Any, plan: Plan) -> None:
    """Shade the times at which a compensated plan's clock is held to take up lost motion."""
    for begin, end in plan.clock.holds:
        ax.axvspan(begin - plan.lead_s, end - plan.lead_s, color=HOLD_COLOUR, linewidth=0, zorder=0)


HOLD_COLOUR = "#EEEEEE"
"""Colour of the times at which a compensated plan's clock is held."""


def time_label(plans: Iterable[Plan]) -> str:
    """Return the label of a time axis on which 0 is the plan's start, after preparatory motions."""
    return "time since the plan's start (s)" if any(p.lead_s for p in plans) else "time (s)"


def grid(
    rows: int,
    columns: int,
    axes: Any = None,
    *,
    size: tuple[float, float] = (3.4, 2.6),
    share: tuple[Sharing, Sharing] = ("none", "none"),
) -> tuple[Figure, Any, bool]:
    """Return a figure, its axes of shape (rows, columns), and whether the figure is new.

    Args:
        rows: Number of rows.
        columns: Number of columns.
        axes: Axes to draw into, rows × columns of them in reading order; None for a new figure.
        size: Width and height of one panel, inches.
        share: Sharing of x and of y, as in `matplotlib.figure.Figure.subplots`.

    Raises:
        InputError: If the number of `axes` is wrong.
    """
    if axes is not None:
        array = np.array(axes, dtype=object, ndmin=1)
        if array.size != rows * columns:
            raise InputError(
                f"this figure needs {rows * columns} axes ({rows} x {columns}), not {array.size}"
            )
        array = array.reshape(rows, columns)
        return array[0, 0].figure, array, False

    from planner.report.figures.notebook_figure import NotebookFigure  # slow to import

    figure = NotebookFigure(
        figsize=(max(size[0] * columns, 4.8), size[1] * rows + 0.5), dpi=100, layout="constrained"
    )
    panels = figure.subplots(rows, columns, squeeze=False, sharex=share[0], sharey=share[1])
    for ax in panels.flat:
        ax.grid(**GRID_STYLE)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
    return figure, panels, True


def make_logarithmic(axis: Any) -> None:
    """Make an axis logarithmic, with plain numbers on it."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def symbol(name: str) -> str:
    """Return a name as Matplotlib's mathematics if it has a number, so that theta1 becomes θ₁."""
    match = re.fullmatch(r"(theta|phi|alpha|beta|[a-z])(\d+)", name)
    if not match:
        return escape_math(name.replace("_", " "))
    letter, number = match.groups()
    return f"${letter if len(letter) == 1 else chr(92) + letter}_{{{number}}}$"


_LETTERS = {"theta": "θ", "phi": "φ", "alpha": "α", "beta": "β"}
_DIGITS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def readable_name(name: str) -> str:
    """Return theta1 as θ₁ and u2 as u₂; other names with spaces instead of underscores."""
    match = re.fullmatch(r"(theta|phi|alpha|beta|[a-z])(\d+)", name)
    if not match:
        return name.replace("_", " ")
    letter, digits = match.groups()
    return _LETTERS.get(letter, letter) + digits.translate(_DIGITS)


def escape_math(text: str) -> str:
    """Escape the user's text for Matplotlib, which reads text between two $ as mathematics."""
    return clean_text(text).replace("$", r"\$")


def axis_label(coordinate: Coordinate) -> str:
    """Return the name of a coordinate and the unit in which it is drawn."""
    return f"{symbol(coordinate.name)} ({escape_math(unit_of(coordinate))})"


def unit_of(coordinate: Coordinate) -> str:
    """Return the unit in which a coordinate is drawn: degrees for angles."""
    return "deg" if coordinate.unit == "rad" else coordinate.unit


def length_unit(system: TriangularSystem) -> str:
    """Return the unit of positions in the plane: m, or "link lengths" if all lengths are 1."""
    lengths = getattr(system, "link_lengths", None)
    return "m" if lengths is None or np.any(lengths != 1) else "link lengths"


def to_display(values: Array, unit: str) -> Array:
    """Convert values to the unit in which they are drawn: degrees for angles."""
    return np.rad2deg(values) if unit == "rad" else values


def write_beside(ax: Any, text: str, place: Any, shift: tuple[int, int], **look: Any) -> None:
    """Draw a label next to a point, offset in points, on a white background."""
    look = {"textcoords": "offset points", "fontsize": 8, "bbox": LABEL_BOX} | look
    ax.annotate(text, place, shift, **look)


def line(curve: Curve) -> Any:
    """Return a legend entry with the look and name of a curve."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=curve.name, **curve.look)


def legend(
    figure: Figure, axes: Any, handles: Sequence[Any], *, ours: bool, abreast: int = 3
) -> None:
    """Draw a legend: below the axes if the figure is `ours`, made here; else in the first axes."""
    if ours:
        columns = min(abreast, len(handles))
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    else:
        np.ravel(axes)[0].legend(handles=handles, fontsize=8, loc="upper right")


def heading(figure: Figure, text: str, *, ours: bool) -> None:
    """Set a title above the figure if the figure is `ours`, made here instead of by the caller."""
    if ours:
        letters = int(11 * figure.get_figwidth())
        figure.suptitle(escape_math(textwrap.fill(text, letters)), fontsize=11)
