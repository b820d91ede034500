"""Write the texts of a comparison's page: question, answer, and facts of the task."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence

import numpy as np

from planner.comparison.comparison import Comparison
from planner.problem.problem import Problem
from planner.report.figures.style import colour_numbers, readable_name, to_display
from planner.support.tables import constant_text
from planner.systems.triangular_system import TriangularSystem


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
        " does the emulated machine deviate from its path (E: the largest error of any joint, after"
        " any preparation)?"
    )


def verdict_html(comparison: Comparison) -> str:
    """Return the overall answer of a comparison, as a few sentences of HTML."""
    rows = [row for row in comparison.rows if not row.feedback]
    solved = sum(row.solved for row in rows)
    start, name, lines = comparison.headline_parts
    text = html.escape(start) + f"<b>{html.escape(name)}</b>" * bool(name)
    text += "<br>".join(html.escape(line) for line in lines).replace(" deg", "°")
    if comparison.recommended and len(rows) > 1:
        text += f" {solved} of {len(rows)} plans reach the goal and keep every limit."
    return text


def task_facts(comparison: Comparison) -> list[tuple[str, str]]:
    """Return pairs of name and value, in plain text, that describe the task."""
    problem = comparison.problem
    system = problem.system
    first = system.coordinates[0]
    travel = "free" if problem.travel is None else f"{problem.travel:g} {first.unit}"
    out = [
        ("System", constants(system)),
        ("Travel", f"{readable_name(first.name)}: {travel}"),
        ("Duration", "free" if problem.duration is None else f"{problem.duration:g} s"),
    ]
    out += _limits(problem)
    name = comparison.machine.source or comparison.machine.preset
    machines = f"{comparison.samples} drawn from “{name}”"
    return [*out, ("Machines", machines), ("Seed", str(comparison.seed))]


def _limits(problem: Problem) -> Iterator[tuple[str, str]]:
    """Yield the key of each limit, and in words its value and what it limits."""
    groups: dict[tuple[str, str], list[str]] = {}
    for demand, part in ((d, part) for d in problem.demands for part in d.parts):
        key = part.key or f"limits.{demand.key}" * bool(demand.key)
        low, high = to_display(np.array([part.low, part.high]), part.unit).tolist()
        sides = [("at most", high)] if low == -high else [("at least", low), ("at most", high)]
        ends = [f"{word} {side:g}" for word, side in sides if np.isfinite(side)]
        unit = "°" if part.unit == "rad" else f" {part.unit}".rstrip()
        if key:
            groups.setdefault((key, f"{', '.join(ends)}{unit}"), []).append(part.label)
    for (key, words), labels in groups.items():
        more = f" and {len(labels) - 4} more" * (len(labels) > 4)  # of pairs of links
        yield key, f"{words} ({', '.join(labels[:4])}{more})"


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
    """Return user coordinates w in words; angles are in degrees. Free coordinates, which are NaN,
    are left out."""
    parts = []
    for c, value in zip(problem.system.user_coordinates, w, strict=True):
        if np.isfinite(value):
            unit = "°" if c.unit == "rad" else f" {c.unit}"
            amount = f"{to_display(np.array([value]), c.unit)[0]:.4g}{unit}"
            parts.append(f"{html.escape(readable_name(c.name))} = {html.escape(amount)}")
    return ", ".join(parts)
