"""Figures by which a companion paper judges plans, in our reading of its abstract.

L. Li, Y. Tan, Z. Li, "Nonholonomic Motion Planning Strategy for Underactuated Manipulator", Journal
of Robotics 2014, 743857, says: "two evaluation indicators are defined and used to estimate control
precision and linear approximation capability. In the end, the initial error sensitivity matrix is
introduced to describe the interference sensitivity, which is called robustness." We had the
abstract alone; the definitions below are **our reading of these words**, not the paper's formulas.

- Control precision: the error at the goal when the plan's input is sampled and held, as a real
  controller plays it, over an ideal machine. Nothing but the plan and the period decides it.
- Linear approximation capability: how far the joints' path leaves the straight line between start
  and goal in joint space, over the line's length; 0 for a path that is that line.
- Initial error sensitivity matrix: ∂q(T)/∂q(0) under the plan's open-loop input.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from planner.errors import InputError
from planner.extrema import maximum, sample_times
from planner.plan import Plan
from planner.sensitivity import sensitivity
from planner.systems.base import Array


@dataclass(frozen=True)
class Indicators:
    """Our reading of the companion paper's indicators, for one plan.

    Attributes:
        joints: Names of the n angles they speak of: every angle after the path coordinate.
        control_precision_deg: Largest terminal error of a joint, in degrees, with the input held
            over `period_s`; smaller is better.
        period_s: The controller's period, in seconds.
        linear_deviation_deg: Greatest distance of the joints' path from the straight line between
            its ends, in degrees.
        linear_approximation: That over the line's length (dimensionless); smaller is better, NaN
            where the ends coincide.
        initial_error_matrix: ∂q(T)/∂q(0), shape (N, N), in the coordinates' units.
        initial_error_gain: Largest singular value of its block of joints (dimensionless): how much
            the worst initial error of the joints grows; smaller is better, 1 at least.
    """

    joints: tuple[str, ...]
    control_precision_deg: float
    period_s: float
    linear_deviation_deg: float
    linear_approximation: float
    initial_error_matrix: Array
    initial_error_gain: float


def indicators(plan: Plan, period_s: float = 0.01) -> Indicators:
    """The indicators of an executable plan.

    Args:
        plan: Any executable plan.
        period_s: Seconds between two samples of the input, which is held between them.

    Raises:
        InputError: If the plan cannot be executed, the period is not positive, or the system has
            no angles after its path coordinate.
    """
    if not plan.executable:
        raise InputError(f"the {plan.method} plan leaves the chart's domain and has no inputs")
    if not period_s > 0:
        raise InputError(f"period_s = {period_s!r} must be a positive number of seconds")
    coordinates = plan.problem.system.coordinates
    joints = [i for i, c in enumerate(coordinates) if i > 0 and c.unit == "rad"]
    if not joints:
        raise InputError(f"a {plan.problem.system.kind} has no angles after its path coordinate")
    error = held_end(plan, period_s) - plan.q(plan.duration)
    deviation, length = _from_straight(plan, joints)
    matrix = _initial_errors(plan)
    return Indicators(
        joints=tuple(coordinates[i].name for i in joints),
        control_precision_deg=float(np.rad2deg(np.max(np.abs(error[joints])))),
        period_s=period_s,
        linear_deviation_deg=float(np.rad2deg(deviation)),
        linear_approximation=deviation / length if length > 0 else np.nan,
        initial_error_matrix=matrix,
        initial_error_gain=float(np.linalg.norm(matrix[np.ix_(joints, joints)], 2)),
    )


def held_end(plan: Plan, period_s: float) -> Array:
    """q(T), shape (N,), of the ideal machine under the input sampled and held every period."""
    system, q = plan.problem.system, plan.problem.start
    count = int(np.ceil(plan.duration / period_s * (1 - 1e-12)))
    edges = np.append(period_s * np.arange(count), plan.duration)
    for u, span in zip(plan.u(edges[:-1]), np.diff(edges), strict=True):
        moved = solve_ivp(
            lambda _, q, u=u: system.rates(q, u), (0, span), q, "DOP853", rtol=1e-9, atol=1e-11
        )
        q = moved.y[:, -1]
    return np.asarray(q)


def _from_straight(plan: Plan, joints: list[int]) -> tuple[float, float]:
    """Greatest distance from the chord of the joints' path, and the chord's length, in radians."""
    ends = plan.q(np.array([0.0, plan.duration]))[:, joints]
    chord = ends[1] - ends[0]
    length = float(np.linalg.norm(chord))
    along = chord / length if length > 0 else chord

    def distance(t: Array) -> Array:
        offset = plan.q(t)[..., joints] - ends[0]
        foot = np.clip(offset @ along, 0.0, length)[..., None] * along
        return np.asarray(np.linalg.norm(offset - foot, axis=-1))

    return maximum(distance, sample_times(plan.t))[0], length


def _initial_errors(plan: Plan) -> Array:
    response = sensitivity(plan)
    columns = [
        response.parameters.index(f"start {c.name}") for c in plan.problem.system.coordinates
    ]
    return np.asarray(response.terminal[:, columns])
