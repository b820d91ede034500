"""One case of a sweep (a problem, a method, a machine): its key, and how it is run."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.comparison import rows
from planner.errors import (
    NO_MEMORY,
    InputError,
    NoPlanError,
    SingularError,
    VerificationError,
    lacks_memory,
)
from planner.machine.friction.contact_load import contact_load
from planner.machine.machine import Machine
from planner.machine.replay import RECORD_S, Replay, replay
from planner.methods.registry import find_method
from planner.plan.measures import peak_inputs
from planner.plan.plan import Plan
from planner.plan.spec import Spec
from planner.problem.conditions import with_changes
from planner.problem.problem import Problem
from planner.problem.tables.kinds import parse_file
from planner.problem.tables.machine_effects import MachineTable
from planner.solve import solve_and_check
from planner.support.arrays import plain
from planner.support.package import versions
from planner.support.user_tables import parse
from planner.sweep.sweep_file import canonical_json, digest
from planner.systems.manipulator import Manipulator
from planner.verification.verify import verify

if TYPE_CHECKING:
    from planner.sweep.description import Sweep
    from planner.sweep.sweep_file import Point

COSTS: Mapping[str, str] = {
    "objective": "REAL",
    "iterations": "INTEGER",
    **dict.fromkeys(("solve_time_s", "build_time_s"), "REAL"),
}
"""Attributes of a plan that a sweep saves as they are."""

RESULTS: Mapping[str, str] = {
    "status": "TEXT NOT NULL",
    "solved": "INTEGER NOT NULL",
    "why": "TEXT",
    "advice": "TEXT",
    **dict.fromkeys((*rows.sweep_columns(), "end_spread_deg", "contact_torque_nm"), "REAL"),
    **dict.fromkeys(("contact_load", "motor_torque_nm", "motor_power_w"), "REAL"),
    **COSTS,
    "case_time_s": "REAL",
    "versions": "TEXT",
    "traceback": "TEXT",
    "plan": "TEXT",
}
"""Results of a case, as columns of SQLite. `travel`, `peak_u1`, `peak_u2` and `path_length` are in
the units of the sweep's system; `planner.sweep.results.read` adds these units to the names.

`end_median_deg` and `end_p95_deg` are percentiles of the largest joint error at the end;
`end_spread_deg` is the largest standard deviation over the machines of a joint angle at the end.
`contact_torque_nm` is the largest torque at a friction contact, the median over the machines.
`contact_load` is the ratio of that torque to the contact's capacity, `motor_torque_nm` the torque
of motor 1, both at the `CONTACT_PERCENTILE` percentile over the machines. `motor_power_w` is that
motor torque times the largest speed of motor 1. See `planner.machine.friction.contact_load`.
Results of machines exist only if plans are replayed."""

CONTACT_PERCENTILE = 99
"""Percentile of machines for loads: a contact that slips ruins the motion, and a few such machines
in a hundred cause most of the spread."""

CONTACT_MACHINES = 1000
"""Number of machines for contact loads, which take milliseconds because nothing is simulated."""

Row = dict[str, Any]
"""Results of one case: a value for each key of `RESULTS`, None where undefined."""

Request = dict[str, Any]
"""JSON-ready description of one case: everything that another process needs to run the case."""


@dataclass(frozen=True)
class Case:
    """One case of a sweep, ready to run.

    Attributes:
        label: The method as written in the sweep.
        changes: Values of the varied keys.
        request: The argument of `run_case`.
        description: Everything that the result depends on, including all defaults.
        key: Hash of the description; equal cases of different sweeps have equal keys.
    """

    label: str
    changes: Point
    request: Request
    description: str
    key: str


def cases(sweep: Sweep) -> Iterator[Case]:
    """Yield every case of a sweep, point by point; equivalent points have the same key."""
    return (case_at(sweep, position) for position in range(len(sweep)))


def case_at(sweep: Sweep, position: int) -> Case:
    """Return the case at a position; positions run through the methods of one point first."""
    number, method = divmod(position, len(sweep.methods))
    point, spec = sweep.points[number], sweep.methods[method]
    changes = plain(point)
    if spec.compensated:
        changes["compensation.on"] = True
    request = {
        "tables": with_changes(sweep.base.to_dict(), changes),
        "source": sweep.base.source,
        "method": spec.method,
        "options": dict(spec.options),
        "samples": sweep.replay.samples,
        "seed": sweep.replay.seed,
        "keep_plan": sweep.plans,
    }
    description = _description(request, spec)
    return Case(spec.label, point, request, description, digest(description))


def _description(request: Request, spec: Spec) -> str:
    """Return everything that a case's result depends on as JSON; if it is invalid, its request."""
    samples, seed = request["samples"], request["seed"]
    try:
        file = parse_file(request["tables"], "")
        entry = find_method(spec.method)
        settings = getattr(file.method, spec.method).model_dump(exclude_unset=True)
        options = parse(entry.options, {**settings, **spec.options}, "").model_dump(mode="json")
    except InputError:
        asked = {k: v for k, v in request.items() if k not in ("source", "keep_plan")}
        return canonical_json(asked)
    compensated = file.compensation.on
    own_keys = {"title", "method", "machine"} | (set() if compensated else {"compensation"})
    problem = file.model_dump(mode="json", by_alias=True, exclude=own_keys)
    machine = None
    if samples or compensated:
        machine = _machine_of(file.machine.model_dump_json(exclude_unset=True))
    whole = {"problem": problem, "method": spec.method, "options": options, "machine": machine}
    return canonical_json({**whole, "samples": samples, "seed": seed if samples else None})


@lru_cache(maxsize=256)
def _machine_of(text: str) -> dict[str, Any]:
    return Machine.from_table(MachineTable.model_validate_json(text)).to_dict()


_casadi_lock = threading.Lock()
"""Lock around CasADi, which is not thread-safe: a Dask worker may have several threads."""


def possible_statuses() -> set[str]:
    """Return how a case may end."""
    refusals = {kind.status for kind in NoPlanError.__subclasses__()}
    return {"solved", "interrupted", "bad_input", "bug", NoPlanError.status} | refusals


def run_case(request: Request) -> Row:
    """Plan, verify and replay one case; errors are recorded in its row.

    Another process, perhaps on another computer, may call this function.
    """
    with _casadi_lock:
        began = time.perf_counter()
        row: Row = dict.fromkeys(RESULTS) | {"solved": False}
        try:
            row |= _run(request)
        except NoPlanError as error:
            row |= _refusal(error)
        except InputError as error:
            row |= {"status": "bad_input", "why": error.body}
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            row |= {"status": "bug", "why": why, "traceback": traceback.format_exc()}
            if lacks_memory(error):
                row |= {"status": "bad_input", "why": NO_MEMORY.format(why), "traceback": None}
        row["versions"] = _versions()
        row["case_time_s"] = time.perf_counter() - began
        return {name: _number(value) for name, value in row.items()}


def _run(request: Request) -> Row:
    problem = Problem.from_dict(request["tables"], request["source"])
    try:
        plan, check = solve_and_check(problem, request["method"], request["options"])
        row: Row = {"status": plan.status, "solved": plan.verified}
        if not plan.verified:
            row["why"] = "for study only: the path leaves the domain of the chained-form chart"
        elif early := plan.notes.get("ended_early"):
            row["why"] = early
    except (SingularError, VerificationError) as error:
        if error.plan is None:
            raise
        # The refused plan is complete: as in `compare`, its figures show what the limits cost.
        plan = replace(error.plan, status=error.status)
        check = verify(plan)
        row = _refusal(error)
    found = rows.Row.from_plan(Spec(plan.method), plan, check)
    if request["samples"] and plan.executable:
        runs = _replay(plan, request["samples"], request["seed"])
        if runs.angles:
            found = replace(found, **rows.machine_figures(runs, sweep=True))
        row |= _machine_figures(runs)
    row |= {name: value(found) for name, value in rows.sweep_columns().items()}
    row |= {name: getattr(plan, name) for name in COSTS}
    if request["keep_plan"] and plan.verified:
        row["plan"] = plan.to_json()
    return row


def _replay(plan: Plan, samples: int, seed: int) -> Replay:
    # The steps depend on the record interval; use that of `compare` to get the same numbers.
    record = max(RECORD_S, plan.duration / 500)
    return replay(plan, samples=samples, seed=seed, record_s=record, motions=0)


def _machine_figures(runs: Replay) -> Row:
    """Return what only sweeps save of replays: the end's spread and the loads of the contacts."""
    plan, row = runs.plan, Row()
    if runs.angles:
        row["end_spread_deg"] = np.max(np.std(runs.terminal_error_deg, axis=0))
    if isinstance(plan.problem.system, Manipulator):
        load = contact_load(plan, samples=CONTACT_MACHINES, seed=runs.seed)
        row["contact_torque_nm"] = np.median(load.torque_nm)
        row["contact_load"] = np.percentile(load.share, CONTACT_PERCENTILE)
        row["motor_torque_nm"] = torque = np.percentile(load.motor_nm, CONTACT_PERCENTILE)
        row["motor_power_w"] = torque * peak_inputs(plan.trajectory)[0]
    return row


@lru_cache(maxsize=1)
def _versions() -> str:
    return canonical_json(versions())


def _refusal(error: NoPlanError) -> Row:
    why = "; ".join([error.sentence + error.list_head, *(str(v) for v in error.violations[:3])])
    trace = getattr(error, "traceback", None) or None  # only of a `MethodError`
    return {"status": error.status, "why": why, "advice": error.advice, "traceback": trace}


def _number(value: Any) -> Any:
    """Return a NumPy number as a Python number, NaN as None, and any other value unchanged."""
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and np.isnan(value) else value
