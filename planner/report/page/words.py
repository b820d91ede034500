"""Write the texts of a comparison's page: question, answer, and facts of the task."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from planner.comparison.comparison import Comparison
from planner.problem.problem import Problem
from planner.problem.requirements.requirement import Part
from planner.report.figures.style import colour_numbers, readable_name, to_display
from planner.support.tables import constant_text
from planner.systems.triangular_system import Coordinate, TriangularSystem


def colour_places(comparison: Comparison) -> dict[str, int]:
    """Return the index of each row's colour, which is the same with and without feedback."""
    return colour_numbers([row.label for row in comparison.rows])


def question(problem: Problem) -> str:
    """Return the question that the comparison answers, as one sentence of HTML."""
    duration = "a free duration" if problem.duration is None else f"{problem.duration:g} s"
    if hasattr(problem.system, "arm_points"):
        what = f"the arm from θ = {_angles(problem.start[1:])} to {_arm_goal(problem)}"
    else:
        start = _places(problem, problem.system.user(problem.start))
        what = f"the {html.escape(problem.system.kind)} from {start}"
        what += f" to {_places(problem, problem.user_goal)}"
    return (
        f"Which plan moves {what} in {duration} within the limits, with what effort, and how far"
        " does the emulated machine deviate from its path?"
    )


def verdict_html(comparison: Comparison) -> str:
    """Return the overall answer of a comparison, as a few sentences of HTML."""
    rows = [row for row in comparison.rows if not row.feedback]
    solved = sum(row.solved for row in rows)
    start, name, rest = map(html.escape, comparison.headline_parts)
    text = start + f"<b>{name}</b>" * bool(name) + rest.replace(" deg", "°")
    if (take := comparison.recommended) and len(rows) > 1:
        text += f" {solved} of {len(rows)} plans reach the goal and keep every limit."
        if np.isfinite(take.E_median_deg):
            text += " E is the largest error of any joint on the machine at any time."
    return text


def task_facts(comparison: Comparison) -> list[tuple[str, str]]:
    """Return pairs of name and value, in plain text, that describe the task."""
    problem = comparison.problem
    system, limits = problem.system, problem.limits
    first = system.coordinates[0]
    travel = "free" if problem.travel is None else f"{problem.travel:g} {first.unit}"
    out = [
        ("System", constants(system)),
        ("Travel", f"{readable_name(first.name)}: {travel}"),
        ("Duration", "free" if problem.duration is None else f"{problem.duration:g} s"),
    ]
    for c, most, rate in zip(system.inputs, limits.input, limits.input_rate, strict=True):
        name = readable_name(c.name)
        if np.isfinite(most):
            out.append((f"Limit of {name}", f"|{name}| ≤ {most:g} {c.unit}"))
        if np.isfinite(rate):
            out.append((f"Limit of its rate, {name}", f"{rate:g} {c.unit}/s"))
    out += _joint_limits(problem)
    if limits.z2_margin is not None:
        out.append(("Distance from z₂ = 0", f"at least {limits.z2_margin:g}"))
    apart = problem.self_collision
    if apart is not None:
        out.append(("Distance of links from each other", f"at least {apart.clearance:g} m"))
    others = (*problem.kind_limits, *problem.registered_limits)
    out += [_limit_fact(part) for each in others if each is not apart for part in each.parts]
    name = comparison.machine.source or comparison.machine.preset
    machines = f"{comparison.samples} drawn from “{name}”"
    return [*out, ("Machines", machines), ("Seed", str(comparison.seed))]


def _limit_fact(part: Part) -> tuple[str, str]:
    sides = ("at least", part.low), ("at most", part.high)
    ends = [f"{word} {side:g} {part.unit}".rstrip() for word, side in sides if np.isfinite(side)]
    return f"Limit: {part.label}", ", ".join(ends)


def _joint_limits(problem: Problem) -> list[tuple[str, str]]:
    by_value: dict[str, list[str]] = {}
    system = problem.system
    limited = range(system.size) if system.has_user_coordinates else system.limited
    for i in limited:
        most, c = float(problem.limits.user[i]), system.user_coordinates[i]
        if np.isfinite(most):
            by_value.setdefault(_amount(c, most, "g"), []).append(f"|{readable_name(c.name)}|")
    what = "coordinates" if system.has_user_coordinates else "angles"
    return [(f"Limits of {what}", f"{', '.join(who)} ≤ {most}") for most, who in by_value.items()]


def constants(system: TriangularSystem) -> str:
    """Return the kind and the constants of a system, without its lengths, in one line."""
    data = {k: v for k, v in system.to_dict().items() if k not in ("kind", "link_lengths")}
    return ", ".join([system.kind, *(f"{k} = {constant_text(v)}" for k, v in data.items())])


def _arm_goal(problem: Problem) -> str:
    """Return the goal of an arm in words: joint angles, or the tip's goal with any given angles."""
    goal, tip = problem.goal[1:], "" if problem.tip is None else str(problem.tip)
    if np.all(np.isnan(goal)):
        return tip
    return _angles(goal) + f" with {tip}" * bool(tip)


def _angles(radians: Sequence[float] | np.ndarray) -> str:
    words = ("free" if np.isnan(x) else f"{x:.4g}" for x in np.rad2deg(radians))
    return "(" + ", ".join(words) + ")°"


def _places(problem: Problem, w: np.ndarray) -> str:
    """Return user coordinates w in words; free coordinates, which are NaN, are left out."""
    parts = []
    for c, value in zip(problem.system.user_coordinates, w, strict=True):
        if not np.isfinite(value):
            continue
        amount = _amount(c, float(value), ".4g")
        parts.append(f"{html.escape(readable_name(c.name))} = {html.escape(amount)}")
    return ", ".join(parts)


def _amount(coordinate: Coordinate, value: float, style: str) -> str:
    """Return a coordinate's value as text with its unit; angles are in degrees."""
    unit = "°" if coordinate.unit == "rad" else f" {coordinate.unit}"
    return f"{float(to_display(np.array([value]), coordinate.unit)[0]):{style}}{unit}"
