"""Build limits and requirements from the tables of a problem file, and find contradictions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, MethodError, expect
from planner.problem.requirements.ends import TipGoal
from planner.problem.requirements.places import Obstacle, Waypoint
from planner.problem.requirements.requirement import ROUNDING, Requirement
from planner.problem.tables.kinds import KIND_LIMITS
from planner.problem.tables.problem_file import ProblemFile
from planner.support.arrays import Array, Frozen
from planner.support.tables import error_words, line
from planner.systems.triangular_system import TriangularSystem


def with_changes(data: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Set dotted keys in a problem file's tables, in place; the value None removes a key.

    Returns:
        The tables.

    Raises:
        InputError: If a dotted key passes through a key whose value is not a table.
    """
    expect(
        Mapping, changes, 'changes must be dotted keys and values, for example {"goal.travel": 0.8}'
    )
    for dotted, value in changes.items():
        table = data
        *parents, key = dotted.split(".")
        for parent in parents:
            table = table.setdefault(parent, {})
            if not isinstance(table, dict):
                way = "; give the whole list" if isinstance(table, list) else ""
                raise InputError(f"cannot set '{dotted}': '{parent}' is not a table{way}")
        if value is None:
            table.pop(key, None)
        else:
            table[key] = value
    return data


@dataclass(frozen=True, eq=False)
class Limits(Frozen):
    """Limits that apply at all times; infinite (or None) where there is no limit.

    Attributes:
        input: Largest |u|, shape (2,), in the inputs' units (rad/s).
        input_rate: Largest |du/dt|, shape (2,) (rad/s²).
        joint: Largest |q|, shape (N,), in the coordinates' units (rad).
        user: Largest |user coordinate|, shape (N,), in their units; equal to `joint` if the user
            coordinates are the triangular ones.
        z2_margin: Least |z₂|; z₂ keeps the sign it has at the start. None: z₂ has no limit.
        input_keys, rate_keys, joint_keys, user_keys: Dotted keys of the problem file that set the
            entries of `input`, `input_rate`, `joint` and `user`; "" without a key.
    """

    input: Array
    input_rate: Array
    joint: Array
    user: Array
    z2_margin: float | None
    input_keys: tuple[str, ...]
    rate_keys: tuple[str, ...]
    joint_keys: tuple[str, ...]
    user_keys: tuple[str, ...]

    @property
    def input_scale(self) -> Array:
        """Scale of the inputs, shape (2,): their limits, or 1 without a limit."""
        return np.where(np.isfinite(self.input), self.input, 1.0)

    @property
    def input_words(self) -> str:
        """The keys that limit the inputs, as text."""
        return " and ".join(dict.fromkeys(self.input_keys))

    @property
    def unlimited(self) -> NDArray[np.bool_]:
        """Whether each input is without limits on its value and on its rate, shape (2,)."""
        return np.isinf(self.input) & np.isinf(self.input_rate)


def bare_limits(tables: ProblemFile, system: TriangularSystem) -> Limits:
    """Return the limits of a problem file as arrays."""
    limits, sides = tables.limits, (system.coordinates, system.user_coordinates)
    named = [[tables.limit_key(c.name) for c in side] for side in sides]
    every = limits.inputs, limits.rates, *named
    keys = (tuple(key and f"limits.{key}" for key in some) for some in every)
    sizes = limits.sizes(limits.inputs), limits.sizes(limits.rates)
    margin = getattr(limits, "z2_margin", None)  # not all kinds of systems have this key
    return Limits(*sizes, tables.joint_limits(), tables.user_limits(), margin, *keys)


def waypoints_of(tables: ProblemFile, system: TriangularSystem) -> list[Waypoint]:
    """Return the waypoints of a problem file."""
    out = []
    for k, (table, w) in enumerate(zip(tables.waypoints, tables.waypoint_states(), strict=True), 1):
        pairs = zip(system.user_coordinates, ~np.isnan(w), strict=True)
        units = {c.unit for c, known in pairs if known}
        unit = units.pop() if len(units) == 1 else ""
        out.append(Waypoint(k, w, table.time, unit, system))
    return out


def obstacles_of(tables: ProblemFile, system: TriangularSystem) -> list[Obstacle]:
    """Return the obstacles of a problem file: only arms have the key, for their links to clear."""
    lengths = getattr(system, "link_lengths", ())
    links, reach = len(lengths), float(np.sum(lengths))
    return [
        Obstacle(k, links, d.centre_m[0], d.centre_m[1], d.radius_m, d.clearance_m, reach)
        for k, d in enumerate(getattr(tables, "obstacles", ()), 1)
    ]


SMALL_UNITS = {100.0: "centimetres", 1000.0: "millimetres"}
"""Small units by number per metre: a goal farther than ten arm lengths may be in such a unit."""


def tip_of(
    tables: ProblemFile, system: TriangularSystem, discs: Sequence[Obstacle], source: str
) -> TipGoal | None:
    """Return the goal of an arm's tip; None if the file has none.

    Raises:
        InputError: If the goal is out of reach with joint angles within 90 degrees, or inside an
            obstacle.
    """
    table = tables.tip()
    if not table:
        return None
    lengths = system.link_lengths  # type: ignore[attr-defined]
    reach = float(np.sum(lengths))
    tip = TipGoal(tuple(table), tuple(table.values()), reach)
    turn = 90.0 * len(lengths)
    if tip.angle is not None and abs(np.rad2deg(tip.angle)) >= turn:
        raise InputError(
            f"goal.tip_angle_deg = {np.rad2deg(tip.angle):.6g} is the sum of"
            f" {len(lengths)} joints' angles, each within 90 degrees; it must lie between -{turn:g}"
            f" and {turn:g} degrees",
            source=source,
        )
    if tip.place is None:
        return tip
    away, least = float(np.hypot(*tip.place)), float(2 * np.max(lengths) - reach)
    where = f"goal.tip_m = [{tip.place[0]:g}, {tip.place[1]:g}]"
    if away > reach * (1 + ROUNDING):
        nearest = tip.place * (reach / away)
        small = SMALL_UNITS.items() if away > 10 * reach else ()
        unit = next((unit for factor, unit in small if away / factor <= reach), "")
        slip = f" (in {unit}? The key is in metres)" if unit else ""
        raise InputError(
            f"{where} is {away:.4g} m from the base{slip}, and the stretched arm is {reach:.4g} m"
            f" long; the nearest place that it could reach is [{nearest[0]:.4g}, {nearest[1]:.4g}]"
            " m",
            source,
        )
    if away < least:
        raise InputError(
            f"{where} is {away:.4g} m from the base, and the longest link keeps the tip at least"
            f" {least:.4g} m away; move goal.tip_m farther out",
            source,
        )
    for disc in discs:
        apart = disc.radius + disc.clearance
        if (inside := apart - float(np.hypot(*(tip.place - disc.centre)))) > ROUNDING * reach:
            extra = " and its clearance" if disc.clearance else ""
            raise InputError(
                f"{where} lies {inside:.3g} m inside obstacle {disc.number}{extra};"
                " move goal.tip_m or the obstacle",
                source,
            )
    return tip


def limits_by_class(
    kinds: Iterable[type[Requirement]], tables: ProblemFile, system: TriangularSystem, source: str
) -> tuple[Requirement, ...]:
    """Return the file's limits of some classes, such as those in `REQUIREMENTS`.

    Raises:
        InputError: If a limit does not fit this system, or its class is faulty.
    """
    out = []
    for kind in kinds:
        key, value = kind.key, getattr(tables.limits, kind.key, None)
        if value is None:
            continue
        try:
            requirement = kind.of(value, system)
        except ValueError as error:
            raise InputError(f"'limits.{key}': {error}", source=source) from None
        except Exception as error:
            why: str | None = f"failed: {line(error_words(error))}"
        else:
            why = None if kind in KIND_LIMITS else _fault(requirement, system)
        if why:
            raise InputError(f"'limits.{key}': its class {kind.__name__} {why}", source=source)
        out.append(requirement)
    return tuple(out)


def _fault(requirement: Requirement, system: TriangularSystem) -> str | None:
    """Describe why the class of a requirement is faulty or fails in a trial; None if sound."""
    try:
        return requirement.fault(system)
    except Exception as error:  # from foreign code; a registered class names itself as the cause
        return f"failed: {line(error_words(error.__cause__ or error))}"


def contradiction(
    states: Mapping[str, Array], requirements: Iterable[Requirement], system: TriangularSystem
) -> str:
    """Describe the first of the named `states` (N,) that violates a requirement; "" if none."""
    for name, q in states.items():
        for requirement in requirements:
            try:
                why = requirement.contradiction(name, q, system)
            except MethodError as error:
                return f"the {name} cannot be checked: {error}"
            if why:
                return f"contradiction: {why}"
    return ""


LEAST_WAYPOINT_GAP = 1e-6
"""Least time between two waypoints, relative to the duration."""


def clash_of_times(waypoints: Sequence[Waypoint], duration: float | None) -> str:
    """Describe why no plan can pass the waypoints at their times; empty if one can."""
    timed = sorted((p.time_s, p.number) for p in waypoints if p.time_s is not None)
    if not timed:
        return ""
    if duration is None:
        return (
            f"waypoints[{timed[0][1] - 1}].time needs a fixed goal.duration;"
            " set one or leave out the time"
        )
    before, after = [(0.0, 0), *timed], [*timed, (duration, 0)]
    for (earlier, first), (later, second) in zip(before, after, strict=True):
        if later - earlier > LEAST_WAYPOINT_GAP * duration:
            continue
        if first and second:
            return (
                f"waypoints {first} and {second} have the same time {later:g} s;"
                " merge them or change a time"
            )
        number, time = (second, later) if second else (first, earlier)
        return (
            f"waypoints[{number - 1}].time = {time:g} s must lie inside the motion, between 0 and"
            f" goal.duration = {duration:g} s"
        )
    return ""


LOOKS_LIKE_RADIANS_DEG = 1.6
"""Number below which angles that should be in degrees are probably in radians: joints stay below 90
degrees, 1.57 rad, and motions within 1.6 degrees are rare."""

LOOKS_LIKE_MILLIMETRES = 10.0
"""Distance of an obstacle, in lengths of the arm, from which on a wrong unit is suspected."""


def likely_slip(
    system: TriangularSystem, start: Array, goal: Array, obstacles: Sequence[Obstacle]
) -> str:
    """Describe valid values that are probably a mistake; empty if none are."""
    angular = [i for i in system.limited if system.coordinates[i].unit == "rad"]
    angles = np.abs([start[angular], goal[angular]])
    if 0 < np.rad2deg(np.max(angles, initial=0)) < LOOKS_LIKE_RADIANS_DEG:  # false if NaN (free)
        return (
            f"all angles of start and goal are below {LOOKS_LIKE_RADIANS_DEG} degrees; if they are"
            " meant in radians, write them in degrees"
        )
    for disc in obstacles:
        if math.hypot(disc.x, disc.y) > LOOKS_LIKE_MILLIMETRES * disc.reach + disc.thickness:
            return (
                f"obstacle {disc.number} at ({disc.x:g}, {disc.y:g}) m has no effect: the arm"
                f" reaches {disc.reach:g} m; if it is meant in millimetres, write it in metres"
            )
    return ""
