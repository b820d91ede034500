"""The figures of a plan, which are numbers such as its effort, and the summary of a plan.

Every table of plans takes names, titles, units and digits from the fields of `PlanFigures` and its
subclasses (such as the rows of a comparison): one more field is one more column.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import Field, dataclass, field, fields
from typing import Any

import numpy as np

from planner.errors import NoPlanError, Violation
from planner.plan.measures import effort_unit, moving_inputs, path_coordinates
from planner.plan.plan import Plan
from planner.support.arrays import Array, Frozen
from planner.support.calculus.extremes import sample_times
from planner.support.tables import key_with_unit
from planner.systems.triangular_system import TriangularSystem
from planner.verification.verify import Check, verify


@dataclass(frozen=True)
class Heading:
    """The heading of one number of a figure, for a column of a table or a key of a file.

    Attributes:
        title: Title of the column in tables.
        unit: Unit of the number, or a function that gives it for a system.
        digits: Significant digits in tables; files have all digits.
        key: Name of the number in files; by default the name of the field.
        unit_in_key: Whether the name in files ends with the unit: travel_rad, travel_m.
    """

    title: str
    unit: str | Callable[[TriangularSystem], str] = ""
    digits: int = 3
    key: str = ""
    unit_in_key: bool = False

    def unit_of(self, system: TriangularSystem) -> str:
        """Return the unit of the number for plans of the given system."""
        return self.unit if isinstance(self.unit, str) else self.unit(system)

    def key_of(self, name: str, system: TriangularSystem) -> str:
        """Return the name in files of the number of the field `name` for the given system."""
        key = self.key or name
        return key_with_unit(key, self.unit_of(system)) if self.unit_in_key else key


@dataclass(frozen=True)
class FigureField:
    """How a figure is computed and shown: the metadata of its field.

    Attributes:
        headings: One for each of the figure's numbers; empty for a figure that only files show.
        plan: Computes the figure from a plan and its check; None if a plan does not give it.
        replay: Computes the figure from a replay; None if a replay does not give it.
        executable: Whether only executable plans have the figure.
        sweep: Whether sweeps store the figure, if a plan or a replay gives it; see `swept`.
        files: Whether only the wide tables in files show the figure.
    """

    headings: tuple[Heading, ...]
    plan: Callable[[Plan, Check], Any] | None = None
    replay: Callable[[Any], Any] | None = None
    executable: bool = False
    sweep: bool = True
    files: bool = False

    @property
    def swept(self) -> bool:
        """Whether sweeps have a column of the figure: one that nothing fills cannot be declared."""
        return self.sweep and not (self.plan is None and self.replay is None)


def figure(*headings: Heading, default: Any = np.nan, **how: Any) -> Any:
    """Return a dataclass field that holds a figure; `how` are further fields of `FigureField`."""
    return field(default=default, metadata={"figure": FigureField(headings, **how)})


def figures(kind: type) -> Mapping[str, FigureField]:
    """Return the figures of a dataclass by field name, in the order of the fields."""
    members: tuple[Field[Any], ...] = fields(kind)
    return {f.name: f.metadata["figure"] for f in members if "figure" in f.metadata}


@dataclass(frozen=True, kw_only=True)
class PlanFigures(Frozen):
    """The figures of a plan; a number that the plan does not define is NaN.

    Attributes:
        travel: q₁(T) − q₁(0), in the unit of q₁ (rad for arms, metres for vehicles).
        duration_s: Whole duration, s, including the preparation and the pauses of a compensated
            plan.
        effort: ∫ u₁² + u₂² dt.
        peak_u: Largest |u₁| and |u₂|, shape (2,), in the inputs' units (rad/s for arms).
        path_length: `Plan.path_length`: radians for arms, metres for vehicles.
        domain_margin: Least margin of the chart's domain; negative outside.
        domain_ok: Whether the path stays inside the chart's domain; None without a path.
        terminal_error_max_deg: Largest error of an angle at the goal, as `verify` computes it.
    """

    travel: float = figure(
        Heading("travel", lambda system: system.coordinates[0].unit, 4, unit_in_key=True),
        plan=lambda plan, _: plan.travel,
    )
    duration_s: float = figure(
        Heading("time", "s", key="duration_s"), plan=lambda plan, _: plan.duration
    )
    effort: float = figure(
        Heading("effort", effort_unit, 4), plan=lambda plan, _: plan.effort, executable=True
    )
    peak_u: tuple[float, float] = figure(
        Heading("|u1|", lambda system: system.inputs[0].unit, key="peak_u1", unit_in_key=True),
        Heading("|u2|", lambda system: system.inputs[1].unit, key="peak_u2", unit_in_key=True),
        plan=lambda plan, _: tuple(plan.peak_u.tolist()),
        executable=True,
        default=(np.nan, np.nan),
    )
    path_length: float = figure(
        Heading("path", lambda system: path_coordinates(system)[1], 4, unit_in_key=True),
        plan=lambda plan, _: plan.path_length,
        executable=True,
    )
    domain_margin: float = figure(plan=lambda plan, _: plan.domain.margin)
    domain_ok: bool | None = figure(plan=lambda plan, _: plan.domain.ok, sweep=False, default=None)
    terminal_error_max_deg: float = figure(plan=lambda _, check: _largest(check.terminal_error_deg))

    @classmethod
    def measure(cls, plan: Plan, check: Check) -> dict[str, Any]:
        """Return the figures of a plan by name; a plan that is not executable lacks some."""
        return {
            name: one.plan(plan, check)
            for name, one in figures(cls).items()
            if one.plan is not None and (plan.executable or not one.executable)
        }


def _largest(errors: Array) -> float:
    return float(np.max(np.abs(errors))) if errors.size else np.nan


def unit_keys(system: TriangularSystem) -> dict[str, tuple[str, ...]]:
    """Return the keys in JSON of the figures whose keys have units, by field of `PlanFigures`.

    Two numbers of one unit have one key and are a list (peak_u_rad_s); numbers of different units
    have a key each (peak_u1_m_s, peak_u2_rad_s).
    """
    out = {}
    for name, one in figures(PlanFigures).items():
        units = {head.unit_of(system) for head in one.headings if head.unit_in_key}
        keys = tuple(head.key_of(name, system) for head in one.headings)
        if units:
            out[name] = keys if len(units) > 1 else (key_with_unit(name, *units),)
    return out


def with_unit_keys(data: Mapping[str, Any], system: TriangularSystem) -> dict[str, Any]:
    """Return figures by field with the keys of `unit_keys`; other entries stay."""
    keys, out = unit_keys(system), dict[str, Any]()
    for name, value in data.items():
        named = keys.get(name, (name,))
        out |= {named[0]: value} if len(named) == 1 else dict(zip(named, value, strict=True))
    return out


def without_unit_keys(data: Mapping[str, Any], system: TriangularSystem) -> dict[str, Any]:
    """Return the figures of JSON data by field, from the keys of `unit_keys`; missing are None."""
    read = {name: [data.get(key) for key in keys] for name, keys in unit_keys(system).items()}
    return {name: each if len(each) > 1 else each[0] for name, each in read.items()}


_OF_PLAN = ("method", "status", "verified", "objective", "objective_name", "solve_time_s",
            "build_time_s", "iterations")  # fmt: skip


def summary_keys(system: TriangularSystem) -> list[str]:
    """Return every key of a summary, in order."""
    known = with_unit_keys(vars(PlanFigures()), system)
    return [
        *_OF_PLAN, *known, "direction", "terminal_error", "terminal_error_deg", "executable",
        "starts_at_rest", "ends_at_rest", "z2_max", "singular_times_s", "reason", "violations",
        "advice", "certificate", "worth", "notes",
    ]  # fmt: skip


def plan_summary(plan: Plan, check: Check | None = None) -> dict[str, Any]:
    """Return the summary of a plan: its figures, status, violations and notes in one dictionary.

    Args:
        plan: Any plan, verified or not.
        check: The result of `verify`, if it is known already.

    Returns:
        A value for each of `summary_keys`: number, text, list or dictionary; NaN where undefined.
        `terminal_error_deg` is a list with one error per angle.
    """
    check, system = verify(plan) if check is None else check, plan.problem.system
    names = [c.name for c in system.user_coordinates]
    measured = PlanFigures(**PlanFigures.measure(plan, check))
    return dict.fromkeys(summary_keys(system)) | {
        **{key: getattr(plan, key) for key in _OF_PLAN},
        **with_unit_keys(vars(measured), system),
        "direction": direction(plan),
        "terminal_error_deg": check.terminal_error_deg.tolist(),
        "terminal_error": dict(zip(names, check.terminal_error.tolist(), strict=True)),
        "executable": plan.executable,
        "starts_at_rest": not moving_inputs(plan.trajectory, 0.0),
        "ends_at_rest": not moving_inputs(plan.trajectory, plan.duration),
        "z2_max": plan.domain.z2_max,
        "singular_times_s": list(plan.domain.singular_times_s),
        "violations": [_violation(v) for v in check.violations],
        "certificate": None if plan.certificate is None else plan.certificate.to_dict(),
        "worth": plan.worth and plan.worth.model_dump(),
        "notes": dict(plan.notes),
    }


def refusal_summary(error: NoPlanError, method: str, system: TriangularSystem) -> dict[str, Any]:
    """Return the summary of a refusal, with the figures of the solver's last iterate if known.

    Returns:
        A value for each of `summary_keys`; None where nothing is known. `verified` is False.
    """
    out: dict[str, Any] = dict.fromkeys(summary_keys(system))
    if error.plan is not None:
        with suppress(ArithmeticError, ValueError):  # leave out an iterate with impossible values
            out |= plan_summary(error.plan, getattr(error, "check", None))
    return out | {
        "method": method,
        "status": error.status,
        "verified": False,
        "reason": error.reason,
        "violations": [_violation(v) for v in error.violations] or out["violations"] or [],
        "advice": error.advice,
    }


def direction(plan: Plan) -> str:
    """Say how a plan's path coordinate moves: "one way", "reverses once", "reverses 3 times"."""
    v1 = plan.v(sample_times(plan.t))[:, 0]
    moving = v1[np.abs(v1) > 1e-6 * np.nanmax(np.abs(v1), initial=0.0)]
    turns = int(np.sum(np.sign(moving[1:]) != np.sign(moving[:-1])))
    return ("one way", "reverses once")[turns] if turns < 2 else f"reverses {turns} times"


def _violation(violation: Violation) -> dict[str, Any]:
    keys = ("label", "time_s", "value", "limit", "unit", "scaled", "exact")
    return {**{key: getattr(violation, key) for key in keys}, "text": str(violation)}
