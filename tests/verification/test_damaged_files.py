"""Plan files damaged at random: read with one of our errors, or judged as an integrator of the
tests' own judges them."""

from __future__ import annotations

import json
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outside import integrate

import planner

DAMAGES = 40
"""Of each plan; the seed is fixed."""

WRONG: tuple[Any, ...] = (
    None, True, "", "x" * 3000, -1, 10**400, 1e15, -1e300, float("nan"), float("inf"), [], {},
    [[]], ["a"], {"a": 1}, [None] * 5,
)  # fmt: skip


Place = tuple[Any, ...]


def places(data: Any, path: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Every value and where it is, those that hold others too."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*path, key), value
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def damage(text: str, rng: np.random.Generator) -> str:
    """The text of a plan file in which a number is changed, or two, or something is wrong."""
    data = json.loads(text)
    every = list(places(data))
    numbers = [place for place, value in every if isinstance(value, float)]
    tops = [place for place, _ in every if len(place) < 4]
    for _ in range(rng.integers(1, 3)):
        is_number = rng.random() < 0.75
        of = numbers if is_number else tops
        *path, last = of[rng.integers(len(of))]
        holder = data
        for key in path:
            holder = holder[key]
        if is_number:
            holder[last] *= 1 + 10 ** rng.uniform(-10, 0)
            holder[last] += 10 ** rng.uniform(-14, -2)
            continue
        if rng.random() < 0.7:
            holder[last] = WRONG[rng.integers(len(WRONG))]
        else:
            del holder[last]
        break  # other places may be gone
    out = json.dumps(data)
    return out if rng.random() > 0.05 else out[: rng.integers(len(out))]


def broken_outside(plan: planner.Plan) -> float:
    """By how many tolerances of `verify` the worst of goal, inputs, joints and q(t) is broken."""
    problem, (motion, times) = plan.problem, integrate(plan, rtol=1e-8, atol=1e-9)
    q, u = motion(times), plan.u(times)
    worst = [
        np.nanmax(np.abs(q[-1] - problem.goal)) / 2e-5,
        np.max(np.abs(plan.q(times) - q)) / 1e-4,
        np.max(np.abs(plan.q(0.0) - problem.start)) / 2e-5,
        np.max(np.abs(u).max(axis=0) / problem.limits.input - 1) / 1e-6,
        np.max(np.abs(q).max(axis=0) / problem.limits.joint - 1) / 1e-6,
    ]
    return float(np.max(worst))


@pytest.mark.parametrize("name", ["law", "optimal", "retimed"])
def test_a_damaged_file_is_refused_or_judged_rightly(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    plan: planner.Plan = request.getfixturevalue(name)
    text, path, seen = plan.to_json(), tmp_path / "damaged.json", Counter[str]()
    for seed in range(DAMAGES):
        path.write_text(damage(text, np.random.default_rng((39, seed))))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", planner.InputWarning)
            try:
                back = planner.load_plan(path)
            except planner.InputError:
                seen["refused"] += 1
                continue
        if not back.verified:
            seen["not verified"] += 1
            continue
        same = back.trajectory == plan.trajectory and back.problem == plan.problem
        seen["verified"] += 1
        assert same or broken_outside(back) < 1.2, seed
        if not back.file_figures:
            assert back.objective == pytest.approx(plan.objective, rel=1e-3), seed
    assert len(seen) == 3, seen
    assert min(seen.values()) >= 5, seen
