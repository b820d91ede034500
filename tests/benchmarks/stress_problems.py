"""The problems of the stress campaign, and the order in which they come.

Kinds: "plain" has joint limits of 80 degrees and a free duration; "narrow" limits drawn from 40 to
80 degrees, the angles with them; "x1.5" is the pair of the plain one with the same number, in 1.5
times the shortest duration found for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import planner

SEED = 52
"""No constant of the search was chosen on these problems."""

ARM = ("one-way", "positive", "crossing", "zero", "singular")
GROUPS = {
    "n2": (ARM, 100, 0.15),
    "n3": (ARM, 178, 0.15),
    "n4": (ARM, 34, 1.0),
    "n5": (ARM, 7, 1.0),
    "n6": (ARM, 2, 1.0),
    "systems": (("trailers", "ball-gear", "custom"), 23, 0.3),
}
"""Families, problems of each family and kind, and at what share of the order they are done."""

SHARES = (1.02, 1.5, 4.0)
WIDE, NARROW, SPREAD, NEAR, INPUT = 80.0, (40.0, 80.0), 75 / 80, 0.5, 0.5
"""Joint limits in degrees; share of them that angles are drawn from; "singular" angles in degrees;
limits of the inputs in rad/s."""

RATIO, K2, K_G = 0.8178, 0.870125, 0.668811
"""The prototype's proportions, for any number of joints."""


@dataclass(frozen=True)
class Case:
    """One problem; `number` counts those of its group, family and kind."""

    group: str
    family: str
    kind: str
    number: int

    @property
    def share(self) -> float | None:
        """Times the shortest duration that is given; None where it is free."""
        return float(self.kind[1:]) if self.kind.startswith("x") else None


def order() -> list[Case]:
    """All cases, so that those begun first are a fair sample."""
    placed = []
    for group, (families, count, by) in GROUPS.items():
        size = len(families)
        mixed = [
            (number, i % size, (i // size + i % size) % 3)
            for number in range(count)
            for i in range(3 * size)
        ]
        for j, (number, f, k) in enumerate(mixed):
            kind = ("plain", "narrow", f"x{SHARES[(number + f) % 3]:g}")[k]
            placed.append((by * (j + 0.5) / len(mixed), Case(group, families[f], kind, number)))
    return [case for _, case in sorted(placed, key=lambda each: each[0])]


def data(case: Case, duration: float | None) -> dict[str, Any]:
    """The tables of the problem file."""
    narrow, groups = case.kind == "narrow", list(GROUPS)
    families = GROUPS[case.group][0]
    identity = SEED, groups.index(case.group), families.index(case.family), case.number, narrow
    rng = np.random.default_rng(identity)
    limit = round(float(rng.uniform(*NARROW)), 1) if narrow else WIDE
    if case.group != "systems":
        joints = int(case.group[1:])
        start, goal = ends(case.family, joints, limit, rng)
        tables = arm("manipulator", joints, start, goal, limit)
        tables["goal"]["travel"] = 0.0 if case.family == "zero" else "free"
    elif case.family == "ball-gear":
        joints = 2 + case.number % 3
        start, goal = ends("crossing", joints, limit, rng)
        tables = arm("ball-gear", joints, start, goal, limit)
    elif case.family == "trailers":
        tables = trailers(1 + case.number % 2, limit / WIDE, rng)
    else:
        tables = (planimeter, chained)[case.number % 2](limit, rng)
    tables["goal"]["duration"] = duration or "free"
    return tables


def ends(family: str, joints: int, limit: float, rng: np.random.Generator) -> list[list[float]]:
    """Angles at start and goal in degrees, within joint limits in degrees.

    one-way: where a random motion leads whose drive never turns back; positive: all above one
    degree; crossing, zero: anywhere; singular: within half a degree of zero in every joint.
    """
    if family == "one-way":
        pair = one_way(joints, limit * SPREAD, rng)
    else:
        wide = {"singular": NEAR}.get(family, limit * SPREAD)
        pair = rng.uniform(1.0 if family == "positive" else -wide, wide, (2, joints))
    both: list[list[float]] = np.round(pair, 3).tolist()
    return both


def arm(kind: str, joints: int, start: Any, goal: Any, limit: float) -> dict[str, Any]:
    """An arm with the prototype's proportions: k_i falls by the same ratio."""
    gears = [K2 * RATIO**k for k in range(joints - 1)]
    return {
        "system": {"kind": kind, "joints": joints, "K": gears, "k_g": K_G},
        "start": {"theta_deg": start},
        "goal": {"theta_deg": goal, "travel": "free"},
        "limits": {"input_rad_s": [INPUT, INPUT], "joint_deg": limit},
    }


PAIR_SEED = 77
"""No constant of the search was chosen on pairs beyond the first twelve of a number of joints and a
limit."""


def random_pair(joints: int, limit: float, number: int, duration: Any) -> dict[str, Any]:
    """An arm between poses drawn within its joint limits, degrees, in a duration, s or "free"."""
    rng = np.random.default_rng((PAIR_SEED, joints, int(limit), number))
    start, goal = np.round(rng.uniform(-limit * SPREAD, limit * SPREAD, (2, joints)), 3).tolist()
    tables = arm("manipulator", joints, start, goal, limit)
    tables["goal"]["duration"] = duration
    return tables


def one_way(joints: int, spread: float, rng: np.random.Generator) -> Any:
    """Start and end of a random motion with u1 > 0 within `spread` degrees."""
    rest = [0.0] * joints
    system = planner.Problem.from_dict(arm("manipulator", joints, rest, rest, WIDE)).system
    while True:
        start = np.append(0.0, np.deg2rad(rng.uniform(-spread, spread / 2, joints)))
        knots = np.append(start[1], np.deg2rad(rng.uniform(-spread, spread, 4)))
        far = rng.uniform(0.3, 3.0)

        def rates(s: float, q: Any, knots: Any = knots, far: Any = far) -> Any:
            return system.rates(q, np.array([far, 4 * np.diff(knots)[min(int(4 * s), 3)]]))

        path = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-10, atol=1e-10, max_step=0.05).y
        if np.all(np.abs(path[1:]) <= np.deg2rad(spread)):
            return np.rad2deg([start[1:], path[1:, -1]])


def trailers(count: int, room: float, rng: np.random.Generator) -> dict[str, Any]:
    """A car with trailers anywhere within 20 m along and 4 m aside; limits of 45 and 60 degrees,
    times `room`."""

    def pose(x: float, y: float) -> dict[str, Any]:
        heading, steering, *hitches = np.round(rng.uniform(-30, 30, 2 + count) * room, 3).tolist()
        angles = {"heading_deg": heading, "steering_deg": steering, "hitch_deg": hitches}
        return {"x_m": round(x, 3), "y_m": round(y, 3), **angles}

    return {
        "system": {"kind": "trailers", "wheelbase_m": 2.0, "trailer_lengths_m": [2.0, 1.5][:count]},
        "start": pose(0.0, 0.0),
        "goal": pose(float(rng.uniform(-20, 20)), float(rng.uniform(-4, 4))),
        "limits": {
            "speed_m_s": 2.0,
            "steering_rate_rad_s": 1.0,
            "steering_deg": 45 * room,
            "hitch_deg": 60 * room,
        },
    }


def planimeter(limit: float, rng: np.random.Generator) -> dict[str, Any]:
    """A unicycle that measures the area under its path, with a limit on its heading."""
    heading = float(np.deg2rad(limit))
    names, sizes = ("heading", "y", "area"), np.array([SPREAD * heading, 1.0, 1.0])
    start, goal = rng.uniform(-sizes, sizes, (2, 3))
    return {
        "system": {
            "kind": "custom",
            "coordinates": ["x", *names],
            "units": ["m", "rad", "m", "m2"],
            "slopes": ["tan(heading)", "y"],
            "drive": "cos(heading)",
            "intervals": {"y": [-3.0, 3.0]},
        },
        "start": {"q": {"x": 0.0, **dict(zip(names, start.tolist(), strict=True))}},
        "goal": {"q": dict(zip(names, goal.tolist(), strict=True)), "travel": "free"},
        "limits": {"input": [0.5, 1.0], "q": {"heading": heading, "y": 2.5}},
    }


def chained(limit: float, rng: np.random.Generator) -> dict[str, Any]:
    """The chained form itself, four coordinates within limit/40."""
    names = ("z2", "z3", "z4")
    start, goal = rng.uniform(-1.0, 1.0, (2, 3)) * SPREAD * limit / 40
    return {
        "system": {
            "kind": "custom",
            "coordinates": ["z1", *names],
            "units": [""] * 4,
            "slopes": ["z2", "z3"],
            "intervals": {"z2": [-5.0, 5.0], "z3": [-5.0, 5.0]},
        },
        "start": {"q": {"z1": 0.0, **dict(zip(names, start.tolist(), strict=True))}},
        "goal": {"q": dict(zip(names, goal.tolist(), strict=True)), "travel": "free"},
        "limits": {"input": INPUT, "q": dict.fromkeys(names, limit / 40)},
    }
