"""`Plan`, the result of every method."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.errors import InputError, TimeLimitError, expect, factory
from planner.plan.claims import Certificate, shown_labels
from planner.plan.clock import Clock
from planner.plan.measures import (
    DomainReport,
    Objective,
    domain_report,
    effort,
    effort_unit,
    moving_inputs,
    path_coordinates,
    path_length,
    peak_inputs,
)
from planner.plan.quadrature import growth
from planner.plan.trajectory import Trajectory
from planner.problem.problem import Problem
from planner.problem.tables.machine_effects import Worth
from planner.support.arrays import Array, Frozen, floats, jsonable, locked
from planner.support.deadline import Span
from planner.support.files import write_text
from planner.support.package import DataFrame, Dataset, Figure, Table, draw_figure, import_function
from planner.support.tables import notebook_html

FORMAT = "planner-plan"
VERSION = 1

COPIED = ("method", "options", "status", "objective", "solve_time_s",
          "build_time_s", "iterations", "verified", "notes")  # fmt: skip
"""Attributes of a plan that its file stores under the same names."""

OFFERED = ("t", "q", "u", "z", "v", "theta", "user", "duration", "travel", "effort", "peak_u",
           "path_length", "domain", "executable", "table", "plot", "save", "to_frame", "to_xarray",
           "to_dict", "problem", "method", "options", "status", "verified", "certificate",
           "objective", "solve_time_s", "notes", "compensates")  # fmt: skip
"""What tab completion offers of a plan, and the reference has first: what people use."""

COMPENSATED = "compensated"
"""Suffix of the method's name for a plan compensated for the machine."""

LEAST_GROWTH = 1.0
"""Least growth of a volume of states, as a logarithm, along a motion that is called unstable. Below
it the motion may be integrated in either direction."""

UNSTABLE = "unstable in open loop: errors grow, so drive it with feedback"
"""What is said of a plan that is `Plan.unstable`."""

ROUNDING = 1e-9
"""Tolerance for times outside a plan, relative to the duration, or to 1 s if that is longer. The
rounding errors of a sum of thousands of time steps are smaller."""


@factory("planner.solve(problem, method) or planner.load_plan(path)")
@dataclass(frozen=True, eq=False)
class Plan(Frozen):
    """A motion from start to goal that evaluates at any time.

    `t`, `q(t)`, `u(t)`, `z(t)` and `v(t)` use the method's own interpolant; see `Trajectory`.

    Before 0 and after `duration` the plan is at rest: the coordinates are those of its ends and the
    inputs are zero. Evaluating it there gives a RuntimeWarning; its `trajectory` gives none. Times
    that are not numbers give an InputError.

    A plan cannot change: the arrays, dictionaries and lists that it hands out are read-only.

    Two plans are equal if they have the same motion, problem, method, options and verdict;
    computing times do not count.

    Attributes:
        problem: The problem that the plan solves.
        method: Name of the method.
        options: The method's options, as used.
        trajectory: The curve itself.
        status: "solved", or the reason why the plan is not valid ("singular", "not_converged", …).
        objective: Value of what the method minimised, `aim`: not the same quantity for all methods.
            `effort` compares them.
        aim: What the method minimises.
        solve_time_s: Seconds that the method spent solving.
        build_time_s: Seconds spent building the optimisation problem (zero if reused).
        iterations: Iterations of the method's solver; 0 for closed-form methods.
        verified: Whether the independent verification passed (set by `solve`).
        notes: Further facts from the method, JSON-ready (the first guess used, constraint points,
            …).
        certificate: What is proven of the plan between the nodes (set by `solve`; see `certify`).
        violation: The requirement that the plan violates, in one line, if the plan's file wrongly
            calls the plan verified; otherwise empty.
        compensation: Original plan and machine of a compensated plan (set by `compensate`);
            otherwise None.
        file_figures: For a verified plan that was read from a file, the figures that were taken
            from the file and not computed again ("objective", "notes.optimality"); otherwise empty.
    """

    problem: Problem
    method: str
    options: Mapping[str, Any]
    trajectory: Trajectory
    status: str = "solved"
    objective: float = float("nan")
    aim: Objective = field(default_factory=Objective)
    solve_time_s: float = 0.0
    build_time_s: float = 0.0
    iterations: int = 0
    verified: bool = False
    notes: Mapping[str, Any] = field(default_factory=dict)
    certificate: Certificate | None = None
    violation: str = ""
    compensation: Compensation | None = None
    file_figures: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plan) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash((self.problem, self.method, self.trajectory))

    @property
    def _identity(self) -> tuple[Any, ...]:
        identity = (self.problem, self.method, self.trajectory, self.status, self.verified)
        return *identity, jsonable(self.options), self.compensation

    def __dir__(self) -> tuple[str, ...]:
        return OFFERED

    @property
    def t(self) -> Array:
        """Break times between which the motion is smooth, shape (K+1,), seconds."""
        return self.trajectory.breaks

    def q(self, t: ArrayLike) -> Array:
        """Return coordinates (…, N) at times t (…); RuntimeWarning outside [0, duration]."""
        return self.trajectory.q(self._times(t))

    def u(self, t: ArrayLike) -> Array:
        """Return inputs (…, 2) at times t (…); RuntimeWarning outside [0, duration]."""
        return self.trajectory.u(self._times(t))

    def z(self, t: ArrayLike) -> Array:
        """Return chained coordinates (…, N) at times t (…); RuntimeWarning outside the plan."""
        return self.trajectory.z(self._times(t))

    def v(self, t: ArrayLike) -> Array:
        """Return chained inputs (…, 2) at times t (…); RuntimeWarning outside [0, duration]."""
        return self.trajectory.v(self._times(t))

    def theta(self, t: ArrayLike) -> Array:
        """Return the joint angles of an arm, radians, shape (…, n), at times t (…).

        Times outside [0, duration] give a RuntimeWarning.

        Raises:
            InputError: If the system has no joints theta1, theta2, …
        """
        names = [c.name for c in self.problem.system.coordinates]
        joints = [i for i, name in enumerate(names) if name.startswith("theta")]
        if not joints:
            raise InputError(
                f"a {self.problem.system.kind} has no joint angles; plan.q(t) gives its coordinates"
                f" {', '.join(names)}"
            )
        return self.q(t)[..., joints]

    def user(self, t: ArrayLike) -> Array:
        """Return user coordinates (…, N) at times t (…): `q` if the system defines no others."""
        return self.problem.system.user(self.trajectory.q(self._times(t)))

    def _times(self, t: ArrayLike) -> Array:
        """Return times as floats; clip those just outside the plan by rounding, warn of others."""
        times, slack = floats("t", t), ROUNDING * max(1.0, self.duration)
        outside = (times < -slack) | (times > self.duration + slack)
        if np.any(outside):
            warnings.warn(
                f"t = {times[outside].flat[0]:.6g} s lies outside the plan, which lasts from 0"
                f" to {self.duration:.6g} s; outside, the plan is at rest (plan.trajectory.q and .u"
                " give the same without this warning)",
                RuntimeWarning,
                stacklevel=3,
            )
        return np.where(outside, times, times.clip(0.0, self.duration))

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return self.trajectory.duration

    @property
    def travel(self) -> float:
        """Travel q₁(T) − q₁(0), radians for the manipulator."""
        return float(self.z(self.duration)[0] - self.z(0.0)[0])

    @cached_property
    def effort(self) -> float:
        """∫ u₁² + u₂² dt, of a compensated plan that of its commands; NaN if not `executable`."""
        return effort(self.trajectory) if self.executable else np.nan

    @cached_property
    def peak_u(self) -> Array:
        """Largest |u₁| and |u₂|, shape (2,), in the inputs' units; NaN if not `executable`."""
        return locked(peak_inputs(self.trajectory) if self.executable else np.full(2, np.nan))

    @cached_property
    def path_length(self) -> float:
        """Length of the path: of an arm's joint angles as a vector, in radians; of a vehicle's
        position, in metres. NaN if not `executable`; see `measures.path_coordinates`."""
        return path_length(self.trajectory) if self.executable else np.nan

    @cached_property
    def domain(self) -> DomainReport:
        """Report on where the plan lies in the chart's domain: margins and exits over all time."""
        return domain_report(self.trajectory)

    @property
    def executable(self) -> bool:
        """Whether real coordinates and inputs exist at all times."""
        return self.trajectory.in_coordinates or self.domain.ok

    def table(self) -> Table:
        """Return the plan's properties for a terminal: `rich.print(plan.table())`."""
        table: Table = import_function("planner.report.properties.plan_table")(self)
        return table

    def _repr_html_(self) -> str:
        return notebook_html(self.table())

    def plot(self, figure: str = "joints") -> Figure:
        """Draw a figure of the plan: "joints", "inputs", "map", "z" or another of `PLAN_FIGURES`.

        Raises:
            InputError: If the name is unknown, or the system or this plan has no such figure.
        """
        return draw_figure("over_time.plot", figure, self)

    def save(self, path: str | Path) -> Path:
        """Write the plan as versioned JSON; `load_plan` reads it back exactly.

        Raises:
            InputError: If the file cannot be written, or would be too long to be read; no partial
                file is left.
        """
        return write_text(path, self.to_json())

    def to_frame(self, rate_hz: float = 100.0) -> DataFrame:
        """Return the plan at evenly spaced times as a pandas DataFrame; see
        `planner.plan.samples.to_frame`."""
        return import_function("planner.plan.samples.to_frame")(self, rate_hz)

    def to_xarray(self, rate_hz: float = 100.0) -> Dataset:
        """Return the plan at evenly spaced times as an xarray Dataset; see
        `planner.plan.samples.to_xarray`."""
        return import_function("planner.plan.samples.to_xarray")(self, rate_hz)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-ready data: what its file contains."""
        data = {
            "format": FORMAT,
            "version": VERSION,
            "problem": self.problem.to_dict(),
            "source": self.problem.source,
            **{key: getattr(self, key) for key in COPIED},
            "objective_name": self.objective_name,
            "aim": {"kind": self.aim.kind, "terms": dict(self.aim.terms)},
            "certificate": None if self.certificate is None else self.certificate.to_dict(),
            "trajectory": self.trajectory.to_dict(),
            **({"why": self.violation} if self.violation else {}),
        }
        if self.compensation is not None:
            data["compensation"] = {
                "plan": self.compensation.plan.to_dict(),
                "machine": dict(self.compensation.machine),
                "clock": {"t": list(self.clock.t), "s": list(self.clock.s)},
            }
        return dict(jsonable(data))

    def to_json(self) -> str:
        """Return the plan as the JSON text that `save` writes."""
        return json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"

    @property
    def objective_name(self) -> str:
        """Name of the objective ("effort: integral of u1^2 + u2^2 dt")."""
        return self.aim.name

    @property
    def label(self) -> str:
        """Name of the plan in comparisons: the method, and whether it is compensated."""
        return f"{self.method} {COMPENSATED}" if self.is_compensated else self.method

    def __repr__(self) -> str:
        state = "verified" if self.verified else f"not verified, status {self.status}"
        state += f": {self.violation}" if self.violation else ""
        if self.compensation is not None:
            state += " on the nominal machine" if self.verified else ""
        said = ", ".join([*self._figures, state, *self.reservations])
        travel = f"{self.travel:.4g} {self.problem.system.coordinates[0].unit}"
        return f"Plan({self.label}: travel {travel} in {self.duration:.4g} s, {said})"

    @property
    def _figures(self) -> list[str]:
        """Effort, peak inputs and path length in words; none if the plan is not executable."""
        if not self.executable:
            return []
        system = self.problem.system
        units = [each.unit for each in system.inputs]
        said = [f"{peak:.4g} {unit}" for peak, unit in zip(self.peak_u, units, strict=True)]
        return [
            f"effort {self.effort:.4g} {effort_unit(system)}",
            f"peaks {' and '.join(said)}",
            f"path {self.path_length:.4g} {path_coordinates(system)[1]}",
        ]

    def __str__(self) -> str:
        """Return a summary: method, state and figures, what was minimised, problem."""
        said = f"{self.objective:.4g}, {self.objective_name}"
        lines = [repr(self), *[f"  objective {said}"] * bool(self.objective_name)]
        return "\n".join([*lines, f"  of {self.problem.name}"])

    @property
    def compensates(self) -> Plan | None:
        """The original plan of a compensated plan; None for all other plans."""
        return None if self.compensation is None else self.compensation.plan

    @property
    def is_compensated(self) -> bool:
        """Whether the inputs are an original plan's, changed to follow it on a machine."""
        return self.compensation is not None and not self.ends_on_machine

    @property
    def ends_on_machine(self) -> bool:
        """Whether the plan was made with `end = "machine"`, so that its inputs are the original's
        and its motion is the one predicted on the machine."""
        return self.compensation is not None and self.options.get("end") == "machine"

    @property
    def clock(self) -> Clock:
        """Map from a compensated plan's time to the original plan's time; else the identity."""
        if self.compensation is None:
            return Clock.running(self.duration)
        return self.compensation.clock

    @property
    def lead_s(self) -> float:
        """Duration of a compensated plan's preparatory motion, s; 0 for other plans."""
        return self.clock.lead_s

    @property
    def tail_s(self) -> float:
        """Time that a compensated plan continues after the end of the original plan, s."""
        return self.clock.tail_s

    def reference(self, t: ArrayLike) -> Array:
        """Return the reference coordinates (…, N) at times t (…), against which errors are
        measured.

        These are the plan's own coordinates, or for a compensated plan those of the original plan
        at the time that `clock` shows, and NaN during the preparatory motion. For a plan with
        `end = "machine"` they are the predicted ones.
        """
        if self.compensates is None or not self.is_compensated:
            return self.trajectory.q(t)
        early = floats("t", t) < self.lead_s - ROUNDING * max(1.0, self.duration)
        return np.where(early[..., None], np.nan, self.compensates.trajectory.q(self.clock(t)))

    @property
    def goal(self) -> Array:
        """Coordinates at the end from which errors are measured, (N,): those of the original plan,
        if there is one."""
        return (self.compensates or self).trajectory.q(self.clock(self.duration))

    @property
    def sampled_labels(self) -> tuple[str, ...]:
        """Labels of requirements of a verified plan that are sampled but not proven.

        Empty for a compensated plan, whose motion is that of the nominal machine.
        """
        if self.certificate is None or not self.verified or self.compensation is not None:
            return ()
        return self.certificate.sampled_labels

    @property
    def worth(self) -> Worth | None:
        """How far the plan's machine can be believed, if it was identified; else None."""
        if self.compensation is None:
            return self.problem.machine.worth
        told = self.compensation.machine.get("worth")
        return None if told is None else Worth(**told)

    @property
    def reservations(self) -> list[str]:
        """Phrases on the identified machine that a compensated plan is for, on requirements that
        are only sampled, on figures that only the file claims, and on inputs that jump at an end.
        """
        said = {"only sampled": self.sampled_labels, "only its file says": self.file_figures}
        said_of = [f"{words}: {shown_labels(labels)}" for words, labels in said.items() if labels]
        belief = [self.worth.words] if self.compensation is not None and self.worth else []
        return [*belief, *said_of, *filter(None, [self.jump_words, UNSTABLE * self.unstable])]

    @cached_property
    def _growth(self) -> tuple[float, float]:
        known = self.compensation is None and not self.trajectory.flaw
        with np.errstate(all="ignore"):
            return growth(self.trajectory) if known else (0.0, 0.0)

    @property
    def unstable(self) -> bool:
        """Whether errors grow on the way and last until the goal, as when trailers are backed: then
        the inputs alone do not lead a vehicle to the goal, and it needs feedback."""
        return self._growth[1] > LEAST_GROWTH

    @cached_property
    def backwards(self) -> Plan | None:
        """The motion run backwards, as a plan of the problem with start and goal exchanged, if
        errors shrink in that direction; else None, also if the problem cannot be exchanged."""
        problem = self.problem.exchanged() if self._growth[0] > LEAST_GROWTH else None
        return None if problem is None else self.exchanged(problem)

    def exchanged(self, problem: Problem) -> Plan:
        """Return the motion run backwards as a plan of `problem`, which exchanges the ends."""
        return replace(self, problem=problem, trajectory=self.trajectory.slowed(-1.0))

    @property
    def jump_words(self) -> str:
        """Words on inputs that jump from rest at the start or to rest at the end, although the
        problem limits their rates; else "".

        Such a limit holds from the start to the end of a plan; only `rest` demands rest there.
        """
        if not (self.executable and self.problem.reads("du")):
            return ""
        ends = {"starts": 0.0, "ends": self.duration}
        moving = {verb: moving_inputs(self.trajectory, time) for verb, time in ends.items()}
        said = (f"{verb} with a jump ({', '.join(at)})" for verb, at in moving.items() if at)
        return " and ".join(said)

    @property
    def start_words(self) -> str:
        """Phrase that says for which arm a compensated plan's commands hold: where and in which
        state it rests before, and after which plan if its notes name one; "" for other plans."""
        if self.compensation is None:
            return ""
        pose = ", ".join(f"{a:.4g}" for a in np.rad2deg(self.q(0.0)[1:]))
        state = self.compensation.machine["start_state"]
        listed = [state] if isinstance(state, str) else state
        said = ", ".join(a if isinstance(a, str) else f"{a:.3g}" for a in listed)
        last = f" after {self.notes['after']}" if "after" in self.notes else ""
        return f"for an arm that rests at ({pose}) deg{last}, state {said}"


@dataclass(frozen=True)
class Compensation(Frozen):
    """The original plan and machine of a compensated plan.

    Attributes:
        plan: The original plan, which follows the kinematics.
        machine: The complete `[machine]` table of the machine for which the commands compensate.
        clock: Map from the time of the commands to the time of the original plan.
    """

    plan: Plan
    machine: Mapping[str, Any]
    clock: Clock


def mark_cut_short(plan: Plan, span: Span, how: str) -> Plan:
    """Return the plan with the status "interrupted" or "time_limit", as the work ended early.

    The note `ended_early` has the reason in words, `span.why`, followed by `how`.
    """
    status = "interrupted" if span.ended_by else TimeLimitError.status
    return replace(plan, status=status, notes={**plan.notes, "ended_early": f"{span.why} {how}"})


def expect_plan(value: object) -> None:
    """Refuse any value but a plan, such as the name of a plan's file.

    Raises:
        InputError: If the value is not a plan; the message says how to get one.
    """
    how = "planner.solve(problem, method) makes one and planner.load_plan(path) reads one"
    if callable(getattr(value, "plan", None)):  # a recorded run
        how = f"log.plan(problem) is one, as in planner.replay(log.plan(problem)); {how}"
    expect(Plan, value, how)


def refuse_inexecutable(plan: Plan) -> None:
    """Refuse a plan that leaves the chart's domain and so has no real inputs.

    Raises:
        InputError: If the plan leaves the domain (the message gives times and margin), or is not a
            plan.
    """
    expect_plan(plan)
    if plan.executable:
        return
    domain = plan.domain
    times = ", ".join(f"{t:.4g}" for t in domain.singular_times_s[:8]) or f"{domain.time_s:.4g}"
    raise InputError(
        f"this {plan.method} plan leaves the chart's domain, so it has no real inputs"
        f" (crossings at t = {times} s; {domain.label}: {domain.margin:.4g})"
    )
