"""The manipulator's mechanism: motors, friction disks, bevel gears, belts, contacts.

The parts, contacts and radii are those of the paper (section 3.1, Figs 2 and 3). The paper does not
say which link carries which part; we assume the assignment from which eq. (6) follows, contact by
contact. Each joint i = 1 … n−1 has a *stage*: a stack of three contacts on the joint's axis. From
the side:

    wheel B    turned by motor 1 or by the stage before; its axle lies along link i−1
      P₁       on the face of disk A, at distance R from the axle of A, which stands on link i
    wheel B'   below A, carried by link i−1;  P₂ is also at distance R from the axle of A
      P₃       on the face of disk A', at distance r₃ from its axle, which stands on link i

Bevel gears and a shaft along link i lead from A to B of the next joint, a belt leads from A' to the
next joint itself. Each wheel is turned by θᵢ against the face that it touches, so each contact
transmits cosθᵢ of the speed:

    φ̇ᵢ₊₁ = r₁/(λR) cosθᵢ φ̇ᵢ  (P₁)        θ̇ᵢ₊₁ = r₁/(ηr₃) cos³θᵢ φ̇ᵢ  (P₁, P₂ and P₃)
"""

from __future__ import annotations

import io
import textwrap
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from planner.errors import expect
from planner.report.figures.style import COLOURS, LABEL_BOX, heading
from planner.support.arrays import Array
from planner.support.package import Figure
from planner.systems.manipulator import Gear, Manipulator, stage_gears
from planner.systems.triangular_system import TriangularSystem

MOTOR_2_COLOUR, CHAIN_COLOUR, BRANCH_COLOUR = COLOURS[:3]
CONTACT_COLOUR, LINK_COLOUR, INK_COLOUR, NOTE_COLOUR = "#B00020", "#9A9A9A", "#222222", "#666666"
BAND_COLOURS = ("#F3F3F3", "#FFFFFF")

RADII_PER_INCH = 1 / 1.3
"""Scale of the drawing: largest radii of the mechanism per inch of paper."""

NOTE_LETTERS = 62
"""Number of letters per line of the notes beside the view from above, 5 inches wide."""

RIM_RATIO = 1.12
"""Ratio of a drawn disk's radius to the distance of its contact, which lies inside the rim."""

THICKNESS = 0.07
"""Thickness of disks and wheels, in largest radii."""

BEND_ANGLE = np.deg2rad(35.0)
"""Angle of joint 1 in the view from above, rad."""


@dataclass(frozen=True)
class MechanismLayout:
    """Positions of all parts in the drawing of a mechanism, in units of the largest radius.

    Attributes:
        gears: Geometry of the stages 1 … n−1.
        unit: The largest radius, which is the unit of the positions.
        inferred: Text on the assumed geometry; empty if the geometry was given.
        joints: x of the joints' axes, shape (n,).
    """

    gears: tuple[Gear, ...]
    unit: float
    inferred: str
    joints: Array

    @property
    def r1(self) -> float:
        """Radius of the wheels B, and height of the shafts above P₁."""
        return self.gears[0].r1

    @property
    def r2(self) -> float:
        """Radius of the wheels B', which cancels out and is not part of the geometry."""
        return 0.6 * self.r1

    @property
    def p3(self) -> float:
        """Height of the contact P₃, if P₁ has height zero and P₂ is on the lower face of disk A."""
        return -THICKNESS - 2 * self.r2

    @property
    def belt(self) -> float:
        """Height of the belts in the side view."""
        return self.p3 - THICKNESS - 0.42

    @property
    def link(self) -> float:
        """Height of the links in the side view."""
        return self.belt - 0.3

    @property
    def top_view_z(self) -> float:
        """Height at which the view from above and the notes begin."""
        return self.link - 1.05

    @property
    def contact(self) -> Array:
        """Position of P₁ of joint 1 in the view from above."""
        side = max(1.25 + 0.25 * RADII_PER_INCH, (RIM_RATIO + np.sin(BEND_ANGLE)) * self.gears[0].R)
        return np.array([-0.2, self.top_view_z - 0.25 * RADII_PER_INCH - side])

    notes_x = 2.7
    """x at which the notes begin, to the right of the view from above."""

    left = -2.6

    @property
    def right(self) -> float:
        """x of the right end of the picture."""
        return max(float(self.joints[-1]) + 2.0, self.notes_x + 5.2 * RADII_PER_INCH)

    @property
    def top(self) -> float:
        """Height of the upper end of the picture."""
        return 2 * self.r1 + 0.75

    @property
    def bottom(self) -> float:
        """Height of the lower end of the picture."""
        lines = 17 + len(textwrap.wrap(self.inferred, NOTE_LETTERS))
        disk_bottom = float(self.contact[1]) - max(self.r1, 0.6 * self.gears[0].R)
        note_bottom = self.top_view_z - 0.2 * lines * RADII_PER_INCH
        return min(disk_bottom, note_bottom) - 0.15 * RADII_PER_INCH


def layout(system: Manipulator) -> MechanismLayout:
    """Return the geometry of a manipulator, given or inferred, and the positions of its stages."""
    stages, inferred = stage_gears(system)
    unit = max(max(g.r1, g.R, g.r3) for g in stages)
    gears = tuple(Gear(g.r1 / unit, g.R / unit, g.r3 / unit, g.lam, g.eta) for g in stages)
    spans = [(1 + RIM_RATIO) * max(g.R, g.r3) + 1 for g in gears]
    return MechanismLayout(gears, unit, inferred, np.concatenate([[0.0], np.cumsum(spans)]))


def plot_mechanism(system: TriangularSystem, *, axes: Any = None) -> tuple[Figure, Any]:
    """Draw the chain of friction disks, bevel gears and belts of a manipulator.

    The upper part is a side view of all stages with the arm stretched out. The lower part shows the
    first contact from above with joint 1 bent, which explains the factor cosθ. Radii are to scale
    if they are known; link lengths are not. An arm that is given by K and k_g has no radii, and an
    arm whose stages differ does not fit the drawing. For both, a geometry with the same joint rates
    and λ = η = R = 1 is inferred, and the figure says that the drawing is not to scale.

    Args:
        system: A `Manipulator`.
        axes: Axes to draw into, or None for a new figure; their unit is the largest radius.

    Returns:
        The figure and its axes.

    Raises:
        InputError: If the system is not a `Manipulator`.
    """
    expect(Manipulator, system, "problem.system of an arm with friction disks is one")
    assert isinstance(system, Manipulator)
    plan, ours = layout(system), axes is None
    if ours:
        from planner.report.figures.notebook_figure import NotebookFigure  # slow to import

        width, height = plan.right - plan.left, plan.top - plan.bottom
        size = (width / RADII_PER_INCH, height / RADII_PER_INCH + 0.4)
        axes = NotebookFigure(figsize=size, dpi=100, layout="constrained").subplots()
    axes.set(xlim=(plan.left, plan.right), ylim=(plan.bottom, plan.top), aspect="equal")
    axes.set_axis_off()
    pen = _Drawing(axes)
    _bands(pen, plan)
    _base(pen, plan)
    for i in range(1, system.n):
        _stage(pen, plan, i)
        _write_names(pen, plan, i)
    for i in range(1, system.n + 1):
        _link(pen, plan, i)
    _top_view(pen, plan)
    _write_notes(pen, plan)
    title = f"How two motors drive {system.n} joints: the arm stretched out, seen from the side"
    heading(axes.figure, title, ours=ours)
    return axes.figure, axes


@lru_cache(maxsize=8)  # drawing takes a second, and few sliders change the mechanism
def mechanism_svg(system: TriangularSystem) -> str:
    """Return the drawing of `plot_mechanism` as SVG; "" if the system is not a `Manipulator`."""
    if not isinstance(system, Manipulator):
        return ""
    import matplotlib as mpl  # slow to import

    figure, _ = plot_mechanism(system)
    stream = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "planner"}):  # so that the same system gives the same text
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


class _Drawing:
    """Pen that draws parts into axes; each part has a name (gid) for tests and scripts."""

    def __init__(self, ax: Any) -> None:
        from matplotlib import patches  # slow to import

        self.ax, self.patches = ax, patches

    def box(
        self, centre: Any, width: float, height: float, gid: str, colour: str, **look: Any
    ) -> None:
        corner = centre[0] - width / 2, centre[1] - height / 2
        self._add(self.patches.Rectangle(corner, width, height), gid, facecolor=colour, **look)

    def polygon(self, points: Array, gid: str, colour: str) -> None:
        self._add(self.patches.Polygon(points), gid, facecolor=colour, zorder=4)

    def circle(self, centre: Array, radius: float, gid: str, **look: Any) -> None:
        self._add(self.patches.Circle((centre[0], centre[1]), radius), gid, **look)

    def _add(self, patch: Any, gid: str, **look: Any) -> None:
        patch.set(**({"edgecolor": INK_COLOUR, "linewidth": 0.8, "zorder": 3, "gid": gid} | look))
        self.ax.add_patch(patch)

    def axle(self, start: Any, end: Any, colour: str) -> None:
        for width, shade, order in ((4.2, INK_COLOUR, 2.0), (2.8, colour, 2.1)):
            look = {"color": shade, "linewidth": width, "solid_capstyle": "butt", "zorder": order}
            self.ax.plot(*np.transpose([start, end]), **look)

    def line(self, start: Any, end: Any, dashes: Any) -> None:
        self.ax.plot(*np.transpose([start, end]), color=INK_COLOUR, linewidth=0.9, linestyle=dashes)

    def arrow(self, start: Any, end: Any, gid: str, **look: Any) -> None:
        look = {"color": INK_COLOUR, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0} | look
        self.ax.annotate("", end, start, arrowprops=look, zorder=7).set_gid(gid)

    def distance(self, start: Any, end: Any, text: str) -> None:
        self.arrow(start, end, f"distance {text}", arrowstyle="<->")
        self.write(np.mean([start, end], axis=0), text, ha="center", bbox=LABEL_BOX)

    def contact(self, place: Any, gid: str) -> None:
        look = {"color": CONTACT_COLOUR, "markeredgecolor": "white", "markersize": 7, "zorder": 7}
        self.ax.plot(*place, "o", gid=gid, **look)

    def write(
        self, place: Any, text: str, colour: str = INK_COLOUR, size: float = 9, **look: Any
    ) -> None:
        look = {"va": "center", "fontsize": size, "zorder": 8} | look
        self.ax.text(*place, text, color=colour, **look)


AXIS_DASHES = (0, (8, 3, 1, 3))
"""Dashes of axes of rotation, as on technical drawings."""


def _bands(pen: _Drawing, plan: MechanismLayout) -> None:
    """Shade each region between two successive joints, where one link carries all parts."""
    low = plan.link - 0.75
    for k, (a, b) in enumerate(pairwise([plan.left, *plan.joints.tolist(), plan.right])):
        middle, height = ((a + b) / 2, (plan.top + low) / 2), plan.top - low
        look = {"edgecolor": "none", "zorder": 0}
        pen.box(middle, b - a, height, f"band {k}", BAND_COLOURS[k % 2], **look)
        name = "base" if k == 0 else f"carried by link {k}"
        pen.write((middle[0], plan.top - 0.12), name, NOTE_COLOUR, ha="center")


def _base(pen: _Drawing, plan: MechanismLayout) -> None:
    """Draw the base, motor 1 on the axle of the first wheel and motor 2 on the axis of joint 1."""
    wall, floor, top = plan.left + 0.25, plan.link - 0.45, plan.r1 + 0.4
    motor, look = (wall + 0.75, plan.r1), {"hatch": "///"}
    pen.box((wall, (top + floor) / 2), 0.14, top - floor + 0.14, "base", LINK_COLOUR, **look)
    pen.box((wall / 2, floor), -wall, 0.14, "base", LINK_COLOUR, **look)
    pen.axle((wall, plan.r1), (0, plan.r1), CHAIN_COLOUR)
    pen.box(motor, 0.9, 0.5, "motor 1", CHAIN_COLOUR)
    pen.write(motor, "motor 1", "white", ha="center", weight="bold")
    pen.write((motor[0], plan.r1 + 0.42), r"$u_1 = \dot\varphi_1$", ha="center")
    pen.axle((0, floor), (0, plan.link), MOTOR_2_COLOUR)
    pen.box((0, floor), 0.9, 0.42, "motor 2", MOTOR_2_COLOUR)
    pen.write((0, floor), "motor 2", "white", ha="center", weight="bold")
    pen.write((0.55, floor), r"$u_2 = \dot\theta_1$: turns link 1 and all that it carries")


def _stage(pen: _Drawing, plan: MechanismLayout, i: int) -> None:
    """Draw the stage (stack of contacts) of joint i, and the parts that lead to joint i + 1."""
    gear, (x, next_x) = plan.gears[i - 1], plan.joints[i - 1 : i + 1].tolist()
    wheel_z, r1 = -THICKNESS - plan.r2, gear.r1
    pen.axle((x - 0.5, wheel_z), (x, wheel_z), BRANCH_COLOUR)
    pen.box((x - 0.5, wheel_z), 0.12, 0.26, f"bearing of B'{i}", LINK_COLOUR)
    pen.box((x, r1), THICKNESS, 2 * r1, f"B{i}", CHAIN_COLOUR)
    pen.box((x, wheel_z), THICKNESS, 2 * plan.r2, f"B'{i}", BRANCH_COLOUR)
    axle, lower = x + gear.R, x + gear.r3
    pen.box((axle, -THICKNESS / 2), 2 * RIM_RATIO * gear.R, THICKNESS, f"A{i}", CHAIN_COLOUR)
    height, width = plan.p3 - THICKNESS / 2, 2 * RIM_RATIO * gear.r3
    pen.box((lower, height), width, THICKNESS, f"A'{i}", BRANCH_COLOUR)
    for name, z in (("P1", 0.0), ("P2", -THICKNESS), ("P3", plan.p3)):
        pen.contact((x, z), f"{name} of joint {i}")
    if i == len(plan.gears):  # this disk drives no other
        pen.axle((axle, 0), (axle, 0.3 * r1), CHAIN_COLOUR)
        pen.box((axle, 0.3 * r1), 0.26, 0.12, f"bearing of A{i}", LINK_COLOUR)
    else:  # bevel gears of ratio λ: pitch cones whose common apex is where the axles meet
        wide = 0.34 * min(gear.R, r1 / gear.lam)
        cone, apex = np.array([wide, wide * gear.lam]), np.array([axle, r1])
        upright = np.array([(-1, -1), (1, -1), (0.55, -0.55), (-0.55, -0.55)])
        pen.polygon(apex + upright * cone, f"bevel gear of A{i}", CHAIN_COLOUR)
        pen.polygon(apex - upright[:, ::-1] * cone, f"bevel gear of B{i + 1}", CHAIN_COLOUR)
        pen.axle((axle, 0), (axle, r1 - cone[1]), CHAIN_COLOUR)
        pen.axle((axle + cone[0], r1), (next_x, r1), CHAIN_COLOUR)
    pulley = 0.24 / max(1.0, gear.eta)  # a belt of ratio η
    ends = lower - pulley, next_x + pulley * gear.eta
    pen.axle((lower, plan.p3 - THICKNESS), (lower, plan.belt), BRANCH_COLOUR)
    pen.axle((next_x, plan.belt), (next_x, plan.link), BRANCH_COLOUR)
    pen.box((lower, plan.belt), 2 * pulley, 0.16, f"pulley of A'{i}", BRANCH_COLOUR)
    pen.box(
        (next_x, plan.belt), 2 * pulley * gear.eta, 0.16, f"pulley of joint {i + 1}", BRANCH_COLOUR
    )
    pen.box((sum(ends) / 2, plan.belt), ends[1] - ends[0], 0.07, f"belt {i}", INK_COLOUR, zorder=5)


def _write_names(pen: _Drawing, plan: MechanismLayout, i: int) -> None:
    """Write the names of stage i's parts and its output speeds; for stage 1 also the distances."""
    gear, (x, next_x) = plan.gears[i - 1], plan.joints[i - 1 : i + 1].tolist()
    first, wheel_z = i == 1, -THICKNESS - plan.r2
    pen.write((x + 0.1, 2 * gear.r1), f"$B_{i}$" + (", a wheel" if first else ""))
    pen.write((x + 0.1, wheel_z - 0.5 * plan.r2), f"$B'_{i}$")
    pen.write(
        (x + (1 + RIM_RATIO) * gear.R + 0.05, -THICKNESS / 2),
        f"$A_{i}$" + (", a disk" if first else ""),
    )
    pen.write((x + (1 + RIM_RATIO) * gear.r3 + 0.05, plan.p3 - THICKNESS / 2), f"$A'_{i}$")
    for name, z in (("$P_1$", 0.1), ("$P_2$", -THICKNESS - 0.1), ("$P_3$", plan.p3 + 0.1)):
        pen.write((x - 0.1, z), name, CONTACT_COLOUR, ha="right")
    holder = "held by the base" if first else f"held by link {i - 1}"
    pen.write((x - 0.6, wheel_z), holder, NOTE_COLOUR, 8, ha="right")
    before = rf"{{{i}}}\;\dot\varphi_{{{i}}}$"
    joint = rf"$\dot\theta_{{{i + 1}}} = \frac{{r_1}}{{\eta\,r_3}}\,\cos^3\theta_{before}"
    middle = (x + gear.r3 + next_x) / 2
    pen.write((middle, plan.belt + 0.22), joint, size=11, ha="center")
    if i < len(plan.gears):
        disk = rf"$\dot\varphi_{{{i + 1}}} = \frac{{r_1}}{{\lambda R}}\,\cos\theta_{before}"
        pen.write(((x + 1.34 * gear.R + next_x) / 2, gear.r1 + 0.3), disk, size=11, ha="center")
        if first:
            gears = r"bevel gears ($\lambda$), long shaft"
            pen.write((x + 1.5 * gear.R, gear.r1 - 0.15), gears, NOTE_COLOUR, 8)
    if first:
        pen.write((middle, plan.belt - 0.16), r"belt ($\eta$)", NOTE_COLOUR, 8, ha="center")
        pen.distance((x, 0.22), (x + gear.R, 0.22), "$R$")
        pen.distance((x - 0.42, 0), (x - 0.42, gear.r1), "$r_1$")
        low = plan.p3 - THICKNESS - 0.14
        pen.distance((x, low), (x + gear.r3, low), "$r_3$")


def _link(pen: _Drawing, plan: MechanismLayout, i: int) -> None:
    """Draw the bar of link i and the axis of joint i, and name both and the joint's angle."""
    x = float(plan.joints[i - 1])
    end = float(plan.joints[i]) if i < len(plan.joints) else x + 1.5
    low, top = plan.link - 0.14 * (i % 2), 2 * plan.r1
    pen.box(((x + end) / 2, low), end - x, 0.1, f"link {i}", LINK_COLOUR, zorder=2.5)
    pen.line((x, plan.link - 0.3), (x, top + 0.2), AXIS_DASHES)
    colour, name = MOTOR_2_COLOUR if i == 1 else BRANCH_COLOUR, rf"joint {i}, $\theta_{i}$"
    pen.write((x, top + 0.36), name, colour, ha="center", weight="bold")
    pen.write(((x + end) / 2, low - 0.15), f"link {i}", ha="center")


def _top_view(pen: _Drawing, plan: MechanismLayout) -> None:
    """Draw contact P₁ of joint 1 from above, to the same scale, with the joint bent."""
    gear, here = plan.gears[0], plan.contact
    cos, sin = np.cos(BEND_ANGLE), np.sin(BEND_ANGLE)
    along, tangent = np.array([[cos, sin], [-sin, cos]])
    axle, far = here + gear.R * along, here + 2.35 * along
    rim = here + np.array([0.0, 1.25])
    label_place = here + 1.25 * cos * tangent
    pen.circle(axle, RIM_RATIO * gear.R, "A1 from above", facecolor=CHAIN_COLOUR, alpha=0.25)
    pen.circle(axle, gear.R, "track of P1", fill=False, linestyle=":")
    pen.axle((plan.left + 0.3, here[1]), here, CHAIN_COLOUR)
    pen.box(here, THICKNESS, 2 * gear.r1, "B1 from above", CHAIN_COLOUR, alpha=0.6)
    pen.line(here, far, AXIS_DASHES)
    pen.line(here, here + np.array([1.5, 0.0]), ":")
    arc = pen.patches.Arc((here[0], here[1]), 2, 2, theta1=0, theta2=np.rad2deg(BEND_ANGLE))
    pen.ax.add_patch(arc)
    half = np.array([np.cos(BEND_ANGLE / 2), np.sin(BEND_ANGLE / 2)])
    pen.write(here + 1.12 * half, r"$\theta_1$", ha="center")
    speed = {"arrowstyle": "-|>", "linewidth": 2.2}
    pen.arrow(here, rim, "speed of B1", color=CHAIN_COLOUR, **speed)
    pen.arrow(here, label_place, "speed of A1", color=CONTACT_COLOUR, **speed)
    pen.line(rim, label_place, "--")
    pen.contact(here, "P1 from above")
    title = f"From above: joint 1 bent by {np.rad2deg(BEND_ANGLE):.0f} degrees"
    pen.write((plan.left + 0.2, plan.top_view_z), title, size=9.5, weight="bold")
    name = r"rim of $B_1$: $r_1\dot\varphi_1$"
    pen.write(rim + np.array([-0.05, 0.1]), name, CHAIN_COLOUR, ha="right")
    name = "taken by $A_1$:\n" + r"$r_1\dot\varphi_1\cos\theta_1$"
    pen.write(label_place - np.array([0.1, 0.0]), name, CONTACT_COLOUR, ha="right")
    pen.write((plan.left + 0.3, here[1] + 0.15), "shaft of motor 1")
    pen.write((here[0] + 0.1, here[1] - 0.8 * gear.r1), "wheel $B_1$, on the base")
    pen.write(here - np.array([0.12, 0.14]), "$P_1$", CONTACT_COLOUR, ha="right")
    pen.write(axle + 0.5 * gear.R * tangent, "disk $A_1$,\non link 1", ha="center")
    pen.write(far + np.array([0.05, 0.0]), "link 1")


COSINE_NOTE = r"""The axis of joint 1 goes through the contact $P_1$. Bending the
arm by $\theta_1$ turns disk $A_1$ under wheel $B_1$ about this very point.
The rim of $B_1$ moves at $r_1\dot\varphi_1$. $A_1$ can only turn about its own
axle; so of it $A_1$ takes $R\,\dot\alpha_1=r_1\dot\varphi_1\cos\theta_1$.
It is the same at $P_2$, where $A_1$ drives $B'_1$, and at $P_3$, where
$B'_1$ drives $A'_1$. So cos$\theta_1$ comes once on the way to the next
disk, and three times on the way to the next joint: cos$^3\theta_1$."""


def _write_notes(pen: _Drawing, plan: MechanismLayout) -> None:
    """Write why cosθ appears, what the colours mean, and which geometry is drawn."""
    gear, unit = plan.gears[0], plan.unit
    lengths = {"$r_1$": gear.r1 * unit, "$R$": gear.R * unit, "$r_3$": gear.r3 * unit}
    values = lengths | {r"$\lambda$": gear.lam, r"$\eta$": gear.eta}
    geometry = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
    if len({round(g.r3, 9) for g in plan.gears}) > 1:
        geometry = geometry.replace("$r_3$", "$r_3$ of joint 1")
    scale = "Not to scale, but with the same K and k_g:" if plan.inferred else "To scale, with"
    lines = [
        (r"Why cos$\theta$", INK_COLOUR, "bold"),
        *((text, INK_COLOUR, "normal") for text in COSINE_NOTE.split("\n")),
        ("", INK_COLOUR, "normal"),
        ("orange: the drive of motor 1, transmitted from disk to disk", CHAIN_COLOUR, "bold"),
        ("green: the branch to the next joint, through a belt", BRANCH_COLOUR, "bold"),
        ("blue: motor 2, which turns joint 1", MOTOR_2_COLOUR, "bold"),
        ("red: friction contacts", CONTACT_COLOUR, "bold"),
        ("", INK_COLOUR, "normal"),
        (scale, INK_COLOUR, "bold"),
        (geometry + ("," if plan.inferred else "."), INK_COLOUR, "normal"),
        *((text, INK_COLOUR, "normal") for text in textwrap.wrap(plan.inferred, NOTE_LETTERS)),
        ("$r_2$ cancels out. The link lengths are not to scale.", INK_COLOUR, "normal"),
    ]
    for k, (text, colour, weight) in enumerate(lines):
        place = (plan.notes_x, plan.top_view_z - 0.2 * k * RADII_PER_INCH)
        pen.write(place, text, colour, 9.5, weight=weight)
