"""A plan judged from outside: DOP853 for the motion, samples for its extremes, nothing of verify's.

Plans of random problems, and damages of their files, for both judges.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import planner
from planner.plan.plan_file import read_plan
from planner.plan.trajectory import StateTrajectory
from planner.support.calculus.bernstein import elevate

sys.path.append(str(Path(__file__).parents[1]))  # the suite's own integrator

from outside import integrate

Array = NDArray[np.float64]

CLOSE = 0.2
"""Excess that is off the tolerance by less than this part of it is not told apart."""


def excess(plan: planner.Plan) -> tuple[float, str]:
    """By how much the worst requirement is broken, over `verify`'s tolerance, and which.

    Start, goal, duration, the plan's own q(t), the chart's domain, and limits of inputs, of their
    rates (jumps, and slopes where the inputs are polynomials), of coordinates and of z₂. NaN counts
    as broken.
    """
    worst = -np.inf, ""
    for label, amount in _excesses(plan):
        worst = max(worst, (float(np.nan_to_num(amount, nan=np.inf)), label))
        if worst[0] > 1 + CLOSE:
            break
    return worst


def _excesses(plan: planner.Plan) -> Iterator[tuple[str, float]]:
    """The quick ones first: a motion under absurd inputs takes for ever."""
    problem, system, path = plan.problem, plan.problem.system, plan.trajectory
    limits, names = problem.limits, [c.name for c in plan.problem.system.coordinates]
    yield "start", np.max(np.abs(plan.q(0.0) - problem.start)) / 2e-5
    if problem.duration is not None:
        yield "duration", abs(plan.duration / problem.duration - 1) / 1e-9
    if not path.in_coordinates:
        inside = _least(plan, lambda t: np.min(path.margins(t), axis=-1))
        yield "chart", 0.0 if inside > 0 else np.inf
    for i, limit in enumerate(limits.input):
        peak = -_least(plan, lambda t, i=i: -np.abs(plan.u(t)[..., i]))  # type: ignore[misc]
        yield f"input {i}", (peak / limit - 1) / 1e-6 if np.isfinite(limit) else peak - 1e6
    for i in np.flatnonzero(np.isfinite(limits.input_rate)):
        breaks = plan.t[1:-1]
        before, after = (plan.u(t)[:, i] for t in (np.nextafter(breaks, 0.0), breaks))
        jump = np.max(np.abs(after - before), initial=0.0) / np.max(np.abs(plan.u(plan.t)[:, i]))
        yield f"jump {i}", jump / 1e-6
        if isinstance(path, StateTrajectory):
            slope = path.u_curve.derivative()
            peak = -_least(plan, lambda t, i=i, f=slope: -np.abs(f(t)[..., i]))  # type: ignore[misc]
            yield f"rate {i}", (peak / limits.input_rate[i] - 1) / 1e-6
    motion, times = integrate(plan, rtol=1e-10, atol=1e-11)
    q = motion(times)
    yield "q(t)", np.max(np.abs(plan.q(times) - q)) / 1e-4
    yield "goal", np.nanmax(np.abs(q[-1] - problem.goal)) / 2e-5
    for i in np.flatnonzero(np.isfinite(limits.joint)):
        peak = -_least(plan, lambda t, i=i: -np.abs(motion(t)[..., i]))  # type: ignore[misc]
        yield names[i], (peak / limits.joint[i] - 1) / 1e-6
    if limits.z2_margin is not None:
        chart, side = planner.chained_form(system), problem.z2_sign
        least = _least(plan, lambda t: side * chart.z(motion(t))[..., 1])
        yield "z2", (1 - least / limits.z2_margin) / 1e-6


def _least(plan: planner.Plan, function: Callable[[Array], Array]) -> float:
    """Least value of a function of times (m,): 201 samples a piece, and closer around each dip."""
    share = (1 - np.cos(np.pi * np.arange(201) / 200)) / 2
    left, right = plan.t[:-1, None], np.nextafter(plan.t[1:, None], -np.inf)
    right[-1] = plan.t[-1]
    times = np.minimum(left + (right - left) * share, right)
    values = function(times.ravel()).reshape(times.shape)
    if np.any(np.isnan(values)):
        return np.nan
    walls, low = np.full((len(left), 1), np.inf), float(np.min(values))
    before = np.concatenate([walls, values[:, :-1]], axis=1)
    after = np.concatenate([values[:, 1:], walls], axis=1)
    dips = (values <= before) & (values <= after) & (2 * values - np.maximum(before, after) <= low)
    piece, k = np.nonzero(dips)
    a, b = times[piece, np.maximum(k - 1, 0)], times[piece, np.minimum(k + 1, 200)]
    for _ in range(6):
        closer = a + (b - a) * np.linspace(0, 1, 21)[:, None]
        found = function(closer.ravel()).reshape(closer.shape)
        low = min(low, float(np.min(found)))
        best, row = np.argmin(found, axis=0), np.arange(len(a))
        a, b = closer[np.maximum(best - 1, 0), row], closer[np.minimum(best + 1, 20), row]
    return low


# -- plans and their damages ---------------------------------------------------------------------

Data = dict[str, Any]


def random_plan(rng: np.random.Generator) -> planner.Plan:
    """A plan of a random problem of two or three joints, by a random method; some retimed."""
    while True:
        joints = int(rng.integers(2, 4))
        method = str(rng.choice(["collocation", "polynomial", "piecewise", "convex"]))
        angles = np.round(rng.uniform(5, 65, (2, joints)), 3).tolist()
        duration = float(np.round(rng.uniform(10, 60), 1)) if rng.random() < 0.5 else "free"
        inputs = np.round(rng.uniform(0.2, 1.0, 2), 3).tolist()
        gears = [0.87, 0.71][: joints - 1]
        tables = {
            "system": {"kind": "manipulator", "joints": joints, "K": gears, "k_g": 0.67},
            "start": {"theta_deg": angles[0]},
            "goal": {"theta_deg": angles[1], "travel": "free", "duration": duration},
            "limits": {"input_rad_s": inputs, "joint_deg": 80},
        }
        rates = {"input_rate_rad_s2": [3.0, 2.0]} if rng.random() < 0.5 else {}
        retimed = rng.random() < 0.3
        try:
            plan = planner.solve(planner.Problem.from_dict(tables), method)
            if retimed:
                limits = {"input_rad_s": [0.5, 0.4], **rates}
                plan = planner.retime(plan, limits, rest=bool(rates), intervals=40)
        except planner.PlannerError:
            continue
        return replace(plan, certificate=None)


def damaged(plan: planner.Plan, rng: np.random.Generator, folder: Path) -> tuple[str, Path]:
    """What was done to a plan's file, by a little or much, and the file."""
    path = folder / "damaged.json"
    data = json.loads(plan.save(path).read_text())
    name = str(rng.choice(list(DAMAGES)))
    DAMAGES[name](data, plan, rng)
    path.write_text(json.dumps(data))
    return name, path


def _curves(data: Any) -> list[Data]:
    if not isinstance(data, dict):
        return []
    below = [curve for value in data.values() for curve in _curves(value)]
    return [data] * ("bernstein" in data) + below


def _change(data: Data, rng: np.random.Generator, by: Callable[[Array], Array]) -> None:
    curve = rng.choice(_curves(data["trajectory"]))
    curve["bernstein"] = by(np.array(curve["bernstein"], dtype=float)).tolist()


def _size(rng: np.random.Generator, low: float, high: float) -> float:
    return float(10 ** rng.uniform(low, high) * rng.choice([-1, 1]))


def _one(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    def by(c: Array) -> Array:
        c[tuple(rng.integers(n) for n in c.shape)] += _size(rng, -10, 2)
        return c

    _change(data, rng, by)


def _all(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    _change(data, rng, lambda c: c * (1 + _size(rng, -9, 0)))


def _noise(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    _change(data, rng, lambda c: c + _size(rng, -12, -1) * rng.normal(size=c.shape))


def _swap(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    _change(data, rng, lambda c: np.roll(c, 1, axis=1))


def _wiggle(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    degree = int(rng.integers(16, 50))

    def by(c: Array) -> Array:
        c = elevate(c, max(degree, len(c) - 1))
        own = c[:, rng.integers(c.shape[1])].reshape(len(c), -1)[:, -1]
        own[1:-1] += _size(rng, -8, 1) * (-1.0) ** np.arange(len(c) - 2)
        return c

    _change(data, rng, by)


def _inputs(data: Data, plan: planner.Plan, rng: np.random.Generator) -> None:
    peaks = [-_least(plan, lambda t, i=i: -np.abs(plan.u(t)[..., i])) for i in range(2)]  # type: ignore[misc]
    limits = [peak * (1 + _size(rng, -8, -1)) for peak in peaks]
    data["problem"]["limits"]["input_rad_s"] = limits


def _joints(data: Data, plan: planner.Plan, rng: np.random.Generator) -> None:
    reach = -_least(plan, lambda t: -np.max(np.abs(plan.q(t)[..., 1:]), axis=-1))
    data["problem"]["limits"]["joint_deg"] = float(np.rad2deg(reach)) * (1 + _size(rng, -8, -2))


def _goal(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    data["problem"]["goal"]["theta_deg"][-1] += float(np.rad2deg(_size(rng, -8, -2)))


def _stretched(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    factor = 1 + _size(rng, -12, -1)
    for curve in _curves(data["trajectory"]):
        curve["breaks"] = [t * factor for t in curve["breaks"]]


def _break(data: Data, plan: planner.Plan, rng: np.random.Generator) -> None:
    time, by = float(rng.choice(plan.t)), _size(rng, -10, 0)
    for curve in _curves(data["trajectory"]):
        curve["breaks"] = [t + by if t == time else t for t in curve["breaks"]]


def _form(data: Data, _: planner.Plan, rng: np.random.Generator) -> None:
    curve = _curves(data["trajectory"])[0]
    wrong: list[Callable[[], object]] = [
        lambda: curve["bernstein"][0].pop(),
        lambda: curve["breaks"].reverse(),
        lambda: data.pop("status"),
        lambda: data.update(iterations=-1),
        lambda: curve["bernstein"][0].__setitem__(0, None),
        lambda: _change(data, rng, lambda c: c + 1e300),
    ]
    wrong[rng.integers(len(wrong))]()


DAMAGES: dict[str, Callable[[Data, planner.Plan, np.random.Generator], None]] = {
    "one coefficient moved": _one,
    "a curve scaled": _all,
    "noise on a curve": _noise,
    "pieces in another order": _swap,
    "a wiggle of degree 16 to 49": _wiggle,
    "limits of inputs near their peaks": _inputs,
    "limit of joints near their reach": _joints,
    "the goal moved": _goal,
    "times stretched": _stretched,
    "a break moved": _break,
    "no plan file": _form,
}


# -- both judges -----------------------------------------------------------------------------------

OUTCOMES = ("both accept", "both refuse", "no form", "too close", "FALSE ACCEPT", "FALSE REFUSAL")


def campaign(
    plans: int, damages: int, seed: int, folder: Path
) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Outcomes (what was judged, one of `OUTCOMES`) of so many plans and damaged ones, and what the
    judges disagree about, in words."""
    made = [random_plan(np.random.default_rng((seed, k))) for k in range(plans)]
    tally: Counter[tuple[str, str]] = Counter()
    told = []
    for k, plan in enumerate(made):
        outcome, words = judged(plan.save(folder / "plan.json"))
        tally["plans as they are", outcome] += 1
        told += [f"plan {k}: {words}"] * outcome.isupper()
    for k in range(damages):
        name, path = damaged(made[k % plans], np.random.default_rng((seed, 1, k)), folder)
        outcome, words = judged(path)
        tally[name, outcome] += 1
        told += [f"damage {k} of plan {k % plans}, {name}: {words}"] * outcome.isupper()
    return tally, told


def judged(path: Path) -> tuple[str, str]:
    """The outcome of a file that claims to hold a verified plan, and both verdicts in words."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            found, said = planner.load_plan(path), read_plan(path)
        except planner.InputError as error:
            return "no form", str(error)
        if said.trajectory.flaw:
            assert found.violation
            return "no form", found.violation
        try:
            worst, label = excess(said)
        except AssertionError as error:  # DOP853 gives up
            worst, label = np.inf, str(error)
    words = f"{found.violation or 'accepted'}; from outside {worst:.4g} tolerances ({label})"
    if abs(worst - 1) < CLOSE:
        return "too close", words
    if found.verified == (worst < 1):
        return ("both accept" if found.verified else "both refuse"), words
    return ("FALSE ACCEPT" if found.verified else "FALSE REFUSAL"), words
