"""The problem file: the tables that all kinds of systems share, and the base class `ProblemFile`.

The shared tables are `[feedback]` (the tracker that closes the loop), `[compensation]` (which
errors of the machine are compensated), `[[waypoints]]`, `[[obstacles]]`, and the common part of
`[limits]`; the other limits of arms are in `arms`, those of vehicles in `vehicles`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from planner.problem.tables.machine_effects import MachineTable
from planner.problem.tables.method_options import MethodsTable
from planner.support.arrays import Array
from planner.support.user_tables import Pair, Positive, Table, allowed_hint
from planner.systems.triangular_system import TriangularSystem


class CompensationTable(Table):
    """Options of compensated plans."""

    on: bool = False
    """Whether plans are compensated for the problem's nominal machine (without spreads): their
    inputs are the motor commands, their motion is the one predicted on that machine."""
    preparation: Literal["forward", False] = "forward"
    """How backlash and shaft torsion of the joints are taken up. forward: by a preparatory motion
    of some seconds, without reversal of the drive. false: not before the start; only the
    correction, during the plan."""
    take_up: bool = True
    """Whether the plan's clock is held where the drive turns back, until the axes have turned
    through their lost motion; about 1.5 s each time."""
    correction: bool = True
    """Whether the motors' angles are corrected on the nominal machine, so that it stays near the
    plan's path and ends at the goal."""
    back_off: bool = True
    """Whether the drive turns back after the plan's end, as far as no joint of the nominal machine
    follows. On machines with less lost motion than the mean, joints that overshot come back. It
    takes about a second. Not used if goal.travel is given, if the drive reverses during the plan,
    or if a shaft was wound up in its first direction before (machine.start_state)."""
    lag: bool = True
    """Whether commands are sent earlier by the lag of hold, delay, servo and friction."""
    gearheads: bool = True
    """Whether a motor that reverses crosses the backlash of its gearhead at once."""


def _check_two_values(value: float | list[float] | None) -> float | list[float] | None:
    if isinstance(value, list) and len(value) != 2:
        raise ValueError(f"has {len(value)} values; give one, or one for each of the 2 inputs")
    return value


PerInput = Annotated[Positive | list[Positive] | None, AfterValidator(_check_two_values)]


def bound(value: float | Sequence[float] | None, size: int) -> Array:
    """Return limits as an array (size,), infinite without a limit."""
    return np.broadcast_to(np.asarray(np.inf if value is None else value, dtype=float), size)


class BaseLimits(Table):
    """Common base of the `[limits]` tables of all kinds of systems."""

    inputs: ClassVar[tuple[str, str]]
    """Keys of the largest |u| of the two inputs; a key that both share takes one number or two."""
    rates: ClassVar[tuple[str, str]]
    """Keys of the largest |du/dt|, likewise."""

    def sizes(self, keys: tuple[str, str]) -> Array:
        """Return the values of the keys of the two inputs, (2,), infinite without a limit."""
        return np.array([bound(getattr(self, key), 2)[i] for i, key in enumerate(keys)])


class FeedbackTable(Table):
    """Options of the feedback by a receding-horizon tracker."""

    period_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Time between two readings of the encoders, seconds."""
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.01
    """Time from a reading to the first command that follows from it, seconds; rounded up to the
    machine's control period."""
    horizon_s: Annotated[float, Field(gt=0, le=60)] = 2.0
    """Time ahead over which the tracker keeps limits, seconds; its cost covers the rest of the
    motion. With 1 s the preparatory motion moves joints past the start, and it must not reverse to
    bring them back."""
    overtime_s: Annotated[float, Field(ge=0, le=60)] = 0.3
    """Time for corrections after the plan's end, seconds; a replay cuts it off at its settle
    time."""
    run_up: Literal["auto"] | bool = "auto"
    """Whether a preparatory motion before the plan takes up and measures backlash and shaft
    torsion: the arm goes back and returns to the start. auto: if the machine has backlash or soft
    shafts, there are at most two passive joints, and the plan's drive never reverses or the plan is
    compensated, and if there is room between obstacles. Without it a compensated plan prepares as
    it does in open loop."""
    path_error_deg: Annotated[float, Field(gt=0)] = 0.1
    """Error during the motion that weighs as much as one unit of correction, degrees (a length in
    metres counts as an angle in radians)."""
    goal_error_deg: Annotated[float, Field(gt=0)] = 0.02
    """Error at the end that weighs as much as one unit of correction, degrees. A smaller value lets
    theta1 deviate further from its path so that all joints reach the goal."""
    correction: Annotated[float, Field(gt=0)] = 0.2
    """Unit of correction, as a fraction of each input's limit (or of its peak)."""
    correction_step: Annotated[float, Field(gt=0)] = 0.05
    """Unit of change of the correction per period, as the same fraction. A smaller value excites
    the joints' shafts less; if links have inertia, it is reduced automatically."""
    least_speed: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Least speed along the path, as a fraction of the plan's. It keeps the drive from reversing,
    which would cross the whole backlash."""
    take_up_play: bool = True
    """Whether a command that reverses a motor first crosses the backlash of its gearhead."""
    max_iterations: Annotated[int, Field(ge=10)] = 2000
    """Iterations after which a quadratic program counts as late."""


AngleDeg = Annotated[float, Field(gt=-90, lt=90)]

MOST_WAYPOINTS, MOST_OBSTACLES = 50, 100
"""Largest numbers of waypoints and obstacles. More waypoints give a motion more pieces than the
first mesh has intervals. Each obstacle adds a constraint per link and mesh point, and verifying
time."""


class WaypointTable(Table):
    """A place the motion must pass through."""

    time: Positive | None = None
    """Time in seconds; needs a fixed goal.duration. Without it: at any time, and in any order with
    other waypoints without a time."""


class NamedWaypoint(WaypointTable):
    """A waypoint by coordinate names."""

    q: dict[str, float | list[float]] = Field(min_length=1)
    """Some coordinates; the others are free. NAME_deg is an angle in degrees and NAME_m a length in
    m, as in start and goal (numbered angles take a list); NAME alone is in the coordinate's own
    unit (rad, m)."""


class JointWaypoint(WaypointTable):
    """A waypoint in joint angles."""

    theta_deg: list[AngleDeg | Free]
    """Joint angles in degrees, each within (-90, 90), or 'free'."""
    travel: float | None = None
    """Change of the disk angle since the start in radians; free if left out."""

    @field_validator("theta_deg")
    @classmethod
    def _check_angles(cls, angles: list[float | str]) -> list[float | str]:
        if all(isinstance(angle, str) for angle in angles):
            raise ValueError("leaves every joint free; give at least one angle")
        return angles


class ObstacleTable(Table):
    """A disc in the plane that no link may touch; the arm's base is the origin."""

    centre_m: Pair
    """Its centre [x, y] in metres (in the unit of system.link_lengths, 1 each)."""
    radius_m: Positive
    """Its radius in metres."""
    clearance_m: Annotated[float, Field(ge=0)] = 0.0
    """Least distance in metres between links and disc: half the width of a link plus the machine's
    error."""


Free = Literal["free"]


class GoalTable(Table):
    """Keys that every goal has."""

    duration: Free | Annotated[float, Field(gt=0)] = 10.0
    """Duration in seconds, or 'free'."""
    duration_max: Positive | None = None
    """Longest duration of the whole run in seconds, including what compensation adds before, during
    and after the plan; the plan is shortened to fit."""


class ProblemFile(Table):
    """A problem file. Each kind of system has a subclass, which sets the types of its tables.

    Attributes:
        summary: One line about the system, for listings.
        example: First part of the file that `planner new` writes: a solvable problem with its
            `[limits]`. Limits that it does not name are added as comments. The planner's own kinds
            have a file `examples/KIND.toml` instead.
        places: The part after `example`: comments that show waypoints and obstacles. The word
            COORDINATE is replaced by the name of the system's last coordinate.
    """

    summary: ClassVar[str] = ""
    example: ClassVar[str] = ""
    places: ClassVar[str] = ""

    title: str = ""
    """One line about the problem."""
    system: Any
    start: Any
    goal: Any
    limits: BaseLimits
    method: MethodsTable = Field(default_factory=MethodsTable)
    machine: MachineTable = Field(default_factory=MachineTable)
    feedback: FeedbackTable = Field(default_factory=FeedbackTable)
    compensation: CompensationTable = Field(default_factory=CompensationTable)
    waypoints: Any = Field(default_factory=list)
    """Places to pass through."""

    @abstractmethod
    def build_system(self) -> TriangularSystem:
        """Build the system that the tables describe."""

    @abstractmethod
    def start_state(self) -> Array:
        """Return q(0), shape (N,)."""

    @abstractmethod
    def user_goal(self) -> Array:
        """Return the goal in user coordinates, shape (N,), NaN if free."""

    def path_key(self) -> tuple[str, float]:
        """Return the dotted key that sets q₁(T), and the q₁(T) for which its value is zero.

        The key is "" if other keys of the goal determine q₁(T).
        """
        return "goal.travel", float(self.start_state()[0])

    @abstractmethod
    def joint_limits(self) -> Array:
        """Return the largest |q|, shape (N,); infinite without a limit."""

    def limit_key(self, coordinate: str) -> str:
        """Return the key in `[limits]` for a coordinate of this name; "" (the default): none."""
        return ""

    def user_limits(self) -> Array:
        """Return the largest |user coordinate|, shape (N,); infinite without a limit."""
        return self.joint_limits()

    @abstractmethod
    def waypoint_states(self) -> list[Array]:
        """Return the user coordinates of each waypoint, shape (N,), NaN where free."""

    def turn_words(self) -> str:
        """Describe how a vehicle's heading turns from start to goal; empty for other systems."""
        return ""

    def tip(self) -> dict[str, float]:
        """Return the goal of the tip: values of "x", "y" and "angle"; empty except for arms."""
        return {}


SUFFIXES = {"_deg": ("rad", np.pi / 180), "_m": ("m", 1.0)}
"""Suffixes of coordinates' keys, each with the unit that the coordinate must have and the factor
that converts a value to that unit."""


class NamedFile(ProblemFile):
    """A problem file whose waypoints give coordinates by name.

    Attributes:
        largest_angles: Largest angle in rad that a waypoint may give, by the coordinate's name
            without its number; a larger angle is probably in degrees.
    """

    places: ClassVar[str] = """
#   Waypoints, any number: values of some coordinates. NAME_deg is in degrees, NAME_m in m; NAME
#   alone is in rad or m. Without a time the plan chooses when to pass.
#   [[waypoints]]
#   q = { COORDINATE = 0.5 }
#   time = 2.0
"""
    largest_angles: ClassVar[Mapping[str, float]] = {}

    waypoints: list[NamedWaypoint] = Field(default_factory=list, max_length=MOST_WAYPOINTS)
    """Places the motion must pass through."""

    @model_validator(mode="after")
    def _check_waypoints(self) -> NamedFile:
        NamedFile.waypoint_states(self)
        return self

    def waypoint_states(self) -> list[Array]:
        """Return the user coordinates of each waypoint, shape (N,), NaN where free."""
        coordinates = self.build_system().user_coordinates
        units = {c.name: c.unit for c in coordinates}
        states = []
        for number, point in enumerate(self.waypoints):
            values: dict[str, float] = {}
            for key, value in point.q.items():
                where = f"waypoints[{number}].q"
                for name, each in self._meant(where, key, value, units).items():
                    if name in values:
                        raise ValueError(f"{where} gives '{name}' twice; leave out '{key}'")
                    values[name] = each
            states.append(np.array([values.get(name, np.nan) for name in units]))
        return states

    def _meant(
        self, where: str, key: str, value: float | list[float], units: dict[str, str]
    ) -> dict[str, float]:
        """Return the values that a key of a waypoint gives, by coordinate, in its own unit."""
        ending = next((end for end in SUFFIXES if key.endswith(end) and key not in units), "")
        word, (unit, size) = key.removesuffix(ending), SUFFIXES.get(ending, ("", 1.0))
        numbered = [name for name in units if name.rstrip("0123456789") == word != name]
        names = numbered if isinstance(value, list) and numbered else [word]
        if unknown := [n for n in names if n not in units or (ending and units[n] != unit)]:
            both = {"rad": "_deg", "m": "_m"}
            allowed = [*units, *(n + both[u] for n, u in units.items() if u in both)]
            hint = allowed_hint(key if unknown == [word] else unknown[0], allowed)
            raise ValueError(f"{where} has no coordinate '{key}'; {hint}")
        values = value if isinstance(value, list) else [value]
        if len(values) != len(names):
            raise ValueError(
                f"{where}.{key} has {len(values)} values; it gives {len(names)}: {', '.join(names)}"
            )
        most = self.largest_angles.get(word.rstrip("0123456789"), np.inf)
        for name, each in zip(names, values, strict=True):
            if not ending and abs(each) > most:
                raise ValueError(
                    f"{where}.{name} = {each:g} is in radians and at most {most:.4g} either way;"
                    f" it looks like degrees, which are {name}_deg = {each:g}"
                )
        return {name: size * each for name, each in zip(names, values, strict=True)}
