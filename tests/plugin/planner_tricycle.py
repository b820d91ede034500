"""A package from outside: the system `tricycle`, method `two_speeds`, limit `input_product`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

import planner
from planner.methods.laws.free_numbers import travel_of
from planner.methods.laws.law import Ends, Motion, finish
from planner.methods.laws.legs import Leg, steer
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.problem.tables.method_options import TravelOptions
from planner.problem.tables.vehicles import CarGoal, CarLimits, CarStart, VehicleFile
from planner.support.arrays import Array
from planner.support.user_tables import Positive, Table
from planner.systems.triangular_system import Coordinate, TangentSystem

# -- the system --------------------------------------------------------------------------------


class Tricycle(TangentSystem):
    """Driven and steered at its front wheel, with state q = (x, steering, heading, y) of the rear.

    ẋ = cosφ cosθ u₁,  φ̇ = u₂,  θ̇ = sinφ/L u₁,  ẏ = cosφ sinθ u₁  with u₁ the speed of the front
    wheel in m/s and u₂ the steering rate in rad/s. Along x: θ' = tanφ/(L cosθ), y' = tanθ.
    """

    kind: ClassVar[str] = "tricycle"

    def __init__(self, wheelbase_m: float) -> None:
        self.wheelbase_m = wheelbase_m

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        angles = Coordinate("steering", "rad"), Coordinate("heading", "rad")
        return Coordinate("x", "m"), *angles, Coordinate("y", "m")

    @property
    def inputs(self) -> tuple[Coordinate, Coordinate]:
        return Coordinate("speed", "m/s"), Coordinate("steering_rate", "rad/s")

    @property
    def limited(self) -> tuple[int, ...]:
        return 1, 2

    def slopes_expr(self, q: Any) -> list[Any]:
        return [ca.tan(q[1]) / (self.wheelbase_m * ca.cos(q[2])), ca.tan(q[2])]

    def drive_expr(self, q: Any) -> Any:
        return ca.cos(q[1]) * ca.cos(q[2])

    def slopes(self, q: Array) -> Array:
        turn = np.tan(q[..., 1]) / (self.wheelbase_m * np.cos(q[..., 2]))
        return np.stack([turn, np.tan(q[..., 2])], axis=-1)

    def drive(self, q: Array) -> Array:
        return np.asarray(np.cos(q[..., 1]) * np.cos(q[..., 2]))

    def _link(self, i: int, q: Array) -> tuple[Array, Array]:
        ones = np.ones_like(q[..., -1])
        return 0 * ones, ones if i == 2 else 1 / (self.wheelbase_m * np.cos(q[..., 2]))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "wheelbase_m": self.wheelbase_m}


class TricycleTable(Table):
    """The tricycle."""

    kind: Literal["tricycle"]
    wheelbase_m: Positive = Field(description="From the front wheel to the rear axle in m.")


class TricycleFile(VehicleFile):
    """A problem file for the tricycle."""

    summary = "tricycle, driven and steered at its front wheel"
    example = """
# The tricycle: a forklift's kinematics.
title = "my tricycle"

[system]
kind = "tricycle"
wheelbase_m = 1.2

[goal]
x_m = 4.0                    # or "free"
y_m = 1.0
duration = 8.0               # seconds, or "free"

[limits]                     # each may be left out
speed_m_s = 1.5
steering_rate_rad_s = 1.0
steering_deg = 60
"""

    system: TricycleTable
    start: CarStart = Field(default_factory=CarStart)
    goal: CarGoal
    limits: CarLimits = Field(default_factory=CarLimits)

    def build_system(self) -> Tricycle:
        return Tricycle(self.system.wheelbase_m)


# -- the method --------------------------------------------------------------------------------


class TwoSpeedsOptions(TravelOptions):
    """Options of `two_speeds`."""

    first: Annotated[float, Field(gt=0, lt=1)] = Field(
        0.5, description="Part of the duration that the first half of the travel takes."
    )


def plan_two_speeds(problem: planner.Problem, options: TwoSpeedsOptions) -> planner.Plan:
    """v₁ constant on each half of the travel, v₂ polynomial on both, of least ∫v₂².

    Raises:
        NoPlanError: If start or goal are not in the chart, or the path leaves its domain.
    """
    began = time.perf_counter()
    ends, terms = Ends.of(problem), problem.system.size - 1

    def motion(travel: float | Array) -> Motion:
        parts = options.first, 1 - options.first
        legs = [Leg(part * ends.duration, travel / 2, terms) for part in parts]
        return steer(ends.start, ends.goal(travel), legs)

    best = motion(travel_of(problem, motion, options)[0])
    return finish(problem, "two_speeds", options, ends.trajectory(best), best.summary, began)


# -- the limit ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class InputProduct(Requirement):
    """|u₁ u₂| ≤ most: who steers fast goes slowly."""

    most: float

    key, reads, speed_power = "input_product", frozenset({"u"}), 2
    table = Positive, "Largest |u1 u2|, in the product of the inputs' units.", 0.2

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("product of the inputs", "", -self.most, self.most, self.most),)

    def rows(self, point: MotionPoint) -> Sequence[Any]:
        return [point.u[0] * point.u[1]]


# -- the entry point ---------------------------------------------------------------------------


def register() -> None:
    """What the entry point `planner.plugins` names."""
    planner.register_requirement(InputProduct)
    planner.register_system("tricycle", TricycleFile)
    planner.register_method(
        "two_speeds",
        plan_two_speeds,
        options=TwoSpeedsOptions,
        summary="v1 constant on each half of the travel, slower or faster on the first",
    )
