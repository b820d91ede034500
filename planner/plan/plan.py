"""The plan: the result of every method.

The tables of a plan file (JSON).
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator

from planner.errors import InputError, expect, made_by
from planner.plan.claims import Certificate, certificate_from_dict
from planner.plan.measures import DomainReport, domain_report
from planner.plan.trajectory import Trajectory, trajectory_from_dict
from planner.problem.problem import Problem
from planner.support.arrays import Array, jsonable
from planner.support.files import read_json, write_text
from planner.support.package import handed_to
from planner.support.tables import line
from planner.support.user_tables import Table, parse

if TYPE_CHECKING:
    import pandas
    import xarray

FORMAT = "planner-plan"
VERSION = 1

ROUNDING = 1e-9
"""Part of the duration (of a second, if that is more) by which a time may lie outside a plan: sums
of thousands of steps are off by less."""


@made_by("planner.solve(problem, method) or planner.load_plan(path)")
@dataclass(frozen=True, eq=False)
class Plan:
    """A motion from start to goal that evaluates at any time.

    `t`, `q(t)`, `u(t)`, `z(t)` and `v(t)` use the method's own interpolant; see `Trajectory`.

    Before 0 and after `duration` the plan is at rest: coordinates are those of its ends, inputs are
    zero. Evaluating it there gives a RuntimeWarning; its `trajectory` gives none.

    Two plans are equal if they have the same motion, problem, method, options and verdict.
    Computing times do not count.

    Attributes:
        problem: The problem it solves.
        method: Name of the method that made it.
        options: The method's options, as used.
        trajectory: The curve itself.
        status: "solved", or why it is not a valid plan ("singular", "not_converged", …).
        objective: Value of the method's objective.
        objective_name: Name of the objective ("effort: integral of u1^2 + u2^2 dt").
        solve_time_s: Seconds the method spent solving.
        build_time_s: Seconds it spent on building the optimisation problem (zero if reused).
        iterations: Iterations of its solver; 0 for closed-form methods.
        verified: Whether the independent verification passed (set by `solve`).
        notes: Further facts from the method, JSON-ready (the first guess used, constraint points,
            …).
        certificate: What is proven about it between the nodes (set by `solve`; see `certify`).
        why: If a plan was read from a file that calls it verified and is not: what it breaks, in
            one line. Otherwise empty.
        compensation: For a compensated plan, its original plan and machine (set by `compensate`);
            else None.
    """

    problem: Problem
    method: str
    options: Mapping[str, Any]
    trajectory: Trajectory
    status: str = "solved"
    objective: float = float("nan")
    objective_name: str = ""
    solve_time_s: float = 0.0
    build_time_s: float = 0.0
    iterations: int = 0
    verified: bool = False
    notes: Mapping[str, Any] = field(default_factory=dict)
    certificate: Certificate | None = None
    why: str = ""
    compensation: Compensation | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plan) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash((self.problem, self.method, self.trajectory))

    @property
    def _identity(self) -> tuple[Any, ...]:
        own = (self.problem, self.method, self.trajectory, self.status, self.verified)
        return *own, jsonable(self.options), self.compensation

    def __repr__(self) -> str:
        state = "verified" if self.verified else f"not verified, status {self.status}"
        state += f": {self.why}" if self.why else ""
        name = self.method
        if self.compensation is not None:
            name += " compensated"
            state += " on the nominal machine" if self.verified else ""
        moved = f"{self.travel:.4g} {self.problem.system.coordinates[0].unit}"
        return f"Plan({name}: travel {moved} in {self.duration:.4g} s, {state})"

    @property
    def compensates(self) -> Plan | None:
        """The original plan of a compensated plan; None for all others."""
        return None if self.compensation is None else self.compensation.plan

    @property
    def lead_s(self) -> float:
        """Duration of a compensated plan's preparatory motion, in seconds; else 0."""
        return 0.0 if self.compensation is None else self.compensation.lead_s

    @property
    def tail_s(self) -> float:
        """Time that a compensated plan continues after the end of the original plan, s."""
        return 0.0 if self.compensation is None else self.compensation.tail_s

    def wanted(self, t: ArrayLike) -> Array:
        """Desired coordinates (…, N) at times t (…), against which errors are measured.

        Those of the plan itself. For a compensated plan, those of the original plan, shifted by
        `lead_s`, and NaN during the preparatory motion.
        """
        if self.compensates is None:
            return self.trajectory.q(t)
        own = np.asarray(t, dtype=float) - self.lead_s
        early = own < -ROUNDING * max(1.0, self.duration)
        return np.where(early[..., None], np.nan, self.compensates.trajectory.q(own))

    @property
    def t(self) -> Array:
        """Times between which the motion is smooth, shape (K+1,), seconds."""
        return self.trajectory.breaks

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return self.trajectory.duration

    @property
    def travel(self) -> float:
        """q₁(T) − q₁(0), radians for the manipulator."""
        return float(self.z(self.duration)[0] - self.z(0.0)[0])

    @cached_property
    def domain(self) -> DomainReport:
        """Position relative to the chart's domain over all time."""
        return domain_report(self.trajectory)

    @property
    def executable(self) -> bool:
        """Whether real coordinates and inputs exist at all times."""
        return self.trajectory.in_coordinates or self.domain.ok

    def q(self, t: ArrayLike) -> Array:
        """Coordinates, shape (…, N), at times t (…); RuntimeWarning outside [0, duration]."""
        return self.trajectory.q(self._times(t))

    def u(self, t: ArrayLike) -> Array:
        """Inputs, shape (…, 2), at times t (…); outside as `q`."""
        return self.trajectory.u(self._times(t))

    def z(self, t: ArrayLike) -> Array:
        """Chained coordinates, shape (…, N), at times t (…); outside as `q`."""
        return self.trajectory.z(self._times(t))

    def v(self, t: ArrayLike) -> Array:
        """Chained inputs, shape (…, 2), at times t (…); outside as `q`."""
        return self.trajectory.v(self._times(t))

    def _times(self, t: ArrayLike) -> Array:
        """The times, those outside by rounding alone at its ends; with a warning of others."""
        times, slack = np.asarray(t, dtype=float), ROUNDING * max(1.0, self.duration)
        outside = (times < -slack) | (times > self.duration + slack)
        if np.any(outside):
            warnings.warn(
                f"t = {times[outside].flat[0]:.6g} s lies outside the plan, which lasts from 0"
                f" to {self.duration:.6g} s; outside it is at rest (plan.trajectory.q and .u"
                " give the same without this warning)",
                RuntimeWarning,
                stacklevel=3,
            )
        return np.where(outside, times, times.clip(0.0, self.duration))

    def save(self, path: str | Path) -> Path:
        """Write the plan as versioned JSON; `load_plan` gives it back exactly.

        Raises:
            InputError: If the file cannot be written; no partial file is left.
        """
        return write_text(
            path, json.dumps(jsonable(self._to_dict()), indent=1, allow_nan=False) + "\n"
        )

    def _to_dict(self) -> dict[str, Any]:
        data = {
            "format": FORMAT,
            "version": VERSION,
            "problem": self.problem.to_dict(),
            "source": self.problem.source,
            "method": self.method,
            "options": dict(self.options),
            "status": self.status,
            "objective": self.objective,
            "objective_name": self.objective_name,
            "solve_time_s": self.solve_time_s,
            "build_time_s": self.build_time_s,
            "iterations": self.iterations,
            "verified": self.verified,
            "notes": dict(self.notes),
            "certificate": None if self.certificate is None else self.certificate.to_dict(),
            "trajectory": self.trajectory.to_dict(),
        }
        if self.why:
            data["why"] = self.why
        if self.compensation is not None:
            data["compensation"] = {
                "plan": self.compensation.plan._to_dict(),
                "machine": dict(self.compensation.machine),
                "lead_s": self.lead_s,
                "tail_s": self.tail_s,
            }
        return data

    def to_frame(self, rate_hz: float = 100.0) -> pandas.DataFrame:
        """The plan at evenly spaced times as a pandas DataFrame; see
        `planner.plan.samples.to_frame`."""
        frame: pandas.DataFrame = handed_to("planner.plan.samples.to_frame")(self, rate_hz)
        return frame

    def to_xarray(self, rate_hz: float = 100.0) -> xarray.Dataset:
        """The plan at evenly spaced times as an xarray Dataset; see
        `planner.plan.samples.to_xarray`."""
        dataset: xarray.Dataset = handed_to("planner.plan.samples.to_xarray")(self, rate_hz)
        return dataset


@dataclass(frozen=True)
class Compensation:
    """What a compensated plan was made from.

    Attributes:
        plan: The plan as the kinematics say.
        machine: The `[machine]` table of the machine that is allowed for, complete.
        lead_s: How long the commands prepare before that plan starts, s.
        tail_s: How long they go on after it has ended, s.
    """

    plan: Plan
    machine: Mapping[str, Any]
    lead_s: float
    tail_s: float


def expect_plan(value: object) -> None:
    """Refuse what is no plan, such as the name of its file.

    Raises:
        InputError: If it is none; the message says how to get one.
    """
    how = "planner.solve(problem, method) makes one and planner.load_plan(path) reads one"
    expect(Plan, value, how)


def refuse_compensated(plan: Plan, what: str) -> None:
    """Refuse a compensated plan, whose inputs are those of a machine and not of the kinematics.

    Raises:
        InputError: If it is one, or no plan; the message names what does not take it.
    """
    expect_plan(plan)
    if plan.compensation is not None:
        raise InputError(
            f"{what} needs a plan whose inputs follow the kinematics, but this one is"
            " compensated for a machine; use the original plan, plan.compensates"
        )


def read_plan(path: str | Path) -> Plan:
    """What a file of `Plan.save` says, believed as it stands; `planner.load_plan` judges it.

    Raises:
        InputError: If the file is missing, is not a plan, or has a newer version.
    """
    return _plan(_read(path), path)


def _plan(data: Mapping[str, Any], path: str | Path) -> Plan:
    problem = Problem.from_dict(data["problem"], data["source"])
    if made_from := data.get("compensation"):
        parse(PlanFile, made_from["plan"], f"{path}, the plan that it compensates")
        made_from = Compensation(
            _plan(made_from["plan"], path),
            made_from["machine"],
            made_from["lead_s"],
            made_from["tail_s"],
        )
    try:
        return Plan(
            problem=problem,
            trajectory=trajectory_from_dict(problem.system, data["trajectory"]),
            certificate=_certificate(data.get("certificate")),
            why="" if data["verified"] else data.get("why", ""),
            compensation=made_from,
            **{key: _read_back(data[key]) for key in _COPIED},
        )
    except (KeyError, TypeError) as error:
        raise InputError(f"{path} is not a complete plan file: {error!r}") from None
    except ValueError as error:
        raise InputError(f"{path} holds no trajectory of this problem: {error}") from None


_COPIED = (
    "method",
    "options",
    "status",
    "objective",
    "objective_name",
    "solve_time_s",
    "build_time_s",
    "iterations",
    "verified",
    "notes",
)


def _certificate(data: Mapping[str, Any] | None) -> Certificate | None:
    return None if data is None else certificate_from_dict(data)


def _read_back(value: Any) -> Any:
    """A number that is not defined is null in the file; nothing else is. Texts are for show."""
    if isinstance(value, str):
        return line(value)
    return float("nan") if value is None else value


def _read(path: str | Path) -> dict[str, Any]:
    data = read_json(path, "`planner plan PROBLEM --out FILE` writes a plan file")
    if data.get("format") != FORMAT:
        raise InputError(f"{path} is not a plan file (its 'format' is not '{FORMAT}')")
    if data.get("version") != VERSION:
        raise InputError(f"{path} has version {data.get('version')}; this planner reads {VERSION}")
    parse(PlanFile, data, str(path))
    return data


Number = float | None
"""A number; null where it is not defined."""


class CurveTable(Table):
    """A piecewise polynomial in the Bernstein basis.

    On [breaks[k], breaks[k+1]], with x from 0 to 1 in it, component i is the sum over a of
    bernstein[a][k][i] C(d, a) x^a (1-x)^(d-a), where d is the degree; a scalar curve has no [i].
    """

    breaks: Annotated[list[float], Field(min_length=2)] = Field(description="K+1 increasing times.")

    @field_validator("breaks")
    @classmethod
    def _increase(cls, breaks: list[float]) -> list[float]:
        if not all(a < b < 1e15 for a, b in pairwise(breaks)):
            raise ValueError("times must increase, and stay below 1e15 s")
        return breaks

    bernstein: list[list[Number | list[Number]]] = Field(
        description="Coefficients: degree + 1 lists of K pieces, each a list of components."
    )


class ChainedTable(Table):
    """A curve given in chained coordinates."""

    kind: Literal["chained"]
    branch: list[float] = Field(description="Signs (N) of the chart's branch.")
    z: CurveTable = Field(description="z1 ... zN over time in s.")
    v: CurveTable = Field(description="v1, v2 over time in s.")


class StateTable(Table):
    """A curve given in coordinates and inputs."""

    kind: Literal["state"]
    q: CurveTable = Field(description="q1 ... qN in rad or m over time in s.")
    u: CurveTable = Field(description="u1, u2 in rad/s or m/s over time in s.")


class RetimedTable(Table):
    """A curve with another clock."""

    kind: Literal["retimed"]
    path: TrajectoryTable
    length: CurveTable = Field(description="Length along the path over the path's own time.")
    clock: CurveTable = Field(description="Length over time in s.")
    stations: list[float] = Field(description="The path's own time at the breaks of the clock.")


TrajectoryTable = Annotated[
    Union[ChainedTable, StateTable, RetimedTable],  # noqa: UP007
    Field(discriminator="kind"),
]


class ClaimTable(Table):
    """One requirement over all time."""

    label: str = Field(description="What is required, as in 'joint theta3'.")
    status: Literal["proven", "undecided", "violated"]
    guaranteed: Number = Field(description="The margin is nowhere less; null: nothing is known.")
    attained: Number = Field(description="The margin is this small, or smaller, at time_s.")
    time_s: Number = Field(description="When the margin is least, as far as known.")
    unit: str = Field(description="Unit of the margin.")
    required: bool = Field(description="Whether the problem asks for it.")
    why: str = Field(description="What kept it from being decided.")
    text: str = Field(description="The same in words.")


class CertificateTable(Table):
    """What is proven of the plan over whole intervals."""

    ok: bool = Field(description="Whether everything required is proven.")
    text: str = Field(description="The same in words.")
    claims: list[ClaimTable]
    motion_error: dict[str, Number] = Field(
        description="Proven bound on |q(t) - true motion|, by coordinate; null: none."
    )
    cells: int = Field(description="Subintervals the proof rests on.")
    seconds: float = Field(description="How long it took.")


class PlanFile(Table):
    """A plan as `Plan.save` writes it. Angles are in radians, times in seconds."""

    format: Literal["planner-plan"]
    version: Literal[1] = Field(description="Version of this form.")
    problem: dict[str, Any] = Field(description="The tables of the problem file.")
    source: str = Field(description="Where the problem came from.")
    method: str = Field(description="Method that made it.")
    options: dict[str, Any] = Field(description="The method's options, as used.")
    status: str = Field(description="'solved', or what kept it from being a plan.")
    objective: Number = Field(description="Value of the method's objective.")
    objective_name: str = Field(description="What that objective is.")
    solve_time_s: Number = Field(description="Time the method spent solving.")
    build_time_s: Number = Field(description="Time it spent preparing.")
    iterations: int = Field(description="Iterations of its solver, 0 for closed forms.")
    verified: bool = Field(description="Whether the independent check passed.")
    notes: dict[str, Any] = Field(description="Further facts of the method.")
    certificate: CertificateTable | None = Field(
        None, description="What is proven of it between the nodes; null: not examined."
    )
    why: str = Field("", description="What a plan that was read as verified breaks.")
    trajectory: TrajectoryTable = Field(description="The curve itself.")
    compensation: CompensationOfTable | None = Field(
        None, description="Of a compensated plan what it was made from."
    )


class CompensationOfTable(Table):
    """What a compensated plan was made from."""

    plan: dict[str, Any] = Field(description="The plan as the kinematics say, as a plan file.")
    machine: dict[str, Any] = Field(description="The [machine] table that is allowed for.")
    lead_s: Annotated[float, Field(ge=0)] = Field(
        description="How long the commands prepare before that plan starts."
    )
    tail_s: Annotated[float, Field(ge=0)] = Field(
        description="How long they go on after that plan has ended."
    )


def plan_schema(problem: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a plan file.

    Args:
        problem: JSON Schema of a problem file.
    """
    schema = PlanFile.model_json_schema()
    inner = dict(problem)
    schema["$defs"] |= inner.pop("$defs", {})
    schema["properties"]["problem"] = inner
    return schema
