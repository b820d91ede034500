"""`Problem`, a motion-planning problem, read from the tables of its file (TOML) and checked."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError, InputWarning, expect, factory
from planner.problem.conditions import (
    Limits,
    bare_limits,
    clash_of_times,
    contradiction,
    likely_slip,
    limits_by_class,
    obstacles_of,
    tip_of,
    waypoints_of,
    with_changes,
)
from planner.problem.requirements.ends import (
    Duration,
    Goal,
    LongestDuration,
    Start,
    TipGoal,
    UserGoal,
    UserLimit,
)
from planner.problem.requirements.motion_limits import (
    ChartDomain,
    InputLimit,
    JointLimit,
    RateLimit,
    Z2Margin,
)
from planner.problem.requirements.places import Obstacle, Waypoint
from planner.problem.requirements.requirement import Demand, Requirement
from planner.problem.requirements.self_collision import SelfCollision
from planner.problem.tables.kinds import KIND_LIMITS, REQUIREMENTS, parse_file, system_of
from planner.problem.tables.machine_effects import MachineTable
from planner.problem.tables.method_options import MethodsTable, Rest
from planner.problem.tables.problem_file import CompensationTable, FeedbackTable
from planner.support.arrays import Array, Frozen, floats, frozen, hashable, plain
from planner.support.files import read_toml
from planner.support.tables import line
from planner.systems.chained_form import chained_form
from planner.systems.manipulator import (
    PROTOTYPE_K,
    PROTOTYPE_K_G,
    Gear,
    Manipulator,
    prototype_ratios,
)
from planner.systems.triangular_system import TriangularSystem


class PlanBefore(Protocol):
    """What a problem asks of the plan that an arm ran last; see `planner.Plan`."""

    @property
    def problem(self) -> Problem:
        """The problem that the plan solves."""

    @property
    def notes(self) -> Mapping[str, Any]:
        """Facts, among them `end_state`, entries of `machine.start_state`, and `end_theta_deg`."""


WIDEST_FREE_JOINT_RAD = np.deg2rad(88.0)
"""Largest |θ| at the goal for a joint that the goal leaves free, unless the joint's limit is
smaller. At 90 degrees the drive of an arm stands still."""


POSE_NOISE_DEG = 0.05
"""Most by which a measured pose may exceed a joint's limit: half a step of a common encoder."""


@factory("planner.load_problem(path), Problem.manipulator(...) or Problem.from_dict({...})")
@dataclass(frozen=True, eq=False)
class Problem(Frozen):
    """A motion-planning problem: system, start, goal and limits. Build it with `load_problem`.

    Attributes:
        name: Title, or the file's name.
        system: The system.
        start: q(0), shape (N,), in radians (and metres), whatever the file's unit.
        user_goal: The goal in user coordinates, those of the problem file, shape (N,), NaN if free.
        duration: Duration, s; None if free.
        duration_max: Longest duration of the whole run, including the motions that compensation
            adds, s; None without a limit.
        limits: Limits that every plan must respect.
        methods: Options of each method.
        machine: The emulated machine: preset and changes.
        feedback: Options of the tracker (feedback).
        compensation: Whether and how plans are compensated for the machine.
        waypoints: Places that every plan passes through.
        obstacles: Discs that the links of an arm must not touch.
        kind_limits: Limits that only some kinds of systems can have, such as `self_collision`.
        registered_limits: Limits that all kinds can have (`planner.register_requirement`).
        tip: Goal of an arm's tip, which replaces some or all joint angles; None without one.
        source: Origin of the problem, for messages.
        path_key: The dotted key that sets q₁(T), such as "goal.travel" ("" if other keys of the
            goal determine q₁(T)), and the q₁(T) for which its value is zero.
        heading_turn: How a vehicle's heading turns from start to goal; empty for other systems.
    """

    name: str
    system: TriangularSystem
    start: Array
    user_goal: Array
    duration: float | None
    duration_max: float | None
    limits: Limits
    methods: MethodsTable
    machine: MachineTable
    feedback: FeedbackTable
    compensation: CompensationTable
    waypoints: tuple[Waypoint, ...]
    obstacles: tuple[Obstacle, ...]
    kind_limits: tuple[Requirement, ...]
    registered_limits: tuple[Requirement, ...]
    tip: TipGoal | None
    source: str
    path_key: tuple[str, float]
    heading_turn: str
    _data: Mapping[str, Any]
    _ends: tuple[str, str] = ("start", "goal")  # their names in messages
    _hint: Array | None = None  # expected q(T) for a search, if the goal leaves joints free

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "problem") -> Problem:
        """Build a problem from the tables of a problem file.

        A `planner.InputWarning` is given if angles look like radians, if an obstacle is out of
        reach, or if compensation is on and ignores one of the limits.

        Raises:
            InputError: If a key, value or combination is wrong; the message names it.
        """
        expect(Mapping, data, "planner.load_problem(path) reads the tables of a file")
        tables = parse_file(plain(data), source)
        system = system_of(tables)
        mismatch = tables.machine.mismatch(system.size - 1)
        if mismatch:
            raise InputError(mismatch, source=source)
        obstacles = tuple(obstacles_of(tables, system))
        problem = cls(
            name=line(tables.title) or line(Path(source).stem),
            system=system,
            start=tables.start_state(),
            user_goal=tables.user_goal(),
            duration=None if tables.goal.duration == "free" else float(tables.goal.duration),
            duration_max=tables.goal.duration_max,
            limits=bare_limits(tables, system),
            methods=tables.method,
            machine=tables.machine,
            feedback=tables.feedback,
            compensation=tables.compensation,
            waypoints=tuple(waypoints_of(tables, system)),
            obstacles=obstacles,
            kind_limits=limits_by_class(KIND_LIMITS, tables, system, source),
            registered_limits=limits_by_class(REQUIREMENTS.values(), tables, system, source),
            tip=tip_of(tables, system, obstacles, source),
            source=source,
            path_key=tables.path_key(),
            heading_turn=tables.turn_words(),
            _data=tables.model_dump(mode="json", by_alias=True, exclude_unset=True),
        )
        states = {"start": problem.start, "goal": problem.goal}
        states |= {f"waypoint {point.number}": point.q for point in problem.waypoints}
        why = contradiction(states, problem.requirements, system)
        if system.has_user_coordinates and not why:  # check user coordinates by themselves
            states = {"start": system.user(problem.start), "goal": problem.user_goal}
            states |= {f"waypoint {point.number}": point.user for point in problem.waypoints}
            most = tuple(problem.limits.user.tolist())
            limit = JointLimit(system.user_coordinates, most, problem.limits.user_keys)
            why = contradiction(states, [limit], system)
        if why := why or clash_of_times(problem.waypoints, problem.duration):
            raise InputError(why, source=source)
        longest = problem.duration_max
        if longest is not None and (problem.duration or 0.0) > longest:
            raise InputError(
                f"goal.duration = {problem.duration:g} s is more than goal.duration_max ="
                f" {longest:g} s",
                source=source,
            )
        if doubt := likely_slip(system, problem.start, problem.goal, obstacles):
            warnings.warn(f"{source}: {doubt}", InputWarning, stacklevel=2)
        unknown = [r for r in problem.registered_limits if r.reads != {"q"}]
        if problem.compensation.on and unknown:
            keys = ", ".join(f"limits.{requirement.key}" for requirement in unknown)
            warnings.warn(
                f"{source}: compensation.on: the inputs that it adds ignore {keys}; a"
                " compensated plan that violates one of them is refused",
                InputWarning,
                stacklevel=2,
            )
        return problem

    @classmethod
    def manipulator(
        cls,
        start_deg: ArrayLike,
        goal_deg: ArrayLike | Sequence[float | str] | None = None,
        *,
        tip_m: ArrayLike | None = None,
        tip_angle_deg: float | None = None,
        travel: float | None = None,
        duration: float | None = 10.0,
        duration_max: float | None = None,
        K: ArrayLike | None = None,
        k_g: float | None = None,
        gear: Gear | Mapping[str, float | Sequence[float]] | None = None,
        link_lengths: ArrayLike | None = None,
        input_rad_s: ArrayLike | None = None,
        input_rate_rad_s2: ArrayLike | None = None,
        joint_deg: ArrayLike | None = None,
        z2_margin: float | None = None,
        self_clearance_m: float | None = None,
        title: str = "manipulator",
        changes: Mapping[str, Any] | None = None,
    ) -> Problem:
        """Build a problem of the manipulator with friction disks without a file.

        System constants default to those of the paper's three-joint prototype; for more joints K
        continues with the same ratio. Limits default to none. Each argument corresponds to the key
        of the same name in a problem file and has the same range.

        Args:
            start_deg: θ₁ … θₙ at the start, degrees; their number is the number of joints.
            goal_deg: θ₁ … θₙ at the goal, degrees, or "free"; by default all free.
            tip_m: Position of the tip at the goal, x and y in metres.
            tip_angle_deg: Direction of the last link at the goal, degrees: the sum of all angles.
            travel: Change of the disk angle φₙ₋₁, radians; None if free.
            duration: Seconds; None if free.
            duration_max: Longest duration of the whole run, including the motions that
                compensation adds, s.
            K: K₂ … Kₙ; also needs k_g.
            k_g: Turns of the last disk per turn of motor 1.
            gear: Geometry of the gears, instead of K; lists if the stages differ.
            link_lengths: Lengths of the links in metres, for tip, drawing and obstacles; by default
                1 each. A goal of the tip needs them.
            input_rad_s: Largest |u₁|, |u₂|, rad/s: one number for both, or two.
            input_rate_rad_s2: Largest |du/dt|, rad/s²: one number for both, or two.
            joint_deg: Largest |θ|, degrees: one number, or one per joint.
            z2_margin: Least |z₂|; z₂ keeps the sign it has at the start.
            self_clearance_m: Least distance between links that are not neighbours, metres.
            title: Name in tables and figures.
            changes: Further dotted keys and values, for example {"machine.preset": "ideal"}.

        Raises:
            InputError: As for `from_dict`.
        """
        angles = plain(start_deg)
        joints = len(angles) if isinstance(angles, list) else len(PROTOTYPE_K) + 1
        if gear is None and K is None:
            K, k_g = prototype_ratios(joints), PROTOTYPE_K_G if k_g is None else k_g
        if isinstance(gear, Gear):
            gear = {"lambda" if key == "lam" else key: v for key, v in vars(gear).items()}
        keys = {
            "title": title,
            "system.kind": Manipulator.kind,
            "system.joints": joints,
            "system.K": K,
            "system.k_g": k_g,
            "system.gear": gear,
            "system.link_lengths": link_lengths,
            "start.theta_deg": angles,
            "goal.theta_deg": goal_deg,
            "goal.tip_m": tip_m,
            "goal.tip_angle_deg": tip_angle_deg,
            "goal.travel": "free" if travel is None else travel,
            "goal.duration": "free" if duration is None else duration,
            "goal.duration_max": duration_max,
            "limits.input_rad_s": input_rad_s,
            "limits.input_rate_rad_s2": input_rate_rad_s2,
            "limits.joint_deg": joint_deg,
            "limits.z2_margin": z2_margin,
            "limits.self_clearance_m": self_clearance_m,
        }
        tables = with_changes({"limits": {}}, {k: v for k, v in keys.items() if v is not None})
        return cls.from_dict(with_changes(tables, changes or {}), line(title) or "manipulator")

    def __repr__(self) -> str:
        duration = "free duration" if self.duration is None else f"{self.duration:g} s"
        return f"Problem({self.name!r}, {self.system.kind}, {duration})"

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of a problem file that describes this problem."""
        return dict(plain(self._data))

    def changed(self, changes: Mapping[str, Any]) -> Problem:
        """Return a checked copy of the problem with some keys changed.

        Args:
            changes: Dotted keys and values, for example {"goal.travel": 0.8, "limits.joint_deg":
                60}.

        Raises:
            InputError: As for `from_dict`.
        """
        return Problem.from_dict(with_changes(self.to_dict(), changes), self.source)

    def from_pose(self, theta_deg: ArrayLike) -> Problem:
        """Return the same task for another start pose of the arm, such as one read after homing.

        If no motion from there can keep `limits.z2_margin`, that limit is left out, with an
        `InputWarning`. After homing, angles may be negative, so that z₂ has different signs at
        start and goal; only plans in chained coordinates need the same sign.

        A joint that stands beyond its limit by no more than an encoder's noise is taken to stand at
        the limit.

        Args:
            theta_deg: θ₁ … θₙ, degrees.

        Raises:
            InputError: As for `from_dict`.
        """
        pose, most = plain(theta_deg), np.rad2deg(self.limits.joint[1:]).tolist()
        if isinstance(pose, list) and len(pose) == len(most):
            pose = [
                math.copysign(limit, a)
                if isinstance(a, float | int) and limit < abs(a) <= limit + POSE_NOISE_DEG
                else a
                for a, limit in zip(pose, most, strict=True)
            ]
        changes = {"start.theta_deg": pose}
        there = self.changed({**changes, "limits.z2_margin": None})
        if self.limits.z2_margin is None:
            return there
        try:
            return self.changed(changes)
        except InputError:
            warnings.warn(
                f"{self.source}: limits.z2_margin is left out, since no motion from this pose to"
                " the goal keeps it",
                InputWarning,
                stacklevel=2,
            )
            return there

    def after(self, last: PlanBefore, theta_deg: ArrayLike | None = None) -> Problem:
        """Return the same task for an arm that has just run another plan.

        The start pose is where `last` ends, predicted for its machine, and `machine.start_state` is
        the state of backlash and shafts in which it leaves the arm.

        Args:
            last: A compensated plan of the same arm and machine, or a homing or seating motion.
            theta_deg: θ₁ … θₙ, degrees, as read after that run. Needed after homing and seating,
                which end where the encoders say.

        Raises:
            InputError: If `last` is of another system, is compensated for another machine or does
                not tell its end state, if it needs a pose that is not given; else as for
                `from_pose`.
        """
        state = last.notes.get("end_state")
        if last.problem.system != self.system:
            raise InputError("the last plan is of another arm", self.source)
        there, here = (each.model_dump() for each in (last.problem.machine, self.machine))
        other = [key for key in here if here[key] != there[key] and key != "start_state"]
        if other and "compensation" in last.notes:
            raise InputError(
                "the last plan is compensated for another machine, which differs in"
                f" {', '.join(other)}: plan with the same machine, or home the arm",
                self.source,
            )
        if state is None:
            raise InputError(
                "the last plan does not tell the state in which it leaves the arm: name a plan made"
                " with compensation.on = true, or a homing or seating motion",
                self.source,
            )
        if theta_deg is None:
            theta_deg = last.notes.get("end_theta_deg")
        if theta_deg is None:
            raise InputError(
                "homing and seating end where the encoders say: give the pose read after it, too"
                " (--pose-from)",
                self.source,
            )
        return self.changed({"machine.start_state": state}).from_pose(theta_deg)

    def again(self, last: PlanBefore, theta_deg: ArrayLike) -> Problem:
        """Return the same task once more from the start of a plan, aimed off by the plan's error.

        An arm that is not like its model misses in nearly the same way when it does the same again:
        one emulated arm with inertia, which its machine lacked, from a homed start by 4.0, 1.6 and
        0.5 degrees, at a second goal by 2.4, 1.1 and 0.6. From the end of the last
        run, or homed there, it did not help: that is another motion. An arm that was brought back
        and homed anew stands some degrees from where `last` starts: use
        `task.again(last, end).from_pose(pose)`, which helped in 35 of 36 runs of results/truths.

        Args:
            last: The plan, for this goal or already aimed off.
            theta_deg: θ₁ … θₙ, degrees, as read at the end of its run.

        Raises:
            InputError: If `last` is of another system, or a goal leaves a joint free; else as for
                `from_pose`.
        """
        if last.problem.system != self.system:
            raise InputError("the last plan is of another arm", self.source)
        wanted, aim = (np.rad2deg(each.user_goal[1:]) for each in (self, last.problem))
        pose = floats("theta_deg", theta_deg)
        if pose.shape != wanted.shape or np.isnan([wanted, aim]).any():
            raise InputError(
                "to aim off, goal and reading must tell every joint angle", self.source
            )
        start = np.rad2deg(last.problem.start[1:])
        goal = np.round(aim - (pose - wanted), 6).tolist()
        return self.changed({"goal.theta_deg": goal}).from_pose(start)

    def exchanged(self) -> Problem | None:
        """Return the problem that leads from the goal to the start.

        The systems are driftless, so each motion of one of the two, run backwards with the signs of
        its inputs changed, is a motion of the other. The result is None if the goal leaves a
        coordinate free, or a limit that is not built in reads inputs, whose sign may matter.
        """
        limits = (*self.kind_limits, *self.registered_limits)
        signed = any(each.final or each.reads != {"q"} for each in limits)
        if signed or self.tip or self.system.has_user_coordinates or np.isnan(self.goal).any():
            return None
        total = self.duration or 0.0
        passed = (replace(w, time_s=w.time_s and total - w.time_s) for w in self.waypoints[::-1])
        ends: Any = {"start": self.goal, "user_goal": self.start, "_ends": self._ends[::-1]}
        return replace(self, **ends, waypoints=tuple(passed), _data={"exchanged": self._data})

    def within_reach(self) -> Problem:
        """Return the problem without the obstacles that no link can reach."""
        near = tuple(d for d in self.obstacles if d.values_out_of_reach(self.system) is None)
        return self if len(near) == len(self.obstacles) else replace(self, obstacles=near)

    def with_travel(self, travel: float | None) -> Problem:
        """Return a checked copy with another travel of the first coordinate (None: free).

        The key depends on the system: `goal.travel` for arms, `goal.x_m` for vehicles.

        Raises:
            InputError: As for `from_dict`; or if other keys of the goal determine the travel.
        """
        if not self.travel_key:
            raise InputError("the goal's coordinates determine the travel", self.source)
        return self.changed(self.travel_change(travel))

    def travel_change(self, travel: float | None) -> dict[str, Any]:
        """Return the dotted key that sets the travel, with its value for `travel` (None: free)."""
        key, zero = self.path_key
        return {key: "free" if travel is None else float(self.start[0]) - zero + travel}

    @cached_property
    def goal(self) -> Array:
        """q(T), shape (N,), in the units of `start`; NaN for coordinates that are free."""
        return frozen(self.system.fixed_by(self.user_goal))

    @property
    def travel(self) -> float | None:
        """The travel q₁(T) − q₁(0); None if free."""
        return None if np.isnan(self.goal[0]) else float(self.goal[0] - self.start[0])

    @property
    def travel_key(self) -> str:
        """The dotted key that sets the travel; "" if other keys of the goal determine it."""
        return self.path_key[0]

    @property
    def chart(self) -> ChartDomain:
        """The requirement that motions in chained coordinates stay in the chart's domain."""
        return ChartDomain(tuple(self.start.tolist()))

    @property
    def self_collision(self) -> SelfCollision | None:
        """Least distance between an arm's links; None if they may cross."""
        return next((r for r in self.kind_limits if isinstance(r, SelfCollision)), None)

    @cached_property
    def demands(self) -> tuple[Demand, ...]:
        """All conditions on a plan, one object per kind: ends, limits, waypoints, obstacles.

        A condition with `in_chart` applies only to plans in chained coordinates.
        """
        limits, system = self.limits, self.system
        beside = limits.user.copy()
        beside[list(system.shared)] = np.inf  # JointLimit covers these
        inner = set(range(system.size)) - set(system.shared.values())
        demands: list[Demand] = [
            Start(self._ends[0]),
            Goal(system.coordinates, tuple(sorted({*self.free, *inner})), self._ends[1]),
            self._goal_beside(np.flatnonzero(~np.isnan(self.user_goal)).tolist()),
        ]
        if self.tip is not None:
            demands.append(self.tip)
        if self.duration is not None:
            demands.append(Duration(self.duration))
        if self.duration_max is not None:
            demands.append(LongestDuration(self.duration_max))
        demands += [
            self.chart,
            InputLimit(system.inputs, tuple(limits.input.tolist()), limits.input_keys),
            RateLimit(system.inputs, tuple(limits.input_rate.tolist()), limits.rate_keys),
            JointLimit(system.coordinates, tuple(limits.joint.tolist()), limits.joint_keys),
            UserLimit(system.user_coordinates, tuple(beside.tolist()), limits.user_keys),
        ]
        if limits.z2_margin is not None:
            demands.append(Z2Margin(limits.z2_margin, int(self.z2_sign)))
        demands += [*self.kind_limits, *self.registered_limits, *self.waypoints, *self.obstacles]
        return tuple(each for each in demands if each.parts)

    @cached_property
    def requirements(self) -> tuple[Requirement, ...]:
        """The conditions that apply at all times of a motion."""
        return tuple(d for d in self.demands if isinstance(d, Requirement) and not d.final)

    @cached_property
    def final(self) -> tuple[Requirement, ...]:
        """Conditions that apply only at the end, without `UserGoal` if the goal gives all of q."""
        every = (d for d in self.demands if isinstance(d, Requirement) and d.final)
        whole = not np.any(np.isnan(self.user_goal))  # then the goal gives all of q
        return tuple(d for d in every if not (whole and isinstance(d, UserGoal)))

    @cached_property
    def on_the_way(self) -> UserGoal:
        """`UserGoal` with a row for each non-triangular user coordinate that a waypoint gives."""
        return self._goal_beside(sorted({i for point in self.waypoints for i in point.beside_q}))

    def _goal_beside(self, which: Iterable[int]) -> UserGoal:
        """Return the goal of the user coordinates with indices `which`, without triangular ones."""
        indices = tuple(i for i in which if i not in self.system.shared)
        every = self.system.user_coordinates
        targets = tuple(float(self.user_goal[i]) for i in indices)
        return UserGoal(tuple(every[i] for i in indices), indices, targets)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Indices of the joints that the goal leaves free, from 1; usually empty."""
        return tuple((np.flatnonzero(np.isnan(self.goal[1:])) + 1).tolist())

    @property
    def free_within(self) -> Array:
        """Largest |q| at the goal of each free joint (for an arm |θ|, radians)."""
        if self.system.has_user_coordinates:
            return self.limits.joint[list(self.free)]
        return np.minimum(self.limits.joint[list(self.free)], WIDEST_FREE_JOINT_RAD)

    @property
    def divided(self) -> bool:
        """Whether paths can pass a requirement on different sides, so that several optima exist."""
        return any(requirement.divides for requirement in self.requirements)

    def reads(self, name: str) -> bool:
        """Return whether any requirement depends on the argument `name`: "q", "u" or "du"."""
        return any(name in requirement.reads for requirement in self.requirements)

    def rests(self, option: Rest) -> bool:
        """Return whether inputs are zero at both ends, as the option `rest` of a method asks; with
        "auto" they are if an input rate has a limit."""
        return bool(np.isfinite(self.limits.input_rate).any()) if option == "auto" else option

    def expecting(self, goal: Array) -> Problem:
        """Return a copy with an expected q(T), `goal` (N,), from which a search can start."""
        return replace(self, _hint=goal)

    @cached_property
    def likely(self) -> Problem:
        """The problem with the expected q(T) as its goal; this problem if nothing is expected."""
        if self._hint is None:
            return self
        goal = np.where(np.isnan(self._hint), self.goal, self._hint)
        return replace(self, user_goal=self.system.user(goal), tip=None, _hint=None)

    def settled(self, end: Array) -> Problem:
        """Return the problem with the joints of `end` (N,) as its goal; itself if none is free.

        Raises:
            InputError: As for `from_dict`.
        """
        if not self.free:
            return self
        changes = {"goal.theta_deg": np.rad2deg(end[1:]).tolist()}
        return self.changed({**changes, "goal.tip_m": None, "goal.tip_angle_deg": None})

    @property
    def branch(self) -> Array:
        """The chart's branch at the start, shape (N,)."""
        return self.system.branch(self.start)

    @cached_property
    def z2_sign(self) -> float:
        """Sign of z₂ at the start."""
        return float(np.sign(chained_form(self.system).z(self.start)[1]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Problem) and self._data == other._data

    def __hash__(self) -> int:
        return hash(hashable(self._data))


AnyProblem = Problem | str | Path | Mapping[str, Any]
"""A problem, the file that holds one, or its tables."""


def problem_of(value: AnyProblem) -> Problem:
    """Return the problem itself, or read it from its file or tables.

    Raises:
        InputError: If the value is none of these, or see `load_problem`.
    """
    if isinstance(value, str | Path | Mapping):
        return load_problem(value)
    expect(Problem, value, "planner.load_problem(path) reads one")
    return value


def load_problem(
    source: str | Path | Mapping[str, Any], changes: Mapping[str, Any] | None = None
) -> Problem:
    """Read a problem from a file, or from its tables.

    Args:
        source: A TOML file, or its tables as a dictionary; `planner schema` prints the keys.
        changes: Dotted keys and values that replace those of the file; None removes a key.

    Raises:
        InputError: If the file is missing, not TOML, or has an invalid key or value.
    """
    if isinstance(source, Mapping):
        return Problem.from_dict(source).changed(changes or {})
    data = read_toml(source, "a problem file")
    if not data:
        raise InputError(f"{source} is empty; a problem needs [system], [start] and [goal]")
    return Problem.from_dict(with_changes(data, changes or {}), str(source))
