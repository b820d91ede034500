"""A design file: mechanisms, tasks, and the figures that compare the mechanisms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from planner.errors import InputError
from planner.machine.machine import Machine
from planner.methods.registry import parse_specs
from planner.plan.plan import COMPENSATED
from planner.problem.conditions import with_changes
from planner.problem.problem import Problem
from planner.problem.tables.arms import GearTable, Joints
from planner.problem.tables.problem_file import AngleDeg
from planner.support.arrays import Frozen
from planner.support.files import read_toml
from planner.support.tables import line, number
from planner.support.user_tables import Positive, Table, allowed_hint, parse
from planner.sweep.description import base_problem, plain_tables
from planner.sweep.design.figures import CONTACT_LOAD, DesignFigure, figures_of
from planner.sweep.design.geometry import Design, design, gear_of, gear_table
from planner.sweep.sweep_file import Point, Range, SweepFile, Whole, points, varied_keys
from planner.systems.manipulator import Gear, Manipulator, stage_gears

MAX_TASKS = 1000
AngleRange = Annotated[list[AngleDeg], Field(min_length=2, max_length=2)]


class VariablesTable(Table):
    """Design variables of a mechanism; each variable that is not given is as in `[gear]`."""

    rho: Positive | None = None
    """r1/(lambda R); sets r1."""
    kappa: Positive | None = None
    """lambda R/(eta r3); sets r3."""
    r1: Positive | None = None
    """Radius of disk B."""
    R: Positive | None = None
    """From the axle of disk A to its driving contact."""
    r3: Positive | None = None
    """From the axle of disk A' to the joint's contact."""
    lam: Positive | None = Field(None, alias="lambda")
    """Bevel and spur gear ratio."""
    eta: Positive | None = None
    """Timing belt ratio."""
    joints: Joints | None = None
    """Number of joints."""
    contact_force_n: Positive | None = None
    """Friction force mu N of one contact in N, with lengths in metres."""
    link_lengths: list[Positive] | None = None
    """Distances between joints and to the tip, in the unit of the radii."""

    @model_validator(mode="after")
    def _check_ratios(self) -> VariablesTable:
        for ratio, radius in (("rho", "r1"), ("kappa", "r3")):
            if getattr(self, ratio) is not None and getattr(self, radius) is not None:
                raise ValueError(f"{ratio} sets {radius}; give one of the two")
        return self


VARIABLES = [field.alias or name for name, field in VariablesTable.model_fields.items()]


class PairTable(Table):
    """One task of a design study: start and goal."""

    start_deg: list[AngleDeg]
    """Joint angles at the start, degrees."""
    goal_deg: list[AngleDeg]
    """Joint angles at the goal, degrees."""


class TasksTable(Table):
    """Tasks of a design study: pairs of start and goal, given or drawn."""

    pairs: list[PairTable] = Field(default_factory=list, max_length=MAX_TASKS)
    """Given pairs."""
    count: Annotated[int, Field(ge=1, le=MAX_TASKS)] | None = None
    """Number of pairs to draw; a larger number starts with the same pairs."""
    seed: Whole = 0
    """Seed of the draws."""
    start_deg: AngleRange | None = None
    """[low, high]: start of every joint, degrees, uniform."""
    goal_deg: AngleRange | None = None
    """[low, high]: goal of every joint, degrees, uniform."""

    @model_validator(mode="after")
    def _check_source(self) -> TasksTable:
        drawn = self.count is not None
        if drawn == bool(self.pairs):
            raise ValueError("give either pairs, or count with start_deg and goal_deg")
        for name in ("start_deg", "goal_deg"):
            box = getattr(self, name)
            if drawn != (box is not None):
                raise ValueError(
                    f"{name} = [low, high] is needed to draw {self.count} pairs"
                    if drawn
                    else f"{name} is for drawn pairs; leave it out or give count"
                )
            if box is not None and not box[0] < box[1]:
                raise ValueError(f"{name} = {box}: the first must be the lower")
        return self


class MachinesTable(Table):
    """Emulated machines on which every plan is replayed."""

    samples: Annotated[int, Field(ge=2, le=100_000)] = 50
    """Machines per plan."""
    seed: Whole = 0
    """Seed of the machines, the same for every design."""


class DesignFile(Table):
    """The tables of a design file.

    The designs are all combinations of the rows of `cases` and the values of `grid`. Lengths share
    one unit.
    """

    title: str = ""
    """The question of the study, one line."""
    problem: str | dict[str, Any]
    """Common to all designs: a problem file of an arm with friction disks, relative to the design
    file, or its tables. Its duration, limits and machine apply to every task; without [tasks], its
    start and goal are the only task."""
    changes: dict[str, Any] = Field(default_factory=dict, alias="set")
    """Dotted keys of the problem to change."""
    methods: Annotated[list[str], Field(min_length=1)] = Field(
        default_factory=lambda: ["collocation", "polynomial"]
    )
    """Methods. The figures describe the plans of the first method; for the others only the number
    of solved tasks is given."""
    compensated: bool = True
    """Whether to compensate the first method's plans for the machine too."""
    gear: GearTable | None = None
    """The base mechanism of all designs. Default: the problem's; for a problem that gives K and
    k_g, a mechanism with lambda = eta = R = 1 and the same kinematics."""
    present: bool = True
    """Whether the study includes the base mechanism itself."""
    cases: list[dict[str, Any]] = Field(default_factory=list)
    """Rows of design variables that go together."""
    grid: dict[str, Annotated[list[Any], Field(min_length=1)] | Range] = Field(
        default_factory=dict,
        description=f"Design variables ({', '.join(VARIABLES)}), each with a list of values or a"
        " range.",
    )
    clearance: Annotated[float, Field(ge=0)] = 0.0
    """Clearance that disks and wheels need beyond their radii."""
    contact_force_n: Positive | None = None
    """Friction force mu N of one contact in N, with lengths in metres: a contact of a design
    transmits this times r1. Default: every design has the same capacity,
    machine.friction_capacity_nm, as if contacts of smaller disks were pressed harder."""
    tasks: TasksTable | None = None
    """The tasks of the arm."""
    replay: MachinesTable = Field(default_factory=MachinesTable)
    front: Annotated[list[str], Field(min_length=1, max_length=6)] | None = None
    """Figures to trade off: the Pareto front and the recommendation use these. Default: the error
    at the end (compensated, if plans are), motor torque, motor power and contact_load."""


Task = tuple[list[float], list[float]]
"""One task of a design study: joint angles at the start and at the goal, in degrees."""


@dataclass(frozen=True, eq=False)
class StudyInput(Frozen):
    """The contents of a design file, read and checked.

    Attributes:
        title: The question of the study.
        source: The file, or a name for messages.
        table: The file's tables.
        base: The problem that all designs share.
        designs: The mechanisms, including those that cannot be built.
        tasks: The tasks by number of joints.
        methods: The methods in the file; if plans are compensated, then the first method once
            more, with compensation.
        figures: The criteria that compare the designs.
        front_by: The criteria to trade off.
    """

    title: str
    source: str
    table: DesignFile
    base: Problem
    designs: tuple[Design, ...]
    tasks: Mapping[int, tuple[Task, ...]]
    methods: tuple[str, ...]
    figures: tuple[DesignFigure, ...]
    front_by: tuple[DesignFigure, ...]

    @property
    def reaching(self) -> str:
        """The method whose plans count as solving a task: the first, compensated if requested."""
        return self.methods[-1] if self.table.compensated else self.methods[0]

    @property
    def pairs(self) -> list[tuple[Design, Task]]:
        """The pairs that each method plans: every task on every design that can be built."""
        built = [each for each in self.designs if not each.refused]
        return [(each, task) for each in built for task in self.tasks[each.joints]]

    def changes(self, design: Design, task: Task) -> dict[str, Any]:
        """Return the dotted keys of the problem that set a design and a task."""
        out = {
            "system.joints": design.joints,
            "system.gear": gear_table(design.gear),
            "system.link_lengths": list(design.link_lengths or (1.0,) * design.joints),
            "start.theta_deg": task[0],
            "goal.theta_deg": task[1],
        }
        force = design.values.get("contact_force_n", self.table.contact_force_n)
        if force is not None:
            # Keep the relative spread of the problem's machine.
            capacity = Machine.from_table(self.base.machine).effects.get("friction_capacity_nm")
            spread = capacity.spread[0] / capacity.value[0] if capacity is not None else 0.0
            torque = force * design.gear.r1
            out["machine.friction_capacity_nm"] = {"value": torque, "spread": spread * torque}
        return out

    def problem_of(self, design: Design, task: Task) -> Problem:
        """Return the problem of one task on one design.

        Raises:
            InputError: If the problem is invalid.
        """
        tables = {**self.base.to_dict(), "system": {"kind": Manipulator.kind}}
        return Problem.from_dict(with_changes(tables, self.changes(design, task)), self.source)

    def sweep(self) -> dict[str, Any]:
        """Return the tables of the sweep that plans all `pairs`."""
        return {
            "title": self.title,
            "problem": self.problem_of(*self.pairs[0]),
            "methods": list(self.methods),
            "cases": [self.changes(*pair) for pair in self.pairs],
            "replay": self.table.replay.model_dump(),
        }


def read_design(source: Mapping[str, Any] | str | Path) -> StudyInput:
    """Read and check a design file or its tables, before anything is planned.

    Raises:
        InputError: If a key or value is wrong, nothing varies, a variable or figure does not exist,
            a variable has an impossible value, or no design can be built.
    """
    origin = "design" if isinstance(source, Mapping) else str(source)
    data = source if isinstance(source, Mapping) else read_toml(source, "a design file")
    table = parse(DesignFile, plain_tables(data), origin)
    base = base_problem(data["problem"], table.changes, origin)
    system = _check_arm(base, origin)
    specs = parse_specs(base, table.methods)
    if any(spec.compensated for spec in specs):
        raise InputError(
            f"{origin}: name methods without '{COMPENSATED}'; compensated = true adds them"
        )
    methods = [spec.label for spec in specs]
    if table.compensated:
        methods.append(replace(specs[0], compensated=True).label)
    figures = {figure.key: figure for figure in figures_of(methods, table.compensated)}
    # Not the effort, which depends on rates only: a gear that turns the disks less has less effort,
    # whatever torque the motor needs.
    end = "compensated_end_deg" if table.compensated else "end_deg"
    front = table.front or [end, "motor_torque_nm", "motor_power_w", CONTACT_LOAD]
    for key in front:
        if key not in figures:
            raise InputError(
                f"{origin}: front: unknown figure '{key}'; {allowed_hint(key, [*figures])}"
            )
        if front.count(key) > 1:
            raise InputError(f"{origin}: front names '{key}' twice")
    designs = _designs(table, base, system, origin)
    if all(each.refused for each in designs):
        why = designs[0]
        raise InputError(f"{origin}: no design can be built; {why.name}: {why.refused}")
    joints = sorted({each.joints for each in designs})
    return StudyInput(
        title=line(table.title) or line(Path(origin).stem),
        source=origin,
        table=table,
        base=base,
        designs=designs,
        tasks={n: _tasks(table.tasks, base, n, origin) for n in joints},
        methods=tuple(methods),
        figures=tuple(figures.values()),
        front_by=tuple(figures[key] for key in front),
    )


def _check_arm(base: Problem, source: str) -> Manipulator:
    """Return the arm of the base problem; refuse a problem that fits only one mechanism."""
    if not isinstance(base.system, Manipulator):
        raise InputError(
            f"{source}: the mechanism of system.kind = '{base.system.kind}' has no friction"
            " disks; a design study needs a 'manipulator'"
        )
    if base.travel is not None:
        raise InputError(
            f"{source}: goal.travel = {base.travel:.4g} of the problem suits one mechanism only;"
            ' leave it free, as in set = { "goal.travel" = "free" }'
        )
    if "tip_m" in base.to_dict()["goal"]:
        raise InputError(
            f"{source}: goal.tip_m of the problem suits the links of one mechanism only; give"
            " goal.theta_deg instead"
        )
    return base.system


def _designs(
    table: DesignFile, base: Problem, system: Manipulator, source: str
) -> tuple[Design, ...]:
    rows = SweepFile.model_construct(problem="", methods=[], cases=table.cases, grid=table.grid)
    varied = varied_keys(rows)
    if not varied:
        raise InputError(
            f"{source}: the file names no design; give [grid] or [[cases]], as in [grid]"
            " rho = [0.8, 1.0]"
        )
    forced = table.contact_force_n is not None or "contact_force_n" in varied
    gear, links = _present_mechanism(table, base, system, source, forced)

    def make(name: str, values: Point) -> Design:
        n = values.get("joints", system.n)
        lengths = values.get("link_lengths", links if n == system.n else None)
        if lengths is not None and len(lengths) != n:
            raise InputError(
                f"{source}: design {name}: link_lengths has {len(lengths)} values for {n} joints"
            )
        bends = base.limits.joint[1:]  # infinite without a limit
        bends = bends if len(bends) == n else np.full(n, float(np.max(bends)))
        return design(name, values, gear_of(values, gear), bends, lengths, table.clearance)

    out = []
    for point in points(rows, source):
        name = ", ".join(f"{key} = {_value_text(value)}" for key, value in point.items())
        parse(VariablesTable, point, f"{source}: design {name}")
        out.append(make(name, point))
    present = make("as it is", {})
    if table.present and not any(
        each.joints == system.n
        and "contact_force_n" not in each.values
        and np.allclose(astuple(each.gear), astuple(gear), rtol=1e-9)
        for each in out
    ):
        out.insert(0, present)
    return tuple(out)


def _present_mechanism(
    table: DesignFile, base: Problem, system: Manipulator, source: str, forced: bool
) -> tuple[Gear, Any]:
    """Return the gear and the link lengths of the base mechanism.

    None replaces lengths that are not in the unit of the gear's radii. `forced` tells whether the
    study gives contact forces, which need radii in metres.
    """
    if table.gear is not None:
        try:
            return table.gear.stages(1)[0], None
        except ValueError:
            raise InputError(
                f"{source}: in a design study all stages are equal: give numbers, not lists, in"
                " [gear]"
            ) from None
    (gear, *others), _ = stage_gears(system)
    radii = [g.r3 for g in (gear, *others)]
    if max(radii) > min(radii) * (1 + STAGE_TOLERANCE):
        raise InputError(
            f"{source}: the problem's K belong to stages of different radii; give the base"
            " mechanism in the table [gear]"
        )
    if system.gear is not None:
        return gear, base.to_dict()["system"].get("link_lengths")
    if forced:
        raise InputError(
            f"{source}: contact_force_n needs radii in metres; give the table [gear] of the"
            " mechanism"
        )
    return gear, None


STAGE_TOLERANCE = 1e-4
"""Relative difference of radii above which stages differ; ratios in files have six digits."""


def _value_text(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_value_text, value)) + "]"
    return number(float(value), 4) if isinstance(value, int | float) else str(value)


def _tasks(table: TasksTable | None, base: Problem, joints: int, source: str) -> tuple[Task, ...]:
    if table is None:
        tables = base.to_dict()
        pairs = [(tables["start"]["theta_deg"], tables["goal"]["theta_deg"])]
    elif table.count is not None:
        boxes: Any = [[table.start_deg], [table.goal_deg]]
        low, high = np.moveaxis(np.array(boxes), -1, 0)
        rng = np.random.default_rng([table.seed, joints])
        ends = np.round(rng.uniform(low, high, (table.count, 2, joints)), 2)
        pairs = [(start, goal) for start, goal in ends.tolist()]
    else:
        pairs = [(pair.start_deg, pair.goal_deg) for pair in table.pairs]
    for k, task in enumerate(pairs):
        for name, angles in zip(("start_deg", "goal_deg"), task, strict=True):
            if len(angles) != joints:
                raise InputError(
                    f"{source}: task {k + 1}: {name} has {len(angles)} angles, and a design has"
                    f" {joints} joints; draw tasks with 'count', or make one study for each number"
                    " of joints"
                )
    return tuple(pairs)
