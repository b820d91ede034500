"""The tables of a problem file for unicycle, car and trailers.

They share positions in m, headings in degrees, and x as the path coordinate. Headings are periodic:
350 degrees equals -10 degrees, and a vehicle turns the nearest way unless `goal.turns` says
otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from planner.problem.tables.problem_file import BaseLimits, Free, GoalTable, NamedFile, ProblemFile
from planner.support.arrays import Array
from planner.support.user_tables import Positive, Table
from planner.systems.vehicles import Car, Trailers, Unicycle

Degrees = Annotated[float, Field(ge=-36000, le=36000)]
"""Heading in degrees with at most a hundred whole turns; more turns are probably a mistake."""

SteeringDeg = Annotated[float, Field(gt=-90, lt=90)]
HitchDeg = Annotated[float, Field(gt=-180, lt=180)]

FULL_TURN = 2 * np.pi
TURN_ROUNDING = 1e-9
"""Tolerance for half a turn, in turns, because angles in degrees are rounded."""


class PoseStart(Table):
    """Where the vehicle starts."""

    x_m: float = 0.0
    """Position along the x axis in m."""
    y_m: float = 0.0
    """Position across it in m."""
    heading_deg: Degrees = 0.0
    """Heading from the x axis in degrees."""


class PoseGoal(GoalTable):
    """Where the vehicle ends."""

    x_m: Free | float
    """Position along the x axis in m, or 'free'."""
    y_m: float
    """Position across it in m."""
    heading_deg: Degrees = 0.0
    """Heading from the x axis in degrees; 370 is 10, see turns."""
    turns: Annotated[int, Field(ge=-100, le=100)] | None = Field(None, examples=[1])
    """Whole turns of the heading beyond the nearest way, positive to the left. By default none: the
    vehicle turns the nearest way that limits.heading_deg allows."""


class VehicleLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    inputs = "speed_m_s", "turn_rate_rad_s"
    rates = "acceleration_m_s2", "turn_acceleration_rad_s2"

    speed_m_s: Positive | None = None
    """Largest speed, either way, in m/s."""
    acceleration_m_s2: Positive | None = Field(None, examples=[2.0])
    """Largest rate of the speed in m/s^2: with it, the speed is continuous, and zero at both ends
    unless the method's rest is false. Closed-form plans may begin with speed."""
    heading_deg: Annotated[float, Field(gt=0, le=360)] | None = Field(None, examples=[80])
    """Largest |heading| in degrees."""


class VehicleFile(NamedFile):
    """A problem file whose path coordinate is x.

    In `start`, `goal` and `limits` an angle of the system has the key NAME_deg. Numbered angles
    NAME1, NAME2 ... share one key: a number, or a list. A key may be left out. Whole turns are
    added to the heading of each place (start, waypoints in order, goal) so that it is nearest to
    the heading before.
    """

    largest_angles: ClassVar[Mapping[str, float]] = {
        "heading": FULL_TURN,
        "steering": FULL_TURN / 4,
        "hitch": FULL_TURN / 2,
    }

    start: PoseStart = Field(default_factory=PoseStart)
    goal: PoseGoal

    def angles(self, table: Any, missing: float) -> list[float]:
        """Return the system's angles in a table, radians, in triangular order; `missing` if left
        out."""
        degrees = []
        for name in [c.name for c in self.build_system().coordinates[1:-1]]:
            key = self.limit_key(name)
            angles = getattr(table, key, None)
            if isinstance(angles, list):
                angles = angles[int(name.removeprefix(key.removesuffix("_deg"))) - 1]
            degrees.append(missing if angles is None else float(np.deg2rad(angles)))
        return degrees

    def start_state(self) -> Array:
        """Return q(0), shape (N,), in m and radians."""
        return self._set_heading([self.start.x_m, *self.angles(self.start, 0.0), self.start.y_m], 0)

    def user_goal(self) -> Array:
        """Return q(T), shape (N,); NaN for a free x."""
        x = np.nan if self.goal.x_m == "free" else self.goal.x_m
        return self._set_heading([x, *self.angles(self.goal, 0.0), self.goal.y_m], -1)

    def waypoint_states(self) -> list[Array]:
        """Return q of each waypoint, shape (N,), NaN if free."""
        return [self._set_heading(q, k) for k, q in enumerate(super().waypoint_states(), 1)]

    def _set_heading(self, q: Sequence[float] | Array, place: int) -> Array:
        out = np.array(q)
        out[self._heading_index] = self.headings[place]
        return out

    @property
    def _heading_index(self) -> int:
        return [c.name for c in self.build_system().coordinates].index("heading")

    @cached_property
    def headings(self) -> list[float]:
        """Headings of start, waypoints in the file's order and goal, radians; NaN if free."""
        limit = getattr(self.limits, "heading_deg", None)
        i, most = self._heading_index, float(np.deg2rad(limit or np.inf))
        ends = [self.angles(table, 0.0)[i - 1] for table in (self.start, self.goal)]
        passed = [float(q[i]) for q in super().waypoint_states()]
        timed = all(point.time for point in self.waypoints)
        order = sorted(range(len(passed)), key=lambda k: self.waypoints[k].time or 0.0)
        start = ends[0] if abs(ends[0]) <= most else nearest_turn(ends[0], 0.0, np.inf)
        before = start
        for k in order if timed else range(len(passed)):
            if not np.isnan(passed[k]):
                before = passed[k] = nearest_turn(passed[k], before, most)
        extra = self.goal.turns
        goal = nearest_turn(ends[1], before, most if extra is None else np.inf)
        return [start, *passed, goal + FULL_TURN * (extra or 0)]

    def turn_words(self) -> str:
        """Describe how the vehicle's heading turns from start to goal."""
        turn = np.rad2deg(self.headings[-1] - self.headings[0])
        extra = self.goal.turns or 0
        way = f"goal.turns = {extra} beyond the nearest way" if extra else "the nearest way"
        if abs(turn) > 180 + 1e-6 and not extra:
            way = "by way of the waypoints" if self.waypoints else "within limits.heading_deg"
        return f"{turn:.4g} deg, {way}"

    def joint_limits(self) -> Array:
        """Return the largest |q|, shape (N,); infinite without a limit, as for x and y."""
        return np.array([np.inf, *self.angles(self.limits, np.inf), np.inf])

    def limit_key(self, coordinate: str) -> str:
        """Return the key of an angle's limit."""
        return coordinate.rstrip("0123456789") + "_deg"

    def path_key(self) -> tuple[str, float]:
        """Return the dotted key that sets x at the end, and the x for which its value is zero."""
        return "goal.x_m", 0.0


def nearest_turn(angle: float, before: float, most: float) -> float:
    """Return an angle plus the whole turns that bring it nearest to the angle `before`, radians.

    Angles within ±`most` are preferred. Of two equally near angles, that with fewer turns is taken.
    """
    turns = (angle - before) / FULL_TURN
    nearest = -np.copysign(max(0.0, np.ceil(abs(turns) - 0.5 - TURN_ROUNDING)), turns)
    others = sorted((nearest - 1, nearest + 1), key=lambda k: abs(turns + k))
    near = [angle + FULL_TURN * k for k in (nearest, *others)]
    return float(next((each for each in near if abs(each) <= most), near[0]))


class CarTable(Table):
    """Constants of the car."""

    kind: Literal["car"]
    wheelbase_m: Positive
    """Distance between the axles in m."""


class CarStart(PoseStart):
    """Where the car's rear axle starts."""

    steering_deg: SteeringDeg = 0.0
    """Steering angle in degrees."""


class CarGoal(PoseGoal):
    """Where the car's rear axle ends."""

    steering_deg: SteeringDeg = 0.0
    """Steering angle in degrees."""


class CarLimits(VehicleLimits):
    """Limits every plan must keep at all times; each may be left out."""

    inputs = "speed_m_s", "steering_rate_rad_s"
    rates = "acceleration_m_s2", "steering_acceleration_rad_s2"

    steering_rate_rad_s: Positive | None = None
    """Largest steering rate in rad/s."""
    steering_acceleration_rad_s2: Positive | None = Field(None, examples=[2.0])
    """Largest rate of the steering rate in rad/s^2."""
    steering_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    """Largest |steering angle| in degrees, below 90."""


class CarFile(VehicleFile):
    """A problem file for the car."""

    summary: ClassVar[str] = "car, driven at its rear axle and steered at the front"

    system: CarTable
    start: CarStart = Field(default_factory=CarStart)
    goal: CarGoal
    limits: CarLimits = Field(default_factory=CarLimits)

    def build_system(self) -> Car:
        """Build the system that the tables describe."""
        return Car(self.system.wheelbase_m)


_HITCH = "Hitch angles in degrees, first trailer first; by default all zero."
_HitchLimit = Annotated[float, Field(gt=0, le=180)]


class TrailersTable(Table):
    """Constants of the car and its trailers."""

    kind: Literal["trailers"]
    wheelbase_m: Positive
    """Distance between the car's axles in m."""
    trailer_lengths_m: Annotated[list[Positive], Field(min_length=1, max_length=8)]
    """From each hitch to the axle of the trailer behind it, in m, in order."""


class TrailersStart(CarStart):
    """Where the last trailer's axle starts, and the angles of the vehicle."""

    hitch_deg: list[HitchDeg] | None = Field(None, description=_HITCH)


class TrailersGoal(CarGoal):
    """Where the last trailer's axle ends, and the angles of the vehicle."""

    hitch_deg: list[HitchDeg] | None = Field(None, description=_HITCH)


class TrailersLimits(CarLimits):
    """Limits every plan must keep at all times; each may be left out."""

    hitch_deg: _HitchLimit | list[_HitchLimit] | None = None
    """Largest |hitch angle| in degrees: one number, or one per trailer."""


class TrailersFile(VehicleFile):
    """A problem file for the car with trailers; x, y and heading are the last trailer's."""

    summary: ClassVar[str] = "car with trailers, each hitched to the axle in front of it"

    system: TrailersTable
    start: TrailersStart = Field(default_factory=TrailersStart)
    goal: TrailersGoal
    limits: TrailersLimits = Field(default_factory=TrailersLimits)

    @model_validator(mode="after")
    def _lengths(self) -> TrailersFile:
        n = len(self.system.trailer_lengths_m)
        for name, table in (("start", self.start), ("goal", self.goal), ("limits", self.limits)):
            angles = table.hitch_deg
            if isinstance(angles, list) and len(angles) != n:
                raise ValueError(
                    f"{name}.hitch_deg has {len(angles)} values but system.trailer_lengths_m"
                    f" has {n}"
                )
        return self

    def build_system(self) -> Trailers:
        """Build the system that the tables describe."""
        return Trailers(self.system.trailer_lengths_m, self.system.wheelbase_m)


class UnicycleTable(Table):
    """Kind of the unicycle, which has no constants."""

    kind: Literal["unicycle"]


class UnicycleLimits(VehicleLimits):
    """Limits every plan must keep at all times; each may be left out."""

    turn_rate_rad_s: Positive | None = None
    """Largest turn rate in rad/s."""
    turn_acceleration_rad_s2: Positive | None = Field(None, examples=[2.0])
    """Largest rate of the turn rate in rad/s^2."""


class UnicycleFile(VehicleFile):
    """A problem file for the unicycle."""

    summary: ClassVar[str] = "robot with two driven wheels"

    system: UnicycleTable
    limits: UnicycleLimits = Field(default_factory=UnicycleLimits)

    def build_system(self) -> Unicycle:
        """Build the system that the tables describe."""
        return Unicycle()


FILES: dict[str, type[ProblemFile]] = {
    "unicycle": UnicycleFile,
    "car": CarFile,
    "trailers": TrailersFile,
}
"""Classes of the problem files of vehicles, by `system.kind`."""
