"""Examples of other projects beside ours: `make peers` writes results/peers.

    python tests/benchmarks/peers.py [--environment .venv/peers]

The projects are installed into an environment of their own, in which `peers_theirs.py` runs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import venv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import peers_theirs as theirs
from scipy.interpolate import CubicSpline

import planner
from planner.plan.fastest_timing import cut_path, fastest_clock
from planner.plan.retimed import arc_length
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.report.result_folder import folder
from planner.support.package import provenance
from planner.support.tables import Column, markdown_table

ROOT = Path(__file__).parents[2]
SLOPE = float(np.tan(theirs.TURN))


@dataclass(frozen=True)
class SpeedRange(Requirement):
    """low <= u1 <= high."""

    low: float
    high: float
    key, reads, speed_power = "speed_range", frozenset({"u"}), 1
    table = list[float], "Least and largest u1.", [0.0, 1.0]

    @classmethod
    def of(cls, value: Any, _: Any) -> SpeedRange:
        return cls(*value)

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("speed", "m/s", self.low, self.high, self.high - self.low),)

    def rows(self, point: MotionPoint) -> list[Any]:
        return [point.u[0]]


@dataclass(frozen=True)
class TurnPerSpeed(Requirement):
    """|u2| <= most u1: a steering angle of at most arctan(most), forward only."""

    most: float
    key, reads, speed_power = "turn_per_speed", frozenset({"u"}), 1
    table, row_fields = (float, "Largest u2 / u1, forward only.", 0.5), ("most",)

    @classmethod
    def of(cls, value: Any, _: Any) -> TurnPerSpeed:
        return cls(value)

    @property
    def parts(self) -> tuple[Part, ...]:
        return tuple(Part(f"turn to the {side}", "", 0.0, np.inf) for side in ("left", "right"))

    def rows(self, point: MotionPoint) -> list[Any]:
        return [self.most * point.u[0] - point.u[1], self.most * point.u[0] + point.u[1]]


@dataclass(frozen=True)
class Post(Requirement):
    """The place keeps off a disc."""

    x: float
    y: float
    radius: float
    key, reads = "post", frozenset({"q"})
    table, row_fields = (list[float], "Centre x, y and radius, m.", [5.0, 0.0, 1.0]), ("x", "y")

    @classmethod
    def of(cls, value: Any, _: Any) -> Post:
        return cls(*value)

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("post", "m2", self.radius**2, np.inf, self.radius**2),)

    def rows(self, point: MotionPoint) -> list[Any]:
        return [(point.q[0] - self.x) ** 2 + (point.q[2] - self.y) ** 2]


def lane(limits: Mapping[str, Any]) -> planner.Problem:
    """python-control's change of lane."""
    (x, y, _), (x_end, y_end, _), seconds = theirs.LANE
    return planner.Problem.from_dict(
        {
            "system": {"kind": "car", "wheelbase_m": theirs.WHEELBASE},
            "start": {"x_m": x, "y_m": y},
            "goal": {"x_m": x_end, "y_m": y_end, "duration": seconds},
            "limits": dict(limits),
        }
    )


def past_disc() -> planner.Problem:
    """rockit's bicycle, turned by 90 degrees; its steering angle is an input, so it has no state of
    its own."""
    (x, y, radius), (x_end, y_end) = theirs.DISC, theirs.DISC_GOAL
    return planner.Problem.from_dict(
        {
            "system": {
                "kind": "custom",
                "name": "bicycle",
                "coordinates": ["x", "heading", "y"],
                "units": ["m", "rad", "m"],
                "slopes": ["tan(heading)"],
                "drive": "cos(heading)",
                "inputs": ["speed", "turn_rate"],
                "input_units": ["m/s", "rad/s"],
                "user": {  # its own names of the same numbers: only these may be free at a goal
                    "coordinates": ["ahead", "heading", "aside"],
                    "units": ["m", "rad", "m"],
                    "expressions": ["x", "heading", "y"],
                    "inverse": ["ahead", "heading", "aside"],
                },
            },
            "start": {"q": {"ahead": 0.0, "heading": 0.0, "aside": 0.0}},
            "goal": {
                "q": {"ahead": y_end, "heading": "free", "aside": -x_end},
                "duration": "free",
            },
            "limits": {"input": [1.0, SLOPE], "turn_per_speed": SLOPE, "post": [y, -x, radius]},
        }
    )


@dataclass
class Spline:
    """A path of two joints through random points."""

    curve: CubicSpline

    @property
    def breaks(self) -> np.ndarray:
        return np.asarray(self.curve.x)

    @property
    def duration(self) -> float:
        return float(self.curve.x[-1])

    def u(self, times: np.ndarray) -> np.ndarray:
        return np.asarray(self.curve(times, 1))


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """The answer, and processor seconds, the least of three."""
    seconds = []
    for _ in range(3):
        began = time.process_time()
        answer = call()
        seconds.append(time.process_time() - began)
    return answer, min(seconds)


def timing(seed: int) -> tuple[float, float]:
    """Duration of toppra's path, and seconds."""
    points, speed, rate = theirs.random_path(seed)
    path: Any = Spline(CubicSpline(np.linspace(0.0, 1.0, 5), points))

    def fastest() -> float:
        length = arc_length(path, speed, "euclid")
        cut = cut_path(path, length, speed, theirs.GRID, rest=True)
        return float(fastest_clock(cut, speed, rate).x[-1])

    return timed(fastest)


def answers_of(environment: Path) -> dict[str, Any]:
    """Install the projects, if they are not there, and run their half."""
    python = environment / "bin/python"
    if not python.exists():
        venv.create(environment, with_pip=True)
    wanted = [f"{name}=={version}" for name, version in theirs.PEERS.items()]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *wanted], check=True)
    done = subprocess.run(
        [python, theirs.__file__], check=True, capture_output=True, text=True, cwd=environment
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def table(found: Mapping[str, Any]) -> tuple[list[dict[str, str]], float]:
    """The rows, and the distance of the two quintics, m."""
    for each in (SpeedRange, TurnPerSpeed, Post):
        planner.register_requirement(each)
    quintic, used = timed(lambda: planner.solve(lane({}), "polynomial"))
    t = np.linspace(0.0, quintic.duration, 2001)
    x, steering, _, y = quintic.q(t).T
    one = found["lane_quintic"]
    apart = float(np.max(np.abs(np.interp(one["x"], x, y) - one["y"])))
    rows = [
        {
            "example": "python-control: kincar-flatsys.py, 1, lane change, quintic",
            "what": "largest steering angle (rad)",
            "theirs": f"{one['steering']:.5f}",
            "ours": f"{np.max(np.abs(steering)):.5f}",
            "their_s": f"{one['seconds']:.2g}",
            "our_s": f"{used:.2g}",
        }
    ]
    limits = {
        "steering_deg": float(np.rad2deg(theirs.MOST_STEERING)),
        "speed_m_s": theirs.SPEEDS[1],
        "speed_range": list(theirs.SPEEDS),
    }
    plan, used = timed(lambda: planner.solve(lane(limits)))
    steering = plan.q(np.linspace(0.0, plan.duration, 4001))[:, 1]
    one = found["lane_bounded"]
    rows.append(
        {
            "example": "python-control: kincar-flatsys.py, 3, lane change, bounded",
            "what": f"largest steering angle (rad), allowed {theirs.MOST_STEERING:g}",
            "theirs": f"{one['steering']:.5f} ({one['at_points']:.5f} at its points)",
            "ours": f"{np.max(np.abs(steering)):.5f}",
            "their_s": f"{one['seconds']:.2g}",
            "our_s": f"{used:.2g}",
        }
    )
    plan, used = timed(lambda: planner.solve(past_disc()))
    q = plan.q(np.linspace(0.0, plan.duration, 4001))
    (x0, y0, radius), one = theirs.DISC, found["disc"]
    clear = np.min(np.hypot(q[:, 0] - y0, q[:, 2] + x0)) - radius
    rows.append(
        {
            "example": "rockit: motion_planning.py, past a disc in least time",
            "what": "duration (s); clearance of the disc (m)",
            "theirs": f"{one['duration']:.4f}; {one['clearance']:.1g}",
            "ours": f"{plan.duration:.4f}; {clear:.1g}",
            "their_s": f"{one['seconds']:.2g}",
            "our_s": f"{used:.2g}",
        }
    )
    one = found["timings"]
    pairs = [timing(seed) for seed in range(theirs.PATHS)]
    above = [np.array(some) / one["fine"] - 1 for some in (one["durations"], [d for d, _ in pairs])]
    rows.append(
        {
            "example": "toppra: plot_kinematics.py, fastest timings",
            "what": "above a fine grid, median and most (%)",
            "theirs": f"{100 * np.median(above[0]):.2f}, {100 * np.max(above[0]):.2f}",
            "ours": f"{100 * np.median(above[1]):.2f}, {100 * np.max(above[1]):.2f}",
            "their_s": f"{one['seconds'] / theirs.PATHS:.2g} a path",
            "our_s": f"{sum(s for _, s in pairs) / theirs.PATHS:.2g} a path",
        }
    )
    return rows, apart


COLUMNS: list[Column[dict[str, str]]] = [
    Column(head, "", lambda row, key=key: row[key], left=True)  # type: ignore[misc]
    for key, head in {
        "example": "project: example",
        "what": "what is compared",
        "theirs": "theirs",
        "ours": "ours",
        "their_s": "theirs (s)",
        "our_s": "ours (s)",
    }.items()
]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both halves and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--environment", type=Path, default=Path(sys.prefix) / "peers")
    parser.add_argument("--out", type=Path, default=ROOT / "results/peers")
    options = parser.parse_args(arguments)
    found = answers_of(options.environment)
    rows, apart = table(found)
    page = (
        (ROOT / "tests/benchmarks/peers.md")
        .read_text(encoding="utf-8")
        .format(
            provenance=provenance("make peers"),
            versions="With " + ", ".join(f"{n} {v}" for n, v in found["versions"].items()) + ".",
            table=markdown_table(COLUMNS, rows),
            quintic=apart,
            nodes=20,
            paths=theirs.PATHS,
            grid=theirs.GRID,
            fine=theirs.FINE,
        )
    )
    with folder(options.out) as out:
        (out / "README.md").write_text(page, encoding="utf-8")
    print(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
