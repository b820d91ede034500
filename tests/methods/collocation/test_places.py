"""Waypoints and obstacles: shown to be missed without them, kept with them, refused in words."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import planner
from planner.methods.collocation.guesses import routes
from planner.methods.collocation.transcription.form import through
from planner.methods.refusal import duration_changes, path_changes
from planner.problem.requirements.places import Obstacle
from planner.problem.requirements.requirement import MotionPoint

PROBLEMS = Path(__file__).parents[3] / "problems"
DISC = {"centre_m": [2.2, 1.75], "radius_m": 0.3}


def sampled_clearance(points: np.ndarray, disc: Obstacle) -> np.ndarray:
    """By many points on each link; no projection, no clipping."""
    share = np.linspace(0, 1, 2001)[:, None, None]
    along = points[:-1] + share * np.diff(points, axis=0)
    distances = np.linalg.norm(along - disc.centre, axis=-1)
    return np.asarray(np.min(distances, axis=0) - disc.radius)


@given(st.integers(0, 10**6))
def test_clearances_by_three_codes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = planner.Manipulator([0.9, 0.7], 1.0, rng.uniform(0.3, 2.0, 3).tolist())
    disc = Obstacle(1, 3, *rng.uniform(-3, 3, 2).tolist(), float(rng.uniform(0.05, 1)))
    q = rng.uniform(-1.4, 1.4, 4)
    points = arm.arm_points(q[1:])
    judged = disc.clearances(points)
    np.testing.assert_allclose(judged, sampled_clearance(points, disc), atol=2e-3)
    rows = ca.vertcat(*disc.rows(MotionPoint(arm, ca.DM(q))))
    distance = np.sqrt(np.array(rows).ravel() * 2 * disc.radius + disc.radius**2)
    np.testing.assert_allclose(distance - disc.radius, judged, atol=1e-9)


@pytest.fixture(scope="module")
def obstacle() -> planner.Problem:
    return planner.load_problem(PROBLEMS / "obstacle.toml")


@pytest.fixture(scope="module")
def around(obstacle: planner.Problem) -> planner.Plan:
    return planner.solve(obstacle, "collocation", intervals=20, starts=1)


def really(plan: planner.Plan, times: np.ndarray) -> np.ndarray:
    """The motion that the plan's inputs make at increasing times, which is what is certified."""
    rates, found = plan.problem.system.rates, [plan.q(0.0)[None]]
    for a, b in pairwise(plan.t):
        inside = np.append(times[(a < times) & (times < b)], b)
        moved = solve_ivp(
            lambda t, q, b=b: rates(q, plan.u(min(t, np.nextafter(b, 0)))),
            (a, b),
            found[-1][-1],
            "DOP853",
            inside,
            rtol=1e-11,
            atol=1e-13,
        )
        found.append(moved.y.T)
    return np.concatenate(found)


def test_the_arm_goes_around_a_disc_it_would_hit(
    paper: planner.Problem, obstacle: planner.Problem, around: planner.Plan
) -> None:
    free = planner.solve(paper, "collocation")
    label = "clearance of link 3 from obstacle 1"
    broken = planner.verify(replace(free, problem=obstacle)).violations
    assert broken[0].label == label
    disc = obstacle.obstacles[0]
    times = np.linspace(0, around.duration, 4001)
    arm: planner.Manipulator = obstacle.system  # type: ignore[assignment]
    least = np.min(disc.clearances(arm.arm_points(around.q(times)[:, 1:])), axis=0)
    assert np.all(least > -1e-9)
    assert least[2] < 0.01, "the disc is in the way, so that link 3 should pass close by it"
    assert planner.verify(around).margins[label] == pytest.approx(least[2], abs=1e-4)
    certificate = around.certificate
    assert certificate is not None
    assert certificate[label].status == "proven"
    true = np.min(disc.clearances(arm.arm_points(really(around, times)[:, 1:])), axis=0)
    assert 0 <= certificate[label].guaranteed <= true[2] + 1e-9
    assert certificate[label].guaranteed == pytest.approx(true[2], abs=1e-4)


def test_the_machine_goes_around_it_too(around: planner.Plan) -> None:
    assert around.status == "solved"
    assert around.verified
    run = planner.replay(around, planner.Machine.ideal(), record_s=None)
    assert np.max(np.abs(run.terminal_error)) < 1e-6


def test_a_certificate_sees_a_disc_that_is_a_hair_too_large(around: planner.Plan) -> None:
    label = "clearance of link 3 from obstacle 1"
    assert around.certificate is not None
    margin = around.certificate[label].guaranteed
    kept = margin + 1e-6 * 3.0  # links may enter a disc by 1e-6 of the arm's reach
    for change, status in ((kept + 1e-6, "violated"), (kept - 1e-6, "proven")):
        grown = {**DISC, "radius_m": DISC["radius_m"] + change}  # type: ignore[operator]
        problem = around.problem.changed({"obstacles": [grown]})
        assert planner.certify(replace(around, problem=problem))[label].status == status


@pytest.fixture(scope="module")
def by_way() -> planner.Plan:
    return planner.solve(planner.load_problem(PROBLEMS / "waypoint.toml"), "collocation")


def test_waypoints_are_passed_in_time_or_at_some_time(
    paper: planner.Problem, by_way: planner.Plan
) -> None:
    free = planner.solve(paper, "collocation")
    missed = planner.verify(replace(free, problem=by_way.problem)).violations
    assert {v.label for v in missed} == {"distance from waypoint 1", "distance from waypoint 2"}
    np.testing.assert_allclose(np.rad2deg(by_way.q(6.0)[2:]), [15, 10], atol=1e-3)
    first = np.rad2deg(by_way.q(np.linspace(0, 10, 10001))[:, 1])
    assert np.any(np.abs(np.diff(np.sign(first - 45))) > 0) or np.min(abs(first - 45)) < 1e-3
    assert by_way.certificate is not None
    assert by_way.certificate["distance from waypoint 1"].status == "proven"
    assert by_way.certificate["distance from waypoint 2"].status == "proven"


def test_a_waypoint_moved_a_hair_is_missed(by_way: planner.Plan) -> None:
    tables = by_way.problem.to_dict()["waypoints"]
    tables[0]["theta_deg"][1] += np.rad2deg(1e-4)
    moved = replace(by_way, problem=by_way.problem.changed({"waypoints": tables}))
    check = planner.verify(moved)
    assert [v.label for v in check.violations] == ["distance from waypoint 1"]
    assert planner.certify(moved)["distance from waypoint 1"].status == "violated"


def test_a_free_time_is_chosen_well(paper: planner.Problem) -> None:
    """A waypoint on the way of the free optimum costs nothing once its time is settled."""
    free = planner.solve(paper, "collocation")
    on_the_way = np.rad2deg(free.q(2.3)[1:]).tolist()
    problem = paper.changed({"waypoints": [{"theta_deg": on_the_way}]})
    plan = planner.solve(problem, "collocation")
    assert plan.objective == pytest.approx(free.objective, rel=2e-4)
    settled = plan.problem.waypoints[0].distance(plan.q(np.linspace(1.8, 2.8, 1001)))
    assert np.min(settled) < 1e-3


def test_orders_follow_times_and_begin_with_the_shortest(paper: planner.Problem) -> None:
    points = [
        {"theta_deg": [25, 25, 25]},
        {"theta_deg": [10, 10, 10]},
        {"theta_deg": [15, 15, 15], "time": 5.0},
        {"theta_deg": [5, 5, 5], "time": 2.0},
    ]
    ways = routes(paper.changed({"waypoints": points}))
    assert [w.number for w in ways[0].waypoints] == [4, 2, 3, 1]
    for way in ways:
        numbers = [w.number for w in way.waypoints]
        assert numbers.index(4) < numbers.index(3)


@pytest.mark.parametrize("fractions", [[], [0.5], [0.013, 0.5, 0.99]])
def test_meshes_hold_their_marks(fractions: list[float]) -> None:
    mesh = through(20, fractions)
    np.testing.assert_allclose(mesh.edges[list(mesh.marks)], fractions)
    finer = mesh.snap(np.linspace(0, 1, 41))
    np.testing.assert_allclose(finer.edges[list(finer.marks)], fractions)
    assert np.all(finer.widths > 0)
    assert np.all(mesh.widths > 0)


def test_a_waypoint_out_of_reach_is_refused_in_words(paper: planner.Problem) -> None:
    hasty = paper.changed({"waypoints": [{"theta_deg": [60, -60, 0], "time": 1.0}]})
    with pytest.raises(planner.NotConvergedError) as caught:
        planner.solve(hasty, "collocation", attempts=1, intervals=20, max_iterations=60)
    assert caught.value.blamed
    assert caught.value.violations[0].label == "distance from waypoint 1"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"waypoints": [{"theta_deg": [20, "fre", "free"]}]}, "theta_deg"),
        ({"waypoints": [{"theta_deg": [20, "free"]}]}, "waypoints\\[0\\].theta_deg has 2 angles"),
        ({"waypoints": [{"theta_deg": ["free"] * 3}]}, "leaves every joint free"),
        ({"waypoints": [{"theta_deg": [85, 0, 0]}]}, "waypoint 1 theta1 = 85 deg lies outside"),
        ({"waypoints": [{"theta_deg": [20, 0, 0], "time": 10.0}]}, "inside the motion"),
        ({"waypoints": [{"theta_deg": [2, 0, 0], "time": 2.0}] * 2}, "waypoints 1 and 2"),
        (
            {"goal.duration": "free", "waypoints": [{"theta_deg": [2, 0, 0], "time": 2.0}]},
            "needs a fixed goal.duration",
        ),
        ({"obstacles": [{"centre_m": [1.5, 0], "radius_m": 0.3}]}, "at the start link 2"),
        ({"obstacles": [{"centre": [1.5, 0], "radius_m": 0.3}]}, "did you mean 'centre_m'"),
        (
            {
                "obstacles": [{"centre_m": [0.4, 2.2], "radius_m": 0.1}],
                "waypoints": [{"theta_deg": [80, 0, 0]}],
            },
            "at the waypoint 1 link 3",
        ),
    ],
)
def test_contradictions_are_refused(
    paper: planner.Problem, changes: dict[str, object], says: str
) -> None:
    with pytest.raises(planner.InputError, match=says):
        paper.changed(changes)


def test_other_systems_name_the_coordinates_of_a_waypoint() -> None:
    car = planner.load_problem(PROBLEMS / "car.toml")
    problem = car.changed({"waypoints": [{"q": {"y": 2.0, "heading": 0.1}, "time": 3.0}]})
    np.testing.assert_array_equal(problem.waypoints[0].q, [np.nan, np.nan, 0.1, 2.0])
    with pytest.raises(planner.InputError, match="'heading'"):
        car.changed({"waypoints": [{"q": {"hading": 0.1}}]})
    with pytest.raises(planner.InputError, match="obstacles"):
        car.changed({"obstacles": [DISC]})


def test_what_is_tried_leaves_the_duration_alone_where_a_waypoint_depends_on_it(
    paper: planner.Problem,
) -> None:
    place = {"theta_deg": [60, -60, 0], "time": 1.0}
    timed = paper.changed({"waypoints": [place]})
    assert [dict(change.keys) for change in duration_changes(timed)] == []
    assert {"waypoints": []} in [change.keys for change in path_changes(timed)]
    free = paper.changed({"waypoints": [{"theta_deg": [60, -60, 0]}]})
    assert {"goal.duration": "free"} in [change.keys for change in duration_changes(free)]
