"""Bounds that hold for every plan: the least duration, and the travels possible without reversal.

`chart_ends_report` tells whether start and goal lie inside the chart.

The least duration follows from the input limits: every joint's rate is its gear constant times
cosines times an input, so |θ̇₁| ≤ max|u₂|, |θ̇ᵢ| ≤ k_g Kᵢ max|u₁| and |φ̇| ≤ k_g max|u₁| (eq. 6).

The travel is the change of the disk angle φ. Its window is the range of travels that are possible
while φ moves one way. Then each passive joint θ₂ … θₙ moves one way too, because each θᵢ' = dθᵢ/dφ
is positive (eq. 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.errors import InfeasibleError
from planner.problem.problem import AnyProblem, Problem, problem_of
from planner.support.arrays import Array, Frozen, plain
from planner.systems.chained_form import chained_form
from planner.systems.manipulator import Manipulator

SHORTEST_S = 1e-3
"""Duration, s, of a plan that stays at the start if the duration is free. Collocation uses the same
number, in its natural unit of time, as the least duration."""


@dataclass(frozen=True)
class End(Frozen):
    """One end of the motion and where this end lies relative to the chart.

    Attributes:
        name: "start" or "goal".
        q: Coordinates, shape (N,); NaN if free.
        z: Chained coordinates, shape (N,); z₁ is NaN if q₁ is free; all are NaN if a joint is free.
        branch: The chart's branch on which the end lies, shape (N,); NaN if a joint is free.
        margins: Distance from each edge of the chart, on the start's branch: maps label to value,
            negative beyond the edge.
        singular: Names of the coordinates that lie on a singularity of the chart.
        crossed: Names of the coordinates whose branch differs from the start's.
    """

    name: str
    q: Array
    z: Array
    branch: Array
    margins: dict[str, float]
    singular: tuple[str, ...]
    crossed: tuple[str, ...]

    @property
    def in_chart(self) -> bool:
        """Whether a motion in chained coordinates can have this end; false with free joints."""
        return not (self.singular or self.crossed or np.any(np.isnan(self.z[1:])))

    def to_dict(self) -> dict[str, Any]:
        """Return the end as JSON-ready data, NaN where undefined."""
        data = {key: plain(value) for key, value in vars(self).items() if key != "name"}
        return {**data, "in_chart": self.in_chart}


def chart_ends_report(problem: Problem) -> tuple[End, End]:
    """Return where start and goal lie relative to the chart."""
    return _end("start", problem, problem.start), _end("goal", problem, problem.goal)


def _end(name: str, problem: Problem, q: Array) -> End:
    system, home = problem.system, problem.branch
    if np.any(np.isnan(q[1:])):
        nowhere = np.full(system.size, np.nan)
        unknown = {label: np.nan for _, label in system.margin_labels}
        return End(name, q, nowhere, nowhere, unknown, (), ())
    q_known = np.where(np.isnan(q), 0.0, q)
    z = chained_form(system).z(q_known)
    z[0] = q[0]
    branch = system.branch(q_known)
    names = [c.name for c in system.coordinates]
    labels = [label for _, label in system.margin_labels]
    margins = system.chart_margins(q_known, home)
    crosses = (branch != home) & (branch != 0) & (home != 0)
    return End(
        name=name,
        q=q,
        z=z,
        branch=branch,
        margins=dict(zip(labels, (float(m) for m in margins), strict=True)),
        singular=tuple(n for n, b in zip(names, branch, strict=True) if b == 0),
        crossed=tuple(n for n, m in zip(names, crosses, strict=True) if m),
    )


@dataclass(frozen=True)
class DurationBound:
    """Duration below which no plan exists.

    Attributes:
        seconds: The duration; zero if there is no bound.
        reason: The reason, in words.
        judged: Duration below which no plan passes verification, which tolerates small errors at
            the goal and at limits, seconds.
    """

    seconds: float
    reason: str
    judged: float = 0.0


GOAL_MISS, LIMIT_MISS = 2e-5, 1e-6
"""Tolerances of `verify` at the goal (rad or m) and at a limit (relative)."""


def least_duration(problem: Problem) -> DurationBound:
    """Return a lower bound of the duration: the longest time of a coordinate at its largest rate.

    A plan may need longer.
    """
    distance = np.nan_to_num(np.abs(problem.goal - problem.start))  # free ones may stay in place
    rates, (u1, u2) = np.full(problem.system.size, np.inf), problem.limits.input
    rates[1] = u2
    if isinstance(problem.system, Manipulator):
        rates[0] = problem.system.k_g * u1
        rates[2:] = problem.system.k_g * problem.system.K * u1
    needed = distance / rates
    i = int(np.argmax(needed))
    coordinate, unit = problem.system.coordinates[i], problem.system.coordinates[i].unit
    reason = (
        f"{coordinate.name} must move {format_value(distance[i], unit)} and moves at most"
        f" {format_value(rates[i], unit)}/s within the input limits"
    )
    judged = float(np.max((distance - GOAL_MISS) / rates)) / (1 + LIMIT_MISS)
    return DurationBound(float(needed[i]), reason if needed[i] > 0 else "", max(judged, 0.0))


def why_too_short(problem: Problem) -> str | None:
    """Describe why no plan can be as short as `goal.duration`; None if that is not proven."""
    bound = least_duration(problem)
    if problem.duration is None or problem.duration >= bound.judged:
        return None
    return (
        f"no plan of any kind exists: {bound.reason}, which takes {bound.seconds:.4g} s;"
        f" goal.duration is {problem.duration:.4g} s"
    )


def refuse_too_short(problem: Problem) -> None:
    """Raise an error, before any method tries, if no plan can be as short as `goal.duration`.

    Raises:
        InfeasibleError: Names the coordinate that needs more time.
    """
    if why := why_too_short(problem):
        error = InfeasibleError(
            why,
            source=problem.source,
            advice=[
                'goal.duration = "free", which finds the time needed',
                f"larger {problem.limits.input_words}",
            ],
        )
        error.finding = ""
        raise error


def format_value(value: float, unit: str) -> str:
    """Return a value as text with its unit; angles are in degrees."""
    return f"{np.rad2deg(value):.4g} deg" if unit == "rad" else f"{value:.4g} {unit}"


@dataclass(frozen=True, repr=False)
class TravelWindow:
    """Travels Δφ (radians) for which a motion without reversal of the disk can exist.

    Attributes:
        low: Lower bound of the travel, excluded.
        high: Upper bound of the travel, excluded; infinite if there is none.
        exact: Whether every travel between the bounds is possible if joints and inputs have no
            limits (true for n = 2 and 3). If false, a travel between them may be impossible too.
        reason: Why the window is empty, in words; "" if it is not empty.
    """

    low: float
    high: float
    exact: bool
    reason: str = ""

    def __repr__(self) -> str:
        if self.empty:
            return f"TravelWindow(empty: {self.reason})"
        sure = "each of these" if self.exact else "no other"
        return (
            f"TravelWindow({self.low:.4g} to {self.high:.4g} rad: {sure} is possible while the disk"
            " turns one way)"
        )

    @property
    def empty(self) -> bool:
        """Whether no motion without reversal exists."""
        return bool(self.reason)

    def __contains__(self, travel: float) -> bool:
        return not self.empty and self.low < travel < self.high


def travel_window(problem: AnyProblem) -> TravelWindow | None:
    """Return the travels that are possible without reversing the disk between start and goal.

    Returns:
        The window; None for systems other than the manipulator, or if the goal leaves joints free.
    """
    problem = problem_of(problem)
    if not isinstance(problem.system, Manipulator) or problem.free:
        return None
    start, goal = problem.start[1:], problem.goal[1:]
    change = goal[1:] - start[1:]
    if np.any(change > 0) and np.any(change < 0):
        return _empty_window("the passive joints must move in opposite directions")
    if np.all(change == 0):
        return _empty_window("the passive joints must end where they started")
    if np.any(change == 0):
        return _empty_window("one passive joint must stay while another moves")
    if np.all(change < 0):  # the reverse of a motion from goal to start
        ahead = _forward_window(problem.system, goal, start)
        return TravelWindow(-ahead.high, -ahead.low, ahead.exact, ahead.reason)
    return _forward_window(problem.system, start, goal)


def _empty_window(reason: str) -> TravelWindow:
    return TravelWindow(np.nan, np.nan, True, f"{reason}, so the disk must reverse")


def _forward_window(system: Manipulator, start: Array, goal: Array) -> TravelWindow:
    K, n = system.K, system.n
    if n == 2:
        return TravelWindow(float((goal[1] - start[1]) / K[0]), np.inf, True)
    a, b = float(start[n - 2]), float(goal[n - 2])
    ends = np.cos([a, b]) ** 3  # rates of the last joint over Kₙ at both ends
    fast, slow = 1.0 if a <= 0 <= b else float(ends.max()), float(ends.min())
    last = float(goal[-1] - start[-1])
    if n > 3:
        return TravelWindow(last / (K[-1] * fast), last / (K[-1] * slow), False)
    # θ₂ moves at its largest rate K₂ (θ₁ = 0); meanwhile θ₃ moves by `swept`. It moves by the
    # remaining angle `spare` while θ₂ rests at one angle.
    swept = K[1] / K[0] * (_sine_integral(b) - _sine_integral(a))
    spare = last - swept
    if spare <= 0:
        return _empty_window(
            f"while theta2 moves {np.rad2deg(b - a):.4g} deg, theta3 moves at least"
            f" {np.rad2deg(swept):.4g} deg, but the goal asks for {np.rad2deg(last):.4g} deg"
        )
    base = (b - a) / K[0]
    return TravelWindow(base + spare / (K[1] * fast), base + spare / (K[1] * slow), True)


def _sine_integral(angle: float) -> float:
    """Return the integral of cos³ from 0 to `angle`, which is sin − sin³/3."""
    return float(np.sin(angle) - np.sin(angle) ** 3 / 3)
