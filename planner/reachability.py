"""What one-way motion of the disk can reach: signs, and the window of travels (theory of eq. 7).

While φ moves one way every passive joint θ₂ … θₙ moves the same way, because each θᵢ' is positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.problem import Problem
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator


@dataclass(frozen=True)
class TravelWindow:
    """Travels Δφ for which a one-way motion can exist, in radians.

    Attributes:
        low: Least travel; the ends themselves are limits that no motion attains.
        high: Greatest travel; infinite when there is none.
        exact: Whether every travel strictly inside is attained by some one-way motion when joints
            and inputs have no limits (n = 2 and 3); otherwise travels outside are impossible and
            those inside are open.
        reason: Why the window is empty, in words; empty when it is not.
    """

    low: float
    high: float
    exact: bool
    reason: str = ""

    @property
    def empty(self) -> bool:
        """Whether no one-way motion exists at all."""
        return bool(self.reason)

    def __contains__(self, travel: float) -> bool:
        return not self.empty and self.low < travel < self.high


def travel_window(problem: Problem) -> TravelWindow | None:
    """The window of one-way travels between the problem's start and goal.

    Returns:
        The window, or None for systems other than the manipulator.
    """
    if not isinstance(problem.system, Manipulator):
        return None
    start, goal = problem.start[1:], problem.goal[1:]
    moved = goal[1:] - start[1:]
    if np.any(moved > 0) and np.any(moved < 0):
        return _none("the passive joints must move in opposite directions")
    if np.all(moved == 0):
        return _none("the passive joints must end where they started")
    if np.any(moved == 0):
        return _none("one passive joint must stay while another moves")
    if np.all(moved < 0):  # the same motion run backwards
        ahead = _forward(problem.system, goal, start)
        return TravelWindow(-ahead.high, -ahead.low, ahead.exact, ahead.reason)
    return _forward(problem.system, start, goal)


def _none(reason: str) -> TravelWindow:
    return TravelWindow(np.nan, np.nan, True, f"{reason}, so the disk must reverse")


def _forward(system: Manipulator, start: Array, goal: Array) -> TravelWindow:
    K, n = system.K, system.n
    if n == 2:
        return TravelWindow(float((goal[1] - start[1]) / K[0]), np.inf, True)
    a, b = float(start[n - 2]), float(goal[n - 2])
    fast, slow = _cos3_range(a, b)
    last = float(goal[-1] - start[-1])
    if n > 3:
        return TravelWindow(last / (K[-1] * fast), last / (K[-1] * slow), False)
    # θ₂ runs at its top rate K₂ (θ₁ = 0) and the rest of θ₃ is made up by dwelling at one θ₂.
    swept = K[1] / K[0] * (_sine_integral(b) - _sine_integral(a))
    spare = last - swept
    if spare <= 0:
        return _none(
            f"theta2 cannot move {np.rad2deg(b - a):.4g} deg while theta3 moves only"
            f" {np.rad2deg(last):.4g} deg (at least {np.rad2deg(swept):.4g} deg)"
        )
    base = (b - a) / K[0]
    return TravelWindow(base + spare / (K[1] * fast), base + spare / (K[1] * slow), True)


def _cos3_range(a: float, b: float) -> tuple[float, float]:
    ends = np.cos([a, b]) ** 3
    fast = 1.0 if a <= 0 <= b else float(ends.max())
    return fast, float(ends.min())


def _sine_integral(angle: float) -> float:
    """∫ cos³ = sin − sin³/3."""
    return float(np.sin(angle) - np.sin(angle) ** 3 / 3)
