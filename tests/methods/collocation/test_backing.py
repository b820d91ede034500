"""Trailers that are backed: planned and judged from the goal to the start."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from registered import restored
from scipy.integrate import solve_ivp

import planner
from planner.plan.trajectory import StateTrajectory
from planner.problem.requirements.requirement import MotionPoint, Part, Requirement
from planner.support.calculus.bernstein import Bernstein

TWO_AXLES_EACH = [0.75, 2.0, 0.75, 3.0]
SPEEDS = {"speed_m_s": 5.0, "steering_rate_rad_s": 1.0, "steering_deg": 45, "hitch_deg": 60}
FIXED: dict[str, Any] = {
    "limits": {
        "speed_m_s": 3.0,
        "acceleration_m_s2": 4.0,
        "steering_rate_rad_s": 1.0,
        "steering_acceleration_rad_s2": 6.0,
        "steering_deg": 45,
        "hitch_deg": 60,
    },
    "goal": {"duration": 12.0},
    "waypoints": [{"q": {"y_m": 1.0}, "time": 4.0}],
}


def train(
    lengths: list[float],
    place: tuple[float, float, float],
    turn: float = 0.0,
    goal: Any = None,
    limits: Any = None,
    waypoints: Any = (),
) -> planner.Problem:
    """Pull a train from the origin to a goal (x, y, heading in degrees), all turned by degrees."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    x, y, heading = place
    end = {"x_m": c * x - s * y, "y_m": s * x + c * y, "heading_deg": heading + turn}
    return planner.Problem.from_dict(
        {
            "system": {"kind": "trailers", "wheelbase_m": 3.0, "trailer_lengths_m": lengths},
            "start": {"x_m": 0.0, "y_m": 0.0, "heading_deg": turn},
            "limits": limits or SPEEDS,
            "goal": {**end, "duration": "free", **(goal or {})},
            "waypoints": list(waypoints),
        }
    )


def backed(problem: planner.Problem) -> planner.Problem:
    """The file of the problem that goes the other way, written by hand."""
    data = problem.to_dict()
    ends = ("x_m", "y_m", "heading_deg")
    start, goal = data["start"], data["goal"]
    data["start"], data["goal"] = (
        {key: goal[key] for key in ends},
        {**goal, **{key: start[key] for key in ends}},
    )
    for point in data.get("waypoints", []):
        point["time"] = goal["duration"] - point["time"]
    return planner.Problem.from_dict(data)


PULLED = [
    (TWO_AXLES_EACH, (20.5, 25.0, 90.0), 0.0, {}),
    ([2.0], (16.0, 3.0, 0.0), 200.0, {}),
    ([2.5], (15.0, 3.0, 0.0), 0.0, FIXED),
]


KINDS = ("long", "turned", "timed")


@pytest.mark.parametrize(("lengths", "place", "turn", "tables"), PULLED, ids=KINDS)
def test_backing_is_pulling_run_backwards(
    lengths: list[float],
    place: tuple[float, float, float],
    turn: float,
    tables: Any,
    tmp_path: Path,
) -> None:
    ahead = train(lengths, place, turn, **tables)
    back = backed(ahead)
    pulled, pushed = planner.solve(ahead), planner.solve(back)
    assert pushed.problem == back
    assert pushed.verified
    assert not pulled.unstable
    assert pushed.unstable
    assert pushed.duration == pytest.approx(pulled.duration, rel=1e-9)
    assert pushed.effort == pytest.approx(pulled.effort, rel=1e-6)
    t = np.linspace(0.0, pushed.duration, 50)
    np.testing.assert_allclose(pushed.q(t), pulled.q(pushed.duration - t), rtol=0, atol=1e-5)
    middles = (pushed.t[1:] + pushed.t[:-1]) / 2
    u = pulled.u(pushed.duration - middles)
    np.testing.assert_allclose(pushed.u(middles), -u, rtol=0, atol=1e-4)
    np.testing.assert_allclose(pushed.q(0.0), back.start, atol=1e-9)
    read = planner.load_plan(pushed.save(tmp_path / "pushed.json"), strict=True)
    assert read == pushed
    assert read.verified
    assert planner.verify(read).ok


@pytest.fixture(scope="module")
def pushed() -> planner.Plan:
    return planner.solve(backed(train(*PULLED[0][:2])))


def test_its_inputs_lead_from_the_goal_to_the_start_and_not_the_other_way(
    pushed: planner.Plan,
) -> None:
    """SciPy's integrator, piece by piece: the state of the vehicle is within the tolerance of the
    start if it is at the goal afterwards. A start that is off by the tolerance leads elsewhere."""
    system, T = pushed.problem.system, pushed.duration

    def end(q: Any, breaks: Any) -> Any:
        for a, b in itertools.pairwise(breaks):
            first, last = pushed.trajectory.piece_values(
                np.array([np.searchsorted(pushed.t, min(a, b) + 1e-12) - 1]),
                np.array([[0.0], [1.0]]),
            )[1][:, 0]
            low, high = min(a, b), max(a, b)
            q = solve_ivp(
                lambda t, q, f=first, g=last, low=low, high=high: system.rates(
                    q, f + (g - f) * (t - low) / (high - low)
                ),
                (a, b),
                q,
                rtol=1e-11,
                atol=1e-12,
                method="DOP853",
            ).y[:, -1]
        return q

    home = end(pushed.problem.goal, pushed.t[::-1])
    np.testing.assert_allclose(home, pushed.problem.start, rtol=0, atol=2e-5)
    half = pushed.t[pushed.t <= T / 2]
    nudged = pushed.problem.start + 2e-5
    astray = end(nudged, half) - pushed.q(half[-1])
    assert np.max(np.abs(astray)) > 0.1


def test_the_plan_says_that_it_needs_feedback(pushed: planner.Plan) -> None:
    assert pushed.unstable
    for text in (repr(pushed), str(pushed), pushed._repr_html_()):
        assert "feedback" in text


def test_another_input_is_refused_by_its_start(pushed: planner.Plan) -> None:
    path = pushed.trajectory
    assert isinstance(path, StateTrajectory)
    u = Bernstein(path.u_curve.c * [1.0, 1.001], path.u_curve.x)
    check = planner.verify(replace(pushed, trajectory=replace(path, u_curve=u)))
    assert not check.ok
    assert any(v.misses_goal and v.label.startswith("start ") for v in check.violations)
    assert np.max(np.abs(check.terminal_error)) > 1e-4


def test_times_of_what_is_broken_are_the_motions_own(pushed: planner.Plan) -> None:
    tight = pushed.problem.changed({"limits.steering_deg": 30})
    check = planner.verify(replace(pushed, problem=tight))
    (steering,) = check.violations
    assert steering.time_s is not None
    assert abs(pushed.q(steering.time_s)[1]) == pytest.approx(abs(steering.value), abs=1e-4)
    claim = planner.certify(replace(pushed, problem=tight))[steering.label]
    assert claim.status == "violated"
    assert claim.time_s is not None
    assert abs(pushed.q(claim.time_s)[1]) > math.radians(30)


def test_a_motion_that_no_direction_follows_is_refused_by_its_cause(pushed: planner.Plan) -> None:
    """Forward and back again: from either end the errors of the middle grow 10^12 times."""
    path = pushed.trajectory
    assert isinstance(path, StateTrajectory)

    def loop(curve: Bernstein, gain: float) -> Bernstein:
        out = curve.slowed(-1.0, gain)
        half = Bernstein(out.c[:, :60], out.x[:61])
        back = half.slowed(-1.0, gain)
        x = np.append(half.x, half.x[-1] + back.x[1:])
        return Bernstein(np.concatenate([half.c, back.c], axis=1), x)

    both = StateTrajectory(path.system, loop(path.q_curve, 1.0), loop(path.u_curve, -1.0))
    place = pushed.problem.exchanged()
    assert place is not None
    same = replace(place, user_goal=place.start)
    plan = planner.Plan(same, "by hand", {}, both)
    assert plan.unstable
    assert plan.backwards is None
    check = planner.verify(plan)
    assert not check.ok
    assert "trailers are pushed" in check.violations[0].label
    assert "e+" not in str(check.violations)
    for violation in check.violations[1:]:
        assert abs(violation.value) < 100


def test_a_timing_and_a_law_are_judged_the_same_way(pushed: planner.Plan) -> None:
    faster = planner.retime(pushed)
    assert faster.verified
    assert faster.duration < pushed.duration * (1 + 1e-3)
    law = planner.solve(backed(train([2.0], (16.0, 3.0, 0.0))), "polynomial")
    assert law.verified
    assert law.unstable


def test_a_plan_starts_the_search_of_one_like_it(pushed: planner.Plan) -> None:
    farther = pushed.problem.changed({"start.y_m": pushed.problem.start[-1] + 0.2})
    plan = planner.solve(farther, warm=pushed)
    assert plan.notes["stage"] == "warm start"
    assert plan.verified


@dataclass(frozen=True)
class _Forward(Requirement):
    """0 <= u1."""

    most: float
    key, reads, speed_power = "forward", frozenset({"u"}), 1
    table = float, "Largest u1.", 2.0

    @classmethod
    def of(cls, value: Any, _: Any) -> "_Forward":
        return cls(value)

    @property
    def parts(self) -> tuple[Part, ...]:
        return (Part("forward", "m/s", 0.0, self.most, self.most),)

    def rows(self, point: MotionPoint) -> list[Any]:
        return [point.u[0]]


@pytest.fixture
def _signed_limit() -> Iterator[None]:
    with restored():
        planner.register_requirement(_Forward)
        yield


@pytest.mark.usefixtures("_signed_limit")
def test_a_limit_with_a_sign_is_never_turned_round() -> None:
    ahead = train([2.0], (16.0, 3.0, 0.0), limits={**SPEEDS, "forward": 5.0})
    assert ahead.exchanged() is None
    assert planner.solve(ahead).verified
    with pytest.raises(planner.NoPlanError):
        planner.solve(backed(ahead), time_limit_s=4)


def test_what_has_no_other_way_is_not_exchanged() -> None:
    free = train([2.0], (8.0, 3.0, 0.0), goal={"x_m": "free"})
    assert free.exchanged() is None
    assert planner.load_problem("problems/tip.toml").exchanged() is None
