"""Examples of other projects in the projects' own terms; `peers.py` runs this in their environment.

    python tests/benchmarks/peers_theirs.py [name ...]     # JSON: answers and seconds of each

Problems are those of the projects' examples, restated here. Seconds are processor time of the call
that solves, the least of three.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

WHEELBASE, LANE = 3.0, ([0.0, -2.0, 0.0], [40.0, 2.0, 0.0], 4.0)
MOST_STEERING, SPEEDS = 0.1, (8.0, 12.0)
DISC, DISC_GOAL, TURN = (0.2, 5.0, 1.0), (0.0, 10.0), np.pi / 6
PATHS, GRID, FINE = 20, 400, 6400
PEERS = {"control": "0.10.2", "toppra": "0.6.10", "rockit-meco": "0.6.7"}


def random_path(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five random points of two joints, limits on speed and on acceleration, as toppra's example
    draws them for seven joints."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (5, 2)), 10 + rng.random(2) * 20, 10 + rng.random(2) * 2


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    seconds = []
    for _ in range(3):
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            answer = call()
        seconds.append(time.process_time() - began)
    return answer, min(seconds)


def _car() -> Any:
    """The kinematic car; flat output is its rear axle's place."""
    import control.flatsys as fs

    def flag(x: Any, u: Any, _: Any = None) -> list[np.ndarray]:
        c, s = np.cos(x[2]), np.sin(x[2])
        turn = u[0] ** 2 * np.tan(u[1]) / WHEELBASE
        return [np.array([x[0], u[0] * c, -turn * s]), np.array([x[1], u[0] * s, turn * c])]

    def state(z: Any, _: Any = None) -> tuple[np.ndarray, np.ndarray]:
        heading = np.arctan2(z[1][1], z[0][1])
        speed = np.hypot(z[0][1], z[1][1])
        across = z[1][2] * np.cos(heading) - z[0][2] * np.sin(heading)
        steering = np.arctan2(WHEELBASE * across, speed**2)
        return np.array([z[0][0], z[1][0], heading]), np.array([speed, steering])

    def rates(_: float, x: Any, u: Any, __: Any) -> np.ndarray:
        return np.array([u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[0] * np.tan(u[1]) / WHEELBASE])

    names = {"inputs": 2, "outputs": 3, "states": 3}
    return fs.FlatSystem(flag, state, rates, **names)


def lane_quintic() -> dict[str, Any]:
    """python-control: point to point by polynomials of degree 5."""
    import control.flatsys as fs

    start, goal, seconds = LANE
    car, ends = _car(), ([10.0, 0.0], [10.0, 0.0])
    family = fs.PolyFamily(6)
    path, used = _timed(
        lambda: fs.point_to_point(car, seconds, start, ends[0], goal, ends[1], basis=family)
    )
    x, u = path.eval(np.linspace(0.0, seconds, 401))
    return {"x": x[0].tolist(), "y": x[1].tolist(), "steering": _most(u[1]), "seconds": used}


def lane_bounded() -> dict[str, Any]:
    """python-control: the same with limits on speed and steering, kept at ten points of time."""
    import control.flatsys as fs
    import control.optimal as opt

    start, goal, seconds = LANE
    car, rest = _car(), [10.0, 0.0]
    points = np.linspace(0.0, seconds, 10)
    low, high = [SPEEDS[0], -MOST_STEERING], [SPEEDS[1], MOST_STEERING]
    cost = opt.quadratic_cost(car, np.diag([0.0, 0.1, 0.0]), np.diag([0.1, 1.0]), x0=goal, u0=rest)
    more = {
        "cost": cost,
        "constraints": [opt.input_range_constraint(car, low, high)],
        "basis": fs.BSplineFamily([0.0, seconds / 2, seconds], 6),
    }
    path, used = _timed(lambda: fs.point_to_point(car, points, start, rest, goal, rest, **more))
    at_points = path.eval(points)[1]
    _, u = path.eval(np.linspace(0.0, seconds, 4001))
    return {
        "steering": _most(u[1]),
        "at_points": _most(at_points[1]),
        "speeds": [float(u[0].min()), float(u[0].max())],
        "seconds": used,
    }


def disc() -> dict[str, Any]:
    """rockit: a bicycle past a disc in least time, by multiple shooting."""
    import casadi as ca
    import rockit

    def solve() -> Any:
        ocp = rockit.Ocp(T=rockit.FreeTime(10.0))
        x, y, heading = ocp.state(), ocp.state(), ocp.state()
        steering, speed = ocp.control(), ocp.control()
        turn, slowest = TURN, 0
        ocp.set_der(x, speed * ca.cos(heading))
        ocp.set_der(y, speed * ca.sin(heading))
        ocp.set_der(heading, speed * ca.tan(steering))
        for state, value in ((x, 0.0), (y, 0.0), (heading, np.pi / 2)):
            ocp.subject_to(ocp.at_t0(state) == value)
        ocp.subject_to(ocp.at_tf(x) == DISC_GOAL[0])
        ocp.subject_to(ocp.at_tf(y) == DISC_GOAL[1])
        ocp.set_initial(y, ocp.t)
        ocp.set_initial(heading, np.pi / 2)
        ocp.set_initial(speed, 1)
        ocp.subject_to(slowest <= (speed <= 1))
        ocp.subject_to(-turn <= (steering <= turn))
        ocp.subject_to((x - DISC[0]) ** 2 + (y - DISC[1]) ** 2 >= DISC[2] ** 2)
        ocp.add_objective(ocp.T)
        ocp.solver("ipopt", {"ipopt": {"print_level": 0, "sb": "yes"}, "print_time": False})
        ocp.method(rockit.MultipleShooting(N=20, M=4, intg="rk"))
        found = ocp.solve()
        return found, x, y

    (found, x, y), used = _timed(solve)
    t, places = found.sample(x, grid="integrator", refine=20)
    across = found.sample(y, grid="integrator", refine=20)[1]
    least = np.min(np.hypot(places - DISC[0], across - DISC[1])) - DISC[2]
    return {"duration": float(t[-1]), "clearance": float(least), "seconds": used}


def timings() -> dict[str, Any]:
    """toppra: the fastest timing of random paths within limits on speed and acceleration."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    out: dict[str, Any] = {"durations": [], "fine": [], "seconds": 0.0}
    for seed in range(PATHS):
        points, speed, rate = random_path(seed)
        path = toppra.SplineInterpolator(np.linspace(0.0, 1.0, 5), points)

        def fastest(count: int, path: Any = path, speed: Any = speed, rate: Any = rate) -> float:
            limits = [
                constraint.JointVelocityConstraint(speed),
                constraint.JointAccelerationConstraint(rate),
            ]
            grid = np.linspace(0.0, 1.0, count + 1)
            found = algorithm.TOPPRA(limits, path, grid, parametrizer="ParametrizeConstAccel")
            return float(found.compute_trajectory().duration)

        duration, used = _timed(lambda fastest=fastest: fastest(GRID))
        out["durations"].append(duration)
        out["fine"].append(fastest(FINE))
        out["seconds"] += used
    return out


def _most(values: Any) -> float:
    return float(np.max(np.abs(values)))


EXAMPLES = {each.__name__: each for each in (lane_quintic, lane_bounded, disc, timings)}


def main() -> None:
    """Run the examples and print their answers."""
    names = sys.argv[1:] or list(EXAMPLES)
    answers = {name: EXAMPLES[name]() for name in names}
    answers["versions"] = {name: version(name) for name in PEERS}
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
