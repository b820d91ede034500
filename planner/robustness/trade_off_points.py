"""The points of a trade-off curve: the quantity that is limited, a point, the finished points.

With the folder of finished points, an interrupted curve can be continued.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from planner.compensation import compensate_plan
from planner.errors import InputError, NoPlanError
from planner.machine.machine import Machine
from planner.machine.replay import STATISTICS, replay
from planner.methods.collocation.method import plan_collocation
from planner.methods.desensitised.method import plan_desensitised, spreads
from planner.methods.judgement import judge_plan
from planner.plan.measures import effort, peak_inputs, turns
from planner.plan.plan import Plan
from planner.problem.problem import Problem
from planner.problem.tables.method_options import CollocationOptions, DesensitisedOptions
from planner.robustness.sensitivity import sensitivity
from planner.support.arrays import Array, Frozen, jsonable
from planner.support.files import make_folder, read_json, write_text
from planner.verification.verdict import load_plan

Kind = Literal["effort", "duration", "peak"]
KINDS: tuple[Kind, ...] = ("effort", "duration", "peak")

CURVE_EFFORT_WEIGHT = 1e-4
"""Largest weight of the effort at a point of the curve, which makes the optimum unique."""

END_EFFORT_WEIGHT = 1e-3
"""Weight of the effort at the costly end, where more effort hardly reduces the response."""

LEAST_FACTOR = 1.02
"""Ratio of a curve's first limit to the least possible limit, which would leave only one plan."""

LONGEST_RATIO = 4.0
"""Ratio of the last duration limit to the least duration, unless the problem's is longer."""


@dataclass(frozen=True, eq=False)
class Axis:
    """The quantity that a trade-off curve limits, and its limits at the m points of the curve.

    Attributes:
        kind: The limited quantity.
        limits: Increasing limits, shape (m,): effort, seconds, or shares of `base` ("peak").
        base: Input limits of which the limits of "peak" are shares, shape (2,).
        least: Plan at the lower end, from which the first point starts.
    """

    kind: Kind
    limits: Array
    base: Array
    least: Plan

    def task_at(
        self, problem: Problem, options: DesensitisedOptions, limit: float
    ) -> tuple[Problem, DesensitisedOptions]:
        """Return the problem and the options for planning the point with this limit."""
        calm = options.model_copy(update={"effort": min(options.effort, CURVE_EFFORT_WEIGHT)})
        if self.kind == "effort":
            return problem, calm.model_copy(update={"effort_limit": limit})
        if self.kind == "duration":
            return problem.changed({"goal.duration": float(limit)}), calm
        return with_input_limits(problem, limit * self.base), calm


def axis(problem: Problem, options: DesensitisedOptions, kind: Kind, points: int) -> Axis:
    """Find the range of a curve's limits, and divide this range into geometric steps.

    Raises:
        InputError: If the duration is free but needed, or a limit on inputs is needed but missing.
        NoPlanError: If the problem has no plan.
    """
    easy = CollocationOptions(rest=options.rest, intervals=options.intervals)
    if kind == "duration":
        quickest = _quickest(problem, easy)
        longest = max(LONGEST_RATIO * quickest.duration, problem.duration or 0.0)
        limits = np.geomspace(LEAST_FACTOR * quickest.duration, longest, points)
        return Axis(kind, limits, problem.limits.input, quickest)
    if problem.duration is None:
        raise InputError(
            f"{problem.source}: a trade-off against {kind} needs goal.duration in seconds; or trade"
            " against duration"
        )
    least = judge_plan(plan_collocation(problem, easy))[0]  # refuses a problem without a plan
    if kind == "effort":
        low, high = (effort(p.trajectory) for p in (least, _costly_end(problem, options)))
        limits = np.geomspace(LEAST_FACTOR * low, max(high, 1.1 * low), points)
        return Axis(kind, limits, problem.limits.input, least)
    # The base of an input is its limit, or without a limit its peak in the plan of `_costly_end`.
    base = problem.limits.input
    if not np.all(np.isfinite(base)):
        peaks = peak_inputs(_costly_end(problem, options).trajectory)
        base = np.where(np.isfinite(base), base, peaks)
    quickest = _quickest(with_input_limits(problem, base), easy)
    lowest = LEAST_FACTOR * quickest.duration / problem.duration  # the systems are driftless
    if lowest >= 1:
        raise InputError(
            f"{problem.source}: goal.duration = {problem.duration:g} s does not allow lower peaks:"
            f" the fastest motion takes {quickest.duration:.4g} s; give more time"
        )
    slow = quickest.trajectory.slowed(problem.duration / quickest.duration)
    guess = replace(quickest, problem=with_input_limits(problem, lowest * base), trajectory=slow)
    return Axis("peak", np.geomspace(lowest, 1.0, points), base, guess)


def _costly_end(problem: Problem, options: DesensitisedOptions) -> Plan:
    """Return the plan at the end of the curve where the effort hardly counts."""
    calm = options.model_copy(update={"effort": END_EFFORT_WEIGHT})
    return judge_plan(plan_desensitised(problem, calm))[0]


def _quickest(problem: Problem, easy: CollocationOptions) -> Plan:
    if not np.all(np.isfinite(problem.limits.input)):
        raise InputError(
            f"{problem.source}: a trade-off against duration needs limits on both inputs: without"
            " them no path has a least duration, and the response depends only on the path"
        )
    fast = easy.model_copy(update={"objective": "time"})
    return judge_plan(plan_collocation(problem.changed({"goal.duration": "free"}), fast))[0]


def with_input_limits(problem: Problem, inputs: Array) -> Problem:
    """Return the problem with other limits on the magnitudes of the inputs."""
    one, other = problem.limits.input_keys
    first, second = map(float, inputs)
    return problem.changed({one: [first, second]} if one == other else {one: first, other: second})


@dataclass(frozen=True)
class TradeOffPoint(Frozen):
    """One point of a trade-off curve: a verified plan and its figures.

    Attributes:
        limit: Limit at this point: effort, duration (s), or share of the input limits.
        plan: The plan.
        effort: ∫ u₁² + u₂² dt.
        duration_s: Duration of the plan, seconds.
        peak_u: Largest |u₁| and |u₂|.
        response_deg: The minimised quantity: root of the weighted mean of the squares of passive
            block and terminal response, with the weights of [method.desensitised].
        passive_deg: Passive block.
        total_deg: Total terminal response.
        floor_deg: The part of `total_deg` that depends only on start and goal.
        reversals: How often the path coordinate reverses, by more than 2 % of its range.
        swept: Number of finished sweeps: 1 upwards, 2 also downwards.
        machine: Percentiles of errors on the problem's machine, degrees; None before the replay.
        errors_alone: Percentiles of errors on a machine with only the design errors, degrees.
        compensated: As `machine`, with the plan compensated for the machine (`planner.compensate`);
            {"refused": why} if the plan cannot be compensated; None before the replay.
    """

    limit: float
    plan: Plan
    effort: float
    duration_s: float
    peak_u: tuple[float, float]
    response_deg: float
    passive_deg: float
    total_deg: float
    floor_deg: float
    reversals: int
    swept: int = 1
    machine: dict[str, Any] | None = None
    errors_alone: dict[str, Any] | None = None
    compensated: dict[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the point as JSON-ready data, without the plan."""
        return {key: value for key, value in vars(self).items() if key != "plan"}


def solved_point(
    problem: Problem, options: DesensitisedOptions, limit: float, near: Plan | None
) -> TradeOffPoint:
    """Return the point at a limit, planned with the desensitised method from `near` if given.

    Raises:
        NoPlanError: If there is no plan, or it fails its verification.
    """
    plan, _ = judge_plan(plan_desensitised(problem, options, near))
    spread = spreads(plan.problem.system, options)
    responses = sensitivity(plan)
    passive, total = responses.passive_block_deg(spread), responses.total_deg(spread)
    weights = np.array([options.passive, options.terminal])
    if not np.any(weights):
        weights = np.ones(2)
    mean = float(weights @ [passive**2, total**2] / np.sum(weights))
    peaks = peak_inputs(plan.trajectory)
    return TradeOffPoint(
        limit=limit,
        plan=plan,
        effort=effort(plan.trajectory),
        duration_s=plan.duration,
        peak_u=(float(peaks[0]), float(peaks[1])),
        response_deg=float(np.sqrt(mean)),
        passive_deg=passive,
        total_deg=total,
        floor_deg=responses.floor_deg(spread),
        reversals=len(turns(plan.trajectory)),
    )


def replay_errors(plan: Plan, machine: Machine, samples: int, seed: int) -> dict[str, Any]:
    """Replay a plan on random machines; return statistics of E (eq. 29) and end error, degrees."""
    run = replay(plan, machine, samples, seed, record_s=None)
    rms = float(np.sqrt(np.mean(np.sum(run.terminal_error_deg**2, axis=1))))
    errors = {name: statistic.of(run) for name, statistic in STATISTICS.items()}
    return {"samples": samples, "seed": seed, **errors, "end_rms_deg": rms}


AIMING_FACTOR = 1.1
"""Factor by which compensation may exceed the effort limit of a point: at the least effort there is
no plan to a shifted goal that lies farther away."""


def compensated_errors(plan: Plan, machine: Machine, samples: int, seed: int) -> dict[str, Any]:
    """Return `replay_errors` of the plan compensated for the machine, or {"refused": why}."""
    options = plan.problem.compensation.model_copy(update={"on": True})
    limit, settings, refused = plan.options.get("effort_limit"), [plan.options], {"refused": ""}
    if limit is not None:
        settings.append({**plan.options, "effort_limit": AIMING_FACTOR * limit})
    for each in settings:
        try:
            informed, _ = compensate_plan(replace(plan, options=each), machine, options)
        except (InputError, NoPlanError) as error:  # not compensable, or no plan ends at the goal
            refused = {"refused": error.sentence}
        else:
            return replay_errors(informed, machine, samples, seed)
    return refused


def errors_machine(problem: Problem, options: DesensitisedOptions) -> Machine:
    """Return a machine whose only errors are those of [method.desensitised].

    These are spreads of input gains and biases, gear ratios and start angles. Delay and stretch are
    left out.
    """
    system, spread = problem.system, spreads(problem.system, options)
    families = {
        "input_gain_error": [f"gain {i.name}" for i in system.inputs],
        "input_bias_rad_s": [f"bias {i.name}" for i in system.inputs],
        "gear_ratio_error": [f"K{i}" for i in range(2, system.size)],
        "initial_angle_error_deg": [f"start {c.name}" for c in system.coordinates[1:]],
    }
    effects = {}
    for name, members in families.items():
        unit = 180 / np.pi if name.endswith("_deg") else 1.0
        values = [spread.get(member, 0.0) * unit for member in members]
        if any(values):
            effects[name] = {"value": 0.0, "spread": values}
    return Machine.ideal(step_s=0.01, **effects)


FORMAT = "planner-trade-off"
VERSION = 1
INDEX = "trade-off.json"


class PointStore:
    """Points by their index on the curve, in memory and, with a folder, on disk.

    A point has a plan, `plans/NN.json`, and an entry in the index `trade-off.json`; both are
    written as soon as the point is found or improved.

    Args:
        path: The folder, created if missing; None saves nothing.
        request: Description of the curve; a folder of another curve is refused.

    Raises:
        InputError: If the folder holds another curve or other files, or cannot be written.
    """

    def __init__(self, path: str | Path | None, request: Mapping[str, Any]) -> None:
        self.path = None if path is None else Path(path)
        self.request = dict(jsonable(request))
        text = json.dumps(self.request, sort_keys=True)
        self.key = hashlib.sha256(text.encode()).hexdigest()[:16]
        self.points: dict[int, TradeOffPoint] = {}
        if self.path is not None:
            self._open(self.path)

    def put(self, place: int, point: TradeOffPoint) -> None:
        """Store a point, and save its plan and the index if there is a folder."""
        self.points[place] = point
        if self.path is None:
            return
        point.plan.save(self.path / "plans" / f"{place:02d}.json")
        data = {
            "format": FORMAT,
            "version": VERSION,
            "key": self.key,
            **self.request,
            "points": {f"{k:02d}": jsonable(p.to_dict()) for k, p in sorted(self.points.items())},
        }
        write_text(self.path / INDEX, json.dumps(data, indent=1, allow_nan=False) + "\n")

    def _open(self, path: Path) -> None:
        make_folder(make_folder(path) / "plans")
        index = path / INDEX
        if not index.exists():
            if any(p.name != "plans" for p in path.iterdir()) or any((path / "plans").iterdir()):
                raise InputError(
                    f"{path} holds files that are not from an earlier run; name another folder"
                )
            return
        names = {f.name for f in fields(TradeOffPoint)} - {"plan"}
        for name, entry in self._read(index)["points"].items():
            plan = load_plan(path / "plans" / f"{name}.json", strict=True)
            self.points[int(name)] = TradeOffPoint(plan=plan, **{k: entry.get(k) for k in names})

    def _read(self, index: Path) -> dict[str, Any]:
        try:
            data = read_json(index)
            same = data["format"] == FORMAT and data["key"] == self.key
            points = data["points"]
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{index} is not a file of a trade-off; name another folder") from None
        if not same or not isinstance(points, dict):
            raise InputError(
                f"{index.parent} holds another trade-off (problem, options, points, samples or seed"
                " differ); name another folder"
            )
        return dict(data)
