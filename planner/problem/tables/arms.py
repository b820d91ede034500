"""Tables of problem files for arms: `system.kind = "manipulator"` and `"ball-gear"`.

Both have start, goal and limits in joint angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from planner.problem.requirements.requirement import ROUNDING
from planner.problem.tables.problem_file import (
    MOST_OBSTACLES,
    MOST_WAYPOINTS,
    AngleDeg,
    BaseLimits,
    Free,
    GoalTable,
    JointWaypoint,
    ObstacleTable,
    PerInput,
    ProblemFile,
    bound,
)
from planner.support.arrays import Array
from planner.support.user_tables import Pair, Positive, Table
from planner.systems.ball_gear import BallGear
from planner.systems.manipulator import Gear, Manipulator

_JointLimit = Annotated[float, Field(gt=0, lt=90)]


class ArmLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    inputs = "input_rad_s", "input_rad_s"
    rates = "input_rate_rad_s2", "input_rate_rad_s2"

    input_rad_s: PerInput = None
    """Largest |u1|, |u2| in rad/s: one number for both, or two."""
    input_rate_rad_s2: PerInput = Field(None, examples=[[5.0, 5.0]])
    """Largest |du/dt|, one number or two: with it, inputs are continuous, and zero at both ends
    unless the method's rest is false. Closed-form plans may begin with speed."""
    joint_deg: _JointLimit | list[_JointLimit] | None = None
    """Largest |theta| in degrees, below 90: one number, or one per joint."""

    self_clearance_m: Positive | None = Field(None, examples=[0.03])
    """Least distance in metres (in the unit of system.link_lengths, 1 each) between links that are
    not neighbours: at least their width. If left out, links may cross."""


class LimitsTable(ArmLimits):
    """Limits every plan must keep at all times; each may be left out."""

    z2_margin: Annotated[float, Field(ge=0)] | None = Field(None, examples=[0.01])
    """Least |z2|; z2, the second chained coordinate, keeps the sign it has at the start. With three
    joints z2 is negative where theta2 is positive. Start and goal must have the same sign of z2.
    Methods in chained coordinates never cross z2 = 0. With four or more joints z2 may change its
    sign on the way to any goal: set z2_margin only where you need it."""


MAX_TRAVEL_RAD = 8 * np.pi

MOST_JOINTS = 8
"""Largest number of joints: each further joint makes the chained form's expressions three times as
long. With eight a travel is chosen in half a minute; with twelve no method finishes so soon."""

MOST_RATIO = 1000.0
"""Largest ratio of an arm's gears, usually about 1; with 1e8 a search runs minutes in vain."""

Ratio = Annotated[float, Field(gt=0, le=MOST_RATIO)]
Joints = Annotated[int, Field(ge=2, le=MOST_JOINTS)]


class JointStart(Table):
    """Where the arm starts."""

    theta_deg: list[AngleDeg]
    """Joint angles in degrees, each within (-90, 90)."""
    phi_rad: float = 0.0
    """Disk angle in radians."""


class JointGoal(GoalTable):
    """Where the arm ends: its joints, its tip, or some of both."""

    theta_deg: list[AngleDeg | Free] | None = None
    """Joint angles in degrees, each within (-90, 90), or 'free' where the planner chooses. By
    default all are free, for a goal of the tip."""
    tip_m: Pair | None = None
    """Goal of the tip, [x, y] in metres from the base; needs system.link_lengths and at least two
    free joints."""
    tip_angle_deg: float | None = None
    """Direction of the last link at the end in degrees: the sum of all joints' angles. Needs one
    more free joint."""
    travel: Free | float = "free"
    """Change of the disk angle in radians, or 'free'."""

    @model_validator(mode="after")
    def _check_completeness(self) -> JointGoal:
        tip = [k for k in ("tip_m", "tip_angle_deg") if getattr(self, k) is not None]
        if self.theta_deg is None and not tip:
            raise ValueError(
                "needs theta_deg, the joint angles; or a goal of the tip: tip_m, tip_angle_deg"
            )
        if self.theta_deg is None:
            return self
        free, named = sum(a == "free" for a in self.theta_deg), " and ".join(tip)
        if tip and not free:
            raise ValueError(
                f"theta_deg gives every joint and so fixes the tip; leave out {named},"
                " or write 'free' in place of some angles"
            )
        if free == len(self.theta_deg) and not tip:
            raise ValueError("leaves every joint free; give an angle in theta_deg, or tip_m")
        return self

    @field_validator("travel")
    @classmethod
    def _check_travel(cls, travel: Free | float) -> Free | float:
        if isinstance(travel, float | int) and abs(travel) > MAX_TRAVEL_RAD:
            raise ValueError(
                f"is in radians and at most {MAX_TRAVEL_RAD:.4g} either way;"
                f" {travel:g} looks like degrees ({np.deg2rad(travel):.4g} rad)"
            )
        return travel


class ArmFile(ProblemFile):
    """A problem file for an arm of `system.joints` joints."""

    places: ClassVar[str] = """
#   Waypoints, any number; angles may be "free". Without a time the plan chooses when to pass.
#   [[waypoints]]
#   theta_deg = [20, "free", 10]
#   time = 5.0
#   Obstacles, any number: discs that the links must not touch. The base is the origin.
#   [[obstacles]]
#   centre_m = [1.0, 2.0]        # in the unit of link_lengths
#   radius_m = 0.3
#   clearance_m = 0.02           # because the machine deviates from the plan; default 0
"""

    start: JointStart
    goal: JointGoal
    limits: ArmLimits = Field(default_factory=ArmLimits)
    waypoints: list[JointWaypoint] = Field(default_factory=list, max_length=MOST_WAYPOINTS)
    """Places the motion must pass through."""
    obstacles: list[ObstacleTable] = Field(default_factory=list, max_length=MOST_OBSTACLES)
    """Discs in the plane that the links must not touch."""

    @model_validator(mode="after")
    def _lengths(self) -> ArmFile:
        n = self.system.joints
        values: list[tuple[str, Sequence[float | str]]] = [
            ("start", self.start.theta_deg),
            ("goal", self._goal_deg),
            *((f"waypoints[{k}]", w.theta_deg) for k, w in enumerate(self.waypoints)),
        ]
        for name, angles in values:
            if len(angles) != n:
                raise ValueError(
                    f"{name}.theta_deg has {len(angles)} angles but system.joints = {n}"
                )
        limit = self.limits.joint_deg
        if isinstance(limit, list) and len(limit) != n:
            raise ValueError(f"limits.joint_deg has {len(limit)} values but system.joints = {n}")
        tip, free = self.tip(), sum(a == "free" for a in self._goal_deg)
        if len(tip) > free:
            keys = ["goal.tip_m"] * ("x" in tip) + ["goal.tip_angle_deg"] * ("angle" in tip)
            raise ValueError(
                f"{' and '.join(keys)} need{'s' * (len(keys) == 1)} {len(tip)} free joints, but"
                f" goal.theta_deg leaves {free} free"
            )
        if "x" in tip and self.system.link_lengths is None:
            raise ValueError(
                "goal.tip_m needs system.link_lengths, the lengths of the links in metres"
            )
        return self

    @property
    def _goal_deg(self) -> list[float | Free]:
        """Angles of all joints at the goal, degrees or "free"."""
        theta_deg = self.goal.theta_deg
        return ["free"] * self.system.joints if theta_deg is None else theta_deg

    @property
    def _stretched_deg(self) -> list[float] | None:
        """Angles at a goal of the tip at full reach, degrees: the arm is straight. Else None.

        There the tip's place has no derivative along the arm, which a search for angles needs.
        """
        place, lengths = self.goal.tip_m, self.system.link_lengths
        if place is None or lengths is None:
            return None
        if abs(math.hypot(*place) - sum(lengths)) > ROUNDING * sum(lengths):
            return None
        angles = [float(np.rad2deg(np.arctan2(place[1], place[0]))), *[0.0] * (len(lengths) - 1)]
        given = [*zip(self._goal_deg, angles, strict=True), (self.goal.tip_angle_deg, angles[0])]
        known = all(abs(a - b) < ROUNDING * 90 for a, b in given if isinstance(a, float | int))
        return angles if known else None

    def start_state(self) -> Array:
        """Return q(0), shape (n+1,), radians."""
        return np.array([self.start.phi_rad, *np.deg2rad(self.start.theta_deg)])

    def user_goal(self) -> Array:
        """Return q(T), shape (n+1,), radians, NaN if free."""
        goal = self._stretched_deg or self._goal_deg
        angles = [np.nan if isinstance(a, str) else a for a in goal]
        travel = np.nan if self.goal.travel == "free" else self.goal.travel
        return np.array([self.start.phi_rad + travel, *np.deg2rad(angles)])

    def tip(self) -> dict[str, float]:
        """Return the given quantities of the tip: "x" and "y" in metres, "angle" in radians."""
        out = dict[str, float]()
        if self._stretched_deg:  # then the goal gives every joint
            return out
        if self.goal.tip_m is not None:
            out |= dict(zip("xy", self.goal.tip_m, strict=True))
        if self.goal.tip_angle_deg is not None:
            out["angle"] = float(np.deg2rad(self.goal.tip_angle_deg))
        return out

    def joint_limits(self) -> Array:
        """Return the largest |q|, shape (n+1,), radians; infinite without a limit."""
        return np.array([np.inf, *np.deg2rad(bound(self.limits.joint_deg, self.system.joints))])

    def limit_key(self, coordinate: str) -> str:
        """Return the key of the joints' limits."""
        return "joint_deg"

    def waypoint_states(self) -> list[Array]:
        """Return q of each waypoint, shape (n+1,), radians, NaN if free."""
        out = []
        for point in self.waypoints:
            travel = np.nan if point.travel is None else point.travel
            angles = [np.nan if isinstance(a, str) else np.deg2rad(a) for a in point.theta_deg]
            out.append(np.array([self.start.phi_rad + travel, *angles]))
        return out


def _check_lengths(n: int, K: list[float] | None, link_lengths: list[float] | None) -> None:
    """Raise a ValueError if K or `link_lengths` has the wrong length for n joints."""
    if K is not None and len(K) != n - 1:
        raise ValueError(f"joints = {n} needs {n - 1} values in K (K2 ... K{n}), not {len(K)}")
    if link_lengths is not None and len(link_lengths) != n:
        raise ValueError(f"link_lengths needs {n} values, not {len(link_lengths)}")


class BallGearTable(Table):
    """Constants of Nakamura's manipulator."""

    kind: Literal["ball-gear"]
    joints: Joints = Field(description=f"Number of joints n, at most {MOST_JOINTS}.")
    K: list[Ratio] = Field(description=f"K2 ... Kn, n-1 numbers, at most {MOST_RATIO:g}.")
    k_g: Positive = 1.0
    """Turns of the last ball per turn of motor 1; u1 is the speed of the motor."""
    link_lengths: list[Positive] | None = None
    """Lengths of the links, m, by default 1 each: for pictures, posts, tips and the space that
    the arm needs."""

    @model_validator(mode="after")
    def _check_constants(self) -> BallGearTable:
        _check_lengths(self.joints, self.K, self.link_lengths)
        return self


class BallGearFile(ArmFile):
    """A problem file for the ball-gear manipulator."""

    summary: ClassVar[str] = "arm of n joints and two motors, driven through ball gears (Nakamura)"

    system: BallGearTable

    def build_system(self) -> BallGear:
        """Build the system that the tables describe."""
        return BallGear(self.system.K, self.system.k_g, self.system.link_lengths)


class GearTable(Table):
    """Gear geometry; lengths share one unit. A list has a number for each stage, 1 ... n-1."""

    r1: Positive | list[Positive]
    """Radius of wheel B."""
    R: Positive | list[Positive]
    """Distance from the axle of disk A to its contacts P1 and P2."""
    r3: Positive | list[Positive]
    """Distance from the axle of disk A' to its contact P3."""
    lam: Positive | list[Positive] = Field(alias="lambda")
    """Bevel and spur gears: speed of disk A over that of the next wheel B."""
    eta: Positive | list[Positive]
    """Belt: speed of disk A' over that of the joint; the diameter of the joint's pulley over that
    of the pulley of A'."""

    def stages(self, count: int) -> list[Gear]:
        """Return the gears of the stages 1 ... count; a single number applies to all.

        Raises:
            ValueError: If a list has the wrong length.
        """
        columns = []
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if isinstance(value, list) and len(value) != count:
                raise ValueError(
                    f"gear.{field.alias or name} has {len(value)} values; joints ="
                    f" {count + 1} needs {count}, one per stage, or one number for all"
                )
            columns.append(value if isinstance(value, list) else [value] * count)
        return [Gear(*row) for row in zip(*columns, strict=True)]


class ManipulatorTable(Table):
    """The manipulator: its constants, given directly or by gear geometry."""

    kind: Literal["manipulator"]
    joints: Joints = Field(description=f"Number of joints n, at most {MOST_JOINTS}.")
    K: list[Ratio] | None = Field(
        None, description=f"K2 ... Kn, n-1 numbers, at most {MOST_RATIO:g}."
    )
    gear: GearTable | None = None
    """Gear geometry, instead of K."""
    k_g: Positive | None = None
    """Turns of the last disk per turn of motor 1; needed with K; with gear it follows from
    k_g_rule."""
    k_g_rule: Literal["chain", "printed"] = "chain"
    """k_g with gear: rho^(n-2), from the chain of disks (with stages that differ rho_1 ...
    rho_(n-2)); or rho^2 as printed in the paper, a misprint."""
    link_lengths: list[Positive] | None = None
    """Lengths of the links, m, by default 1 each: for pictures, posts, tips and the space that
    the arm needs."""

    @model_validator(mode="after")
    def _check_constants(self) -> ManipulatorTable:
        if (self.K is None) == (self.gear is None):
            raise ValueError("give either K (with k_g) or gear, exactly one of them")
        _check_lengths(self.joints, self.K, self.link_lengths)
        if self.K is not None and self.k_g is None:
            raise ValueError("K needs k_g too")
        if self.gear is not None:
            stages = self.gear.stages(self.joints - 1)
            if self.k_g_rule == "printed" and len(set(stages)) > 1:
                raise ValueError('k_g_rule = "printed" needs equal stages')
        return self


class ManipulatorFile(ArmFile):
    """A problem file for the manipulator."""

    summary: ClassVar[str] = (
        "arm of n joints and two motors, driven through friction disks (the paper's)"
    )

    system: ManipulatorTable
    limits: LimitsTable = Field(default_factory=LimitsTable)

    def build_system(self) -> Manipulator:
        """Build the system that the tables describe."""
        table = self.system
        if table.gear is not None:
            stages = table.gear.stages(table.joints - 1)
            rule, lengths = table.k_g_rule, table.link_lengths
            return Manipulator.from_gear(
                table.joints, stages, k_g=table.k_g, rule=rule, link_lengths=lengths
            )
        assert table.K is not None
        assert table.k_g is not None
        return Manipulator(table.K, table.k_g, table.link_lengths)


FILES: dict[str, type[ProblemFile]] = {"manipulator": ManipulatorFile, "ball-gear": BallGearFile}
"""Classes of the problem files of arms, by `system.kind`."""
