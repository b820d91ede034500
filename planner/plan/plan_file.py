"""The file of a plan (JSON): its tables and how to read it. `Plan.save` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union

from pydantic import Field, field_validator, model_validator

from planner.errors import InputError
from planner.plan.claims import certificate_from_dict
from planner.plan.clock import Clock
from planner.plan.measures import Objective
from planner.plan.plan import COPIED, FORMAT, ROUNDING, VERSION, Compensation, Plan
from planner.plan.trajectory import trajectory_from_dict
from planner.problem.problem import Problem
from planner.problem.tables.kinds import MOST_NUMBER
from planner.support.calculus.bernstein import length_flaw
from planner.support.files import read_json
from planner.support.tables import line
from planner.support.user_tables import Table, parse


def read_plan(path: str | Path) -> Plan:
    """Read a file of `Plan.save` without checking the plan; `planner.load_plan` verifies it.

    Raises:
        InputError: If the file is missing, is not a plan, or has another version.
    """
    return _plan(_read(path), path)


def _plan(data: Mapping[str, Any], path: str | Path) -> Plan:
    problem = Problem.from_dict(data["problem"], data["source"])
    if made_from := data.get("compensation"):
        parse(PlanFile, made_from["plan"], f"{path}, the plan that it compensates")
        original = _plan(made_from["plan"], path)
        made_from = Compensation(original, made_from["machine"], _clock(made_from, original, path))
    proven = data.get("certificate")
    try:
        return Plan(
            problem=problem,
            trajectory=trajectory_from_dict(problem.system, data["trajectory"]),
            certificate=None if proven is None else certificate_from_dict(proven),
            violation="" if data["verified"] else data.get("why", ""),
            compensation=made_from,
            aim=_aim(data),
            **{key: _read_back(data[key]) for key in COPIED},
        )
    except (KeyError, TypeError) as error:
        raise InputError(f"{path} is not a complete plan file: {error!r}") from None
    except ValueError as error:
        raise InputError(f"{path} holds no valid trajectory of the problem: {error}") from None


def _aim(data: Mapping[str, Any]) -> Objective:
    """Return the objective of a file; earlier versions gave only its name."""
    said = data.get("aim") or {"kind": data["objective_name"], "terms": {}}
    terms = {line(key): weight for key, weight in said["terms"].items()}
    return Objective(line(said["kind"]), terms)


def _clock(made_from: Mapping[str, Any], original: Plan, path: str | Path) -> Clock:
    """Return the checked clock of a file."""
    seconds = original.duration
    clock = Clock(tuple(made_from["clock"]["t"]), tuple(made_from["clock"]["s"]))
    why = clock.flaw
    if not why and abs(clock.seconds - seconds) > ROUNDING * max(1.0, seconds):
        why = f"the clock ends at {clock.seconds:.6g} s, but the plan lasts {seconds:.6g} s"
    if why:
        raise InputError(f"{path}: compensation.clock is not valid: {why}")
    return clock


def _read_back(value: Any) -> Any:
    """Return a JSON value with NaN for null and with texts safe to display."""
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
"""A number in a plan file; null if undefined."""

Finite = Annotated[float, Field(ge=-MOST_NUMBER, le=MOST_NUMBER)]
"""A number from which the plan is computed, bounded as a problem's numbers are, so that no
computation overflows."""

Amount = Annotated[float, Field(ge=0, le=MOST_NUMBER)]


class CurveTable(Table):
    """A piecewise polynomial in the Bernstein basis.

    On [breaks[k], breaks[k+1]], with x from 0 to 1 over the piece, component i is the sum over a of
    bernstein[a][k][i] C(d, a) x^a (1-x)^(d-a), where d is the degree; a scalar curve has no [i].
    """

    breaks: Annotated[list[Finite], Field(min_length=2)] = Field(
        description="K+1 increasing times."
    )

    @field_validator("breaks")
    @classmethod
    def _increase(cls, breaks: list[float]) -> list[float]:
        if not all(a < b for a, b in pairwise(breaks)):
            raise ValueError("times must increase")
        return breaks

    @model_validator(mode="after")
    def _small(self) -> CurveTable:
        if flaw := length_flaw(len(self.breaks) - 1, len(self.bernstein) - 1):
            raise ValueError(flaw)
        return self

    bernstein: list[list[Finite | list[Finite | None] | None]] = Field(
        description="Coefficients: degree + 1 lists of K pieces, each a list of components."
    )


class ChainedTable(Table):
    """A curve given in chained coordinates."""

    kind: Literal["chained"]
    branch: list[Finite] = Field(description="Signs (N) of the chart's branch.")
    z: CurveTable = Field(description="z1 ... zN over time in s.")
    v: CurveTable = Field(description="v1, v2 over time in s.")


class StateTable(Table):
    """A curve given in coordinates (the triangular ones) and inputs."""

    kind: Literal["state"]
    q: CurveTable = Field(description="q1 ... qN in rad or m over time in s.")
    u: CurveTable = Field(description="u1, u2 in rad/s or m/s over time in s.")


class RetimedTable(Table):
    """A path with another timing."""

    kind: Literal["retimed"]
    path: TrajectoryTable
    length: CurveTable = Field(description="Length along the path over the path's own time.")
    clock: CurveTable = Field(description="Length over time in s.")
    stations: list[Finite] = Field(description="The path's own time at the breaks of the clock.")


TrajectoryTable = Annotated[
    Union[ChainedTable, StateTable, RetimedTable],  # noqa: UP007
    Field(discriminator="kind"),
]


class ClaimTable(Table):
    """Result for one requirement, over all time."""

    label: str = Field(description="What is required, as in 'joint theta3'.")
    status: Literal["proven", "undecided", "violated"]
    guaranteed: Number = Field(description="Proven lower bound of the margin; null: none.")
    attained: Number = Field(description="Upper bound of the least margin, at time_s.")
    time_s: Number = Field(description="Time of the least margin in s, if known.")
    unit: str = Field(description="Unit of the margin.")
    required: bool = Field(description="Whether the problem asks for it.")
    why: str = Field(description="Reason why it is undecided.")
    text: str = Field(description="The same in words.")


class CertificateTable(Table):
    """What is proven of the plan on whole intervals."""

    ok: bool = Field(description="Whether everything required is proven.")
    text: str = Field(description="The same in words.")
    claims: list[ClaimTable]
    only_sampled: list[str] = Field(
        [], description="Requirements that were checked by samples only, not proven."
    )
    motion_error: dict[str, Number] = Field(
        description="Proven bound on |q(t) - true motion|, by coordinate; null: none."
    )
    cells: int = Field(description="Number of subintervals in the proof.")
    seconds: float = Field(description="Computing time in s.")


class PlanFile(Table):
    """A plan as `Plan.save` writes it. Angles are in radians, times in seconds."""

    format: Literal["planner-plan"]
    version: Literal[1] = Field(description="Version of the file format.")
    problem: dict[str, Any] = Field(description="The tables of the problem file.")
    source: str = Field(description="Where the problem came from.")
    method: str = Field(description="Method that made the plan.")
    options: dict[str, Any] = Field(description="The method's options, as used.")
    status: str = Field(description="'solved', or why the plan is not valid.")
    objective: Finite | None = Field(description="Value of the method's objective.")
    objective_name: str = Field(description="Name of the objective, as `aim` gives it.")
    aim: ObjectiveTable | None = Field(None, description="What was minimised.")
    solve_time_s: Amount | None = Field(description="Time spent solving, s.")
    build_time_s: Amount | None = Field(description="Time spent preparing, s.")
    iterations: Annotated[int, Field(ge=0, le=int(MOST_NUMBER))] = Field(
        description="Iterations of its solver, 0 for closed forms."
    )
    verified: bool = Field(description="Whether the independent check passed.")
    notes: dict[str, Any] = Field(description="Further facts from the method.")
    certificate: CertificateTable | None = Field(
        None, description="What is proven between the nodes; null: not examined."
    )
    why: str = Field("", description="The violated requirement, if a file said verified.")
    trajectory: TrajectoryTable = Field(description="The curve itself.")
    compensation: CompensationOfTable | None = Field(
        None, description="Original plan and machine of a compensated plan."
    )


class ObjectiveTable(Table):
    """What a method minimises: a sum of named terms."""

    kind: str = Field(description="First word of the objective's name.")
    terms: Annotated[dict[str, Finite], Field(max_length=20)] = Field(
        description="Weight of each term."
    )


class CompensationOfTable(Table):
    """The original plan and machine of a compensated plan."""

    plan: dict[str, Any] = Field(description="The original plan, which follows the kinematics.")
    machine: dict[str, Any] = Field(description="The [machine] table of the compensated machine.")
    clock: ClockTable = Field(description="The original plan's clock while the commands run.")


class ClockTable(Table):
    """A plan's clock over the machine's time: piecewise linear, running at its rate or held."""

    t: Annotated[list[Amount], Field(min_length=2)] = Field(description="The machine's times in s.")
    s: Annotated[list[Amount], Field(min_length=2)] = Field(description="The plan's times, in s.")


def plan_schema(problem: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON Schema of a plan file.

    Args:
    problem: JSON Schema of a problem file.
    """
    schema = PlanFile.model_json_schema()
    inner = dict(problem)
    schema["$defs"] |= inner.pop("$defs", {})
    schema["properties"]["problem"] = inner
    return schema
