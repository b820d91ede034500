"""The motion in the plane: poses of the arm and the path of its tip, or those of a vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.errors import InputError
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.requirements.places import Waypoint
from planner.report.figures.style import (
    Curve,
    Plans,
    curves,
    grid,
    heading,
    length_unit,
    times,
    write_beside,
)
from planner.support.arrays import Array
from planner.support.package import Figure
from planner.systems.triangular_system import TriangularSystem

COLOUR_MAP = "viridis"


def plot_arm(plans: Plans, *, axes: Any = None, poses: int = 12) -> tuple[Figure, Any]:
    """Draw the arm at equal time steps, coloured by time, and the path of its tip: one panel per
    plan.

    Vehicles are drawn by their axles, other systems with coordinates x and y as a point.

    Args:
        plans: One plan, several, or several by label; plans that are not executable (no real angles
            at some time) are left out.
        axes: Axes to draw into, one per executable plan.
        poses: Number of poses.

    Returns:
        The figure and its axes, shape (1, plans), or (plans, 1) for motions at least twice as wide
        as high.

    Raises:
        InputError: If no plan is executable, `axes` do not fit, or the system has no position in
            the plane (see `can_draw`).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    drawn, ours = drawable(plans), axes is None
    problem = drawn[0].plan.problem
    figure, axes = plane_axes(drawn, axes)
    scale = ScalarMappable(Normalize(0, max(c.plan.duration for c in drawn)), COLOUR_MAP)
    for curve, ax in zip(drawn, axes.flat, strict=True):
        _draw(ax, curve, scale, poses)
    what = "The arm and the path of its tip" if hasattr(problem.system, "arm_points") else "Path"
    heading(figure, f"{what}, time as colour: {problem.name}", ours=ours)
    figure.colorbar(scale, ax=list(axes.flat), label="time (s)", shrink=0.8)
    return figure, axes


def drawable(plans: Plans) -> list[Curve]:
    """Return the executable plans as curves to draw in the plane.

    Raises:
        InputError: If no plan is executable, or the system has no position in the plane.
    """
    drawn = curves(plans, executable=True)
    system = drawn[0].plan.problem.system
    if not can_draw(system):
        raise InputError(f"a {system.kind} has neither an arm nor x and y to draw")
    return drawn


def can_draw(system: TriangularSystem) -> bool:
    """Return whether `plot_arm` can draw a system: an arm, or a system with coordinates x and y."""
    names = {c.name for c in system.user_coordinates}
    return hasattr(system, "arm_points") or {"x", "y"} <= names


def body_points(problem: Problem, q: Array) -> Array:
    """Return points of the arm or vehicle at q (…, N), (…, P, 2); the last is the tip or (x, y)."""
    system: Any = problem.system
    if hasattr(system, "arm_points"):
        return np.asarray(system.arm_points(q[..., 1:]))
    if hasattr(system, "axle_points"):
        return np.asarray(system.axle_points(q))
    return _position(system, system.user(q))[..., None, :]


def _position(system: TriangularSystem, w: Array) -> Array:
    """Return x and y of user coordinates w (…, N), shape (…, 2)."""
    names = [c.name for c in system.user_coordinates]
    return np.stack([w[..., names.index("x")], w[..., names.index("y")]], axis=-1)


def draw_places(ax: Any, problem: Problem) -> None:
    """Draw obstacles (discs), waypoints and the tip's goal (a cross).

    A waypoint is drawn as a dotted pose if it gives every joint, as a point if it gives only x and
    y.
    """
    from matplotlib.patches import Circle

    for disc in problem.obstacles:
        centre, apart = tuple(disc.centre), disc.radius + disc.clearance
        ax.add_patch(Circle(centre, disc.radius, color="0.55", alpha=0.6, zorder=1))
        if disc.clearance:
            ax.add_patch(Circle(centre, apart, fill=False, color="0.55", linestyle=":", zorder=1))
        name = f"obstacle\n{disc.number}"  # narrow, since links pass beside the disc
        ax.annotate(name, disc.centre, fontsize=7, ha="center", va="center")
    for point in problem.waypoints:
        points = _pose_to_pass(problem, point)
        if np.all(np.isfinite(points)):
            ax.plot(*points.T, "o:", color="black", linewidth=1, markersize=3, zorder=4)
            write_beside(ax, f"waypoint {point.number}", points[-1], (6, 4))
    if problem.tip is not None and problem.tip.place is not None:
        ax.plot(*problem.tip.place, "x", color="black", markersize=9, zorder=6)


def _pose_to_pass(problem: Problem, point: Waypoint) -> Array:
    """Return points of the arm or vehicle at a waypoint, (P, 2); NaN where a coordinate is free."""
    system = problem.system
    if system.has_user_coordinates and np.any(np.isnan(point.q)):
        return _position(system, point.user)[None]
    return body_points(problem, point.q)


def tips_to_pass(problem: Problem) -> Array:
    """Return positions of the tip at its goal and at waypoints that fix it, shape (m, 2)."""
    tips = [_pose_to_pass(problem, point)[-1] for point in problem.waypoints]
    if problem.tip is not None and problem.tip.place is not None:
        tips.append(problem.tip.place)
    return np.array([tip for tip in tips if np.all(np.isfinite(tip))]).reshape(-1, 2)


MOST_ABREAST = 4
"""Largest number of panels in a row of a new figure; more would be too small on a page."""


def plane_axes(drawn: Sequence[Curve], axes: Any = None) -> tuple[Figure, Any]:
    """Return a figure with axes in the plane, one per plan; wide motions are stacked vertically."""
    extents = [
        body_points(c.plan.problem, c.plan.q(times(c.plan, 200))).reshape(-1, 2) for c in drawn
    ]
    low, top = (bound(np.concatenate(extents), axis=0) for bound in (np.min, np.max))
    wide, high = top - low
    count, columns, size = len(drawn), MOST_ABREAST, (3.8, 3.6)
    if wide >= 2 * high:
        columns, size = 1, (7.5, max(1.4, 7 * float(high / wide) + 0.8))
    shape = (1, count) if axes is not None else (-(-count // columns), min(count, columns))
    figure, axes, _ = grid(*shape, axes, size=size, share=("all", "all"))
    unit = length_unit(drawn[0].plan.problem.system)
    for ax in axes.flat[count:]:
        ax.remove()
    for k, (curve, ax) in enumerate(zip(drawn, axes.flat, strict=False)):
        ax.set_title(curve.title, fontsize=10)
        ax.set_aspect("equal", adjustable="box")
        if high >= 2 * wide:  # or the labels of x run together
            ax.set_xlim(*(float(low[0] + top[0]) / 2 + high * np.array([-0.3, 0.3])))
        if k + shape[1] >= count:
            ax.set_xlabel(f"x ({unit})")
            ax.tick_params(labelbottom=True)
        if k % shape[1] == 0:
            ax.set_ylabel(f"y ({unit})")
    return figure, axes.flat[:count].reshape(-1, 1) if columns == 1 else axes.flat[:count][None]


def _draw(ax: Any, curve: Curve, scale: Any, poses: int) -> None:
    plan = curve.plan
    draw_places(ax, plan.problem)
    path = body_points(plan.problem, plan.q(times(plan)))[:, -1]
    ax.plot(*path.T, color=curve.colour, linestyle=curve.dashes, linewidth=1.6, zorder=3)
    for t in np.linspace(0, plan.duration, poses):
        points = body_points(plan.problem, plan.q(t))
        style = {"linewidth": 1.8, "markersize": 2.5 if len(points) > 2 else 4, "alpha": 0.75}
        order = 2 if len(points) > 2 else 4
        ax.plot(*points.T, "-o", color=scale.to_rgba(t), zorder=order, **style)
    _draw_closest(ax, plan)
    for point, text in ((path[0], "start"), (path[-1], "end")):
        ax.plot(*point, "o", color="black", markersize=4, zorder=5)
        write_beside(ax, text, point, (6, -10), zorder=6)


def _draw_closest(ax: Any, plan: Plan) -> None:
    """Draw the arm's pose in which two links are closest to each other, and the links' distance."""
    requirement = plan.problem.self_collision
    if requirement is None:
        return
    poses = body_points(plan.problem, plan.q(times(plan)))
    points = poses[int(np.argmin(np.min(requirement.distances(poses), axis=0)))]
    one, other, away = requirement.nearest_pair(points)
    ax.plot(*points.T, "-", color="crimson", linewidth=1, zorder=4)
    ax.plot(*np.stack([one, other]).T, "-", color="crimson", linewidth=2.5, zorder=6)
    words = f"links {away:.2g} m apart" if away > 0 else "links cross"
    write_beside(ax, words, one, (6, 6), zorder=6)
