"""Jobs that people wait for, timed in the version of `planner` that Python finds.

    python tests/benchmarks/jobs.py JOB    prints the processor seconds of each of its cases

`beside.py` runs them in turns with two versions. So they use only names that both have.
"""

from __future__ import annotations

import contextlib
import json
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from stress_problems import arm, random_pair

import planner

PROBLEMS = Path(__file__).parents[2] / "problems"
Calls = Iterator[Callable[[], object]]

LAWS = ("polynomial", "piecewise", "sinusoid", "sinusoid_steps")
METHODS = ("collocation", *LAWS)
PAIRS, LONG, HARD = 12, 6, 8
"""Random pairs beside a post, of four joints, and with a post in the way."""

REACH_M, SECONDS = 3.0, 30.0
"""Length of the arm of three links, and duration of its motions beside posts."""


def paper(**changes: Any) -> planner.Problem:
    """The paper's problem."""
    names = {name.replace("__", "."): value for name, value in changes.items()}
    return planner.load_problem(PROBLEMS / "paper.toml", names)


def plans() -> Calls:
    """Collocation and the laws in 20 s."""
    for method in METHODS:
        yield lambda method=method: planner.solve(paper(goal__duration=20.0), method)


def refusals() -> Calls:
    """The laws where 6 s are too short, with the advice."""
    for method in LAWS:
        yield lambda method=method: planner.solve(paper(goal__duration=6.0), method)


def beside_post() -> Calls:
    """Three joints beside one ordinary post that start and goal clear."""
    for number in range(PAIRS):
        yield with_posts(*_pair(number, in_the_way=False))


def post_in_the_way() -> Calls:
    """The same where the post stands where the straight way would pass."""
    for number in range(HARD):
        yield with_posts(*_pair(number, in_the_way=True))


def same_post() -> Calls:
    """A post beside the way, written twelve times."""
    start, goal, post = _pair(0, in_the_way=False)
    yield with_posts(start, goal, post, times=12)


def with_posts(start: Any, goal: Any, post: Any, times: int = 1) -> Callable[[], object]:
    """Plan a pair of poses beside a post."""
    x, y, radius = (round(float(value), 3) for value in post)
    tables = arm("manipulator", 3, np.round(start, 3).tolist(), np.round(goal, 3).tolist(), 80.0)
    tables["goal"]["duration"] = SECONDS
    tables["system"]["link_lengths"] = [REACH_M / 3] * 3
    tables["obstacles"] = [{"centre_m": [x, y], "radius_m": radius}] * times
    problem = planner.Problem.from_dict(tables)
    return lambda: planner.solve(problem, "collocation")


def _pair(number: int, in_the_way: bool) -> tuple[Any, Any, Any]:
    """Start and goal in degrees, and x, y, radius in m of a post that both clear by 5 cm."""
    rng = np.random.default_rng((61, number, in_the_way))
    while True:
        start, goal = rng.uniform(-50.0, 50.0, (2, 3))
        radius = rng.uniform(0.1, 0.3)
        if in_the_way:
            *_, tip = _points((start + goal) / 2)
            centre = tip * rng.uniform(0.85, 1.0)
        else:
            angle = rng.uniform(-np.pi / 2, np.pi / 2)
            centre = rng.uniform(1.0, 3.3) * np.array([np.cos(angle), np.sin(angle)])
        clear = [_distance(centre, _points(pose)) > radius + 0.05 for pose in (start, goal)]
        if all(clear) and np.max(np.abs(goal - start)) > 25:
            return start, goal, (*centre, radius)


def _points(pose: Any) -> Any:
    """Base, joints and tip of the arm, shape (4, 2), m."""
    angles = np.cumsum(np.deg2rad(pose))
    steps = REACH_M / 3 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def _distance(centre: Any, points: Any) -> float:
    """Of a place from the links, m."""
    along = np.linspace(0.0, 1.0, 50)[:, None]
    links = [a + along * (b - a) for a, b in pairwise(points)]
    return float(np.min(np.linalg.norm(np.concatenate(links) - centre, axis=1)))


def four_joints() -> Calls:
    """The fastest plan of four joints within 40 degrees."""
    return _four("free")


def four_joints_refused() -> Calls:
    """The same pairs in 1 s."""
    return _four(1.0)


def _four(duration: Any) -> Calls:
    for number in range(LONG):
        problem = planner.Problem.from_dict(random_pair(4, 40.0, number, duration))
        yield lambda problem=problem: planner.solve(problem, "collocation")


def replays() -> Calls:
    """1000 machines, 100 with inertia, 100 with feedback."""
    plan = planner.solve(paper(), "collocation")
    machine, heavy = planner.Machine.prototype(), planner.Machine.prototype(fidelity="dynamic")
    yield lambda: planner.replay(plan, machine, 1000, record_s=None)
    yield lambda: planner.replay(plan, heavy, 100, record_s=None)
    yield lambda: planner.replay(plan, machine, 100, record_s=None, feedback=True)


def timing() -> Calls:
    """The fastest timing of a planned path within limits on speed and acceleration."""
    plan = planner.solve(paper(), "collocation")
    yield lambda: planner.retime(plan, {"input_rad_s": 0.5, "input_rate_rad_s2": 1.0})


def commands() -> Calls:
    """`planner --help`, `planner compare`, and the same with its folder of pictures and pages."""
    compare = ["compare", str(PROBLEMS / "paper.toml"), "--quiet"]
    for words in (["--help"], compare, [*compare, "--out", "out/beside"]):
        yield lambda words=words: subprocess.run(
            # -P: the folder, which is a checkout, must not hide the version that is timed.
            [sys.executable, "-P", "-m", "planner", *words],
            check=True,
            stdout=subprocess.DEVNULL,
        )


JOBS: dict[str, Callable[[], Calls]] = {
    job.__name__: job
    for job in (
        plans,
        refusals,
        beside_post,
        post_in_the_way,
        same_post,
        four_joints,
        four_joints_refused,
        replays,
        timing,
        commands,
    )
}


def cpu_s() -> float:
    """Processor seconds of this process and of those that it has waited for."""
    waited = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + waited.ru_utime + waited.ru_stime


def main(name: str) -> None:
    """Time each case of a job; the imports of a first solve are not in the times."""
    warnings.simplefilter("ignore")
    planner.solve(paper(), "collocation")
    seconds, solved = [], []
    for call in JOBS[name]():
        began = cpu_s()
        with contextlib.suppress(planner.PlannerError):
            call()
            solved.append(len(seconds))
        seconds.append(cpu_s() - began)
    print(json.dumps({"seconds": seconds, "solved": solved}))


if __name__ == "__main__":
    main(*sys.argv[1:])
