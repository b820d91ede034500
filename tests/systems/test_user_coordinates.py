"""Coordinates of the user's own: both maps, and the coin against its plain rolling kinematics."""

import tomllib
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from every_system import SYSTEMS, few
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import planner
from planner import Coin
from planner.methods.refusal import travel_changes

PROBLEM = Path(__file__).parents[2] / "problems/coin.toml"
places = st.lists(st.floats(-5, 5), min_size=4, max_size=4).map(np.array)


def rolled(
    radius: float, start: np.ndarray, u: Callable, t: np.ndarray, breaks: Sequence[float] = ()
) -> np.ndarray:
    """(x, y, heading, roll) at times t by ẋ = r φ̇ cosθ, ẏ = r φ̇ sinθ; SciPy's integrator."""
    out = np.full((len(t), 4), np.nan)
    for low, high in pairwise([t[0], *breaks, t[-1]]):

        def rates(time: float, w: np.ndarray, inside=(low, high)) -> list[float]:
            turn, roll = u(np.clip(time, inside[0], np.nextafter(inside[1], 0.0)))
            return [radius * roll * np.cos(w[2]), radius * roll * np.sin(w[2]), turn, roll]

        settings = {"method": "DOP853", "dense_output": True, "rtol": 1e-12, "atol": 1e-13}
        found = solve_ivp(rates, (low, high), start, **settings)
        here = (t >= low) & (t <= high)
        if np.any(here):
            out[here] = found.sol(t[here]).T
        start = found.y[:, -1]
    return out


@few
@given(w=places, rates=st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_the_coin_rolls_as_its_triangular_coordinates_say(w: np.ndarray, rates: list) -> None:
    """One motion integrated twice: rolling in the plane, and in (heading, roll, eta, sigma)."""
    coin, t = Coin(0.3), np.linspace(0.0, 2.0, 9)

    def u(time: float) -> np.ndarray:
        return np.array([rates[0] + rates[1] * time, rates[2] * np.cos(rates[3] * time)])

    triangular = solve_ivp(
        lambda time, q: coin.rates(q, u(time)), (0.0, 2.0), coin.from_user(w), "DOP853", t,
        rtol=1e-12, atol=1e-13,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(coin.user(triangular), rolled(0.3, w, u, t), atol=1e-9)


@pytest.mark.parametrize("name", [name for name, s in SYSTEMS.items() if s.has_user_coordinates])
@few
@given(w=places)
def test_the_maps_are_inverse_and_their_two_forms_agree(name: str, w: np.ndarray) -> None:
    system, x = SYSTEMS[name], ca.SX.sym("x", 4)
    q = system.from_user(w)
    np.testing.assert_allclose(system.user(q), w, atol=1e-12)
    forms = (system.user_expr, system.user, q), (system.from_user_expr, system.from_user, w)
    for expression, numeric, point in forms:
        function = ca.Function("f", [x], [ca.vertcat(*expression(x))])
        np.testing.assert_allclose(numeric(point), function(point).full()[:, 0], atol=1e-12)
        several = np.tile(point, (2, 3, 1))
        np.testing.assert_allclose(numeric(several)[1, 2], numeric(point), atol=1e-12)


def test_a_system_without_others_has_its_own() -> None:
    system = SYSTEMS["car"]
    q = np.arange(4.0)
    assert not system.has_user_coordinates
    assert system.user_coordinates == system.coordinates
    assert system.user(q) is system.from_user(q) is q


@pytest.fixture(scope="module")
def problem() -> planner.Problem:
    """The shipped one, by way of a place on its way."""
    return planner.load_problem(PROBLEM, {"waypoints": [{"q": {"x": 0.5, "y": 0.5}}]})


@pytest.fixture(scope="module")
def plan(problem: planner.Problem) -> planner.Plan:
    return planner.solve(problem)


def test_a_plan_rolls_to_its_goal_by_its_waypoint_within_its_limits(plan: planner.Plan) -> None:
    """By its inputs alone, rolling in the plane: neither planner's kinematics nor its maps."""
    t = np.linspace(0.0, plan.duration, 4001)
    w = rolled(0.1, np.zeros(4), plan.trajectory.u, t, plan.t[1:-1])
    np.testing.assert_allclose(w[-1], [0.0, 1.0, 3.0, 0.0], atol=5e-5)
    assert np.min(np.max(np.abs(w[:, :2] - 0.5), axis=1)) < 2e-3  # between two samples
    assert np.max(np.abs(w[:, 0])) < 0.8 + 1e-6
    assert np.max(np.abs(w[:, 1])) < 1.3 + 1e-6
    np.testing.assert_allclose(plan.user(t), w, atol=2e-4)


def test_what_is_asked_for_is_named_judged_and_proven(plan: planner.Plan) -> None:
    asked = {"goal x", "goal y", "goal heading", "goal roll", "joint x", "joint y"}
    labels = {part.label for each in plan.problem.demands for part in each.parts}
    assert {*asked, "distance from waypoint 1"} <= labels
    assert not {"goal eta", "goal sigma"} & labels
    check = planner.verify(plan)
    assert check.ok
    assert labels - {"chart domain"} <= set(check.margins)
    certificate = planner.certify(plan)
    assert {claim.label for claim in certificate.claims} >= labels
    assert {claim.status for claim in certificate.claims} == {"proven"}


@pytest.mark.parametrize(("objective", "most"), [("effort", 0.05), ("smooth", 0.1)])
def test_a_tight_limit_is_kept_between_the_nodes(objective: str, most: float) -> None:
    """The way without it goes twice as far aside; 12 intervals leave much between the nodes."""
    changes = {
        "limits.q": {"x": most, "y": 1.05},
        "method.collocation.objective": objective,
        "method.collocation.intervals": 12,
    }
    plan = planner.solve(planner.load_problem(PROBLEM, changes))
    t = np.linspace(0.0, plan.duration, 4001)
    w = rolled(0.1, np.zeros(4), plan.trajectory.u, t, plan.t[1:-1])
    assert 0.95 * most < np.max(np.abs(w[:, 0])) <= most * (1 + 2e-6)
    assert np.max(np.abs(w[:, 1])) <= 1.05 * (1 + 2e-6)
    proven = {c.label for c in planner.certify(plan).claims if c.status == "proven"}
    assert {"joint x", "joint y"} <= proven


def test_the_judge_sees_a_limit_and_a_waypoint_that_are_broken(plan: planner.Plan) -> None:
    changes = {"limits.q": {"x": 0.45}, "waypoints": [{"q": {"x": 0.3, "y": -0.5}}]}
    other = planner.Plan(**{**vars_of(plan), "problem": plan.problem.changed(changes)})
    broken = {v.label: v.value for v in planner.verify(other).violations}
    assert set(broken) == {"joint x", "distance from waypoint 1"}
    assert broken["joint x"] >= 0.5
    refuted = {c.label for c in planner.certify(other).claims if c.status == "violated"}
    assert refuted == set(broken)


def vars_of(plan: planner.Plan) -> dict:
    return {name: getattr(plan, name) for name in plan.__dataclass_fields__}


@pytest.mark.parametrize(
    ("changes", "index"),
    [
        ({"goal.q": {"x": 0.0, "y": 1.0, "roll": "free"}}, 3),
        ({"goal.travel": "free"}, 2),
        ({"goal.q": {"x": "free", "y": 1.0, "roll": 0.0}}, 0),
    ],
)
def test_a_goal_may_leave_user_coordinates_free(changes: dict, index: int) -> None:
    problem = planner.load_problem(PROBLEM, changes)
    plan = planner.solve(problem)
    end = rolled(0.1, np.zeros(4), plan.trajectory.u, np.array([0.0, 10.0]), plan.t[1:-1])[-1]
    wanted = np.array([0.0, 1.0, 3.0, 0.0])
    given = np.arange(4) != index
    np.testing.assert_allclose(end[given], wanted[given], atol=5e-5)
    assert abs(end[index] - wanted[index]) > 0.1  # which costs less
    with pytest.raises(planner.NoPlanError, match=r"leaves (roll|heading|x) free"):
        planner.solve(problem, "polynomial")


@pytest.mark.parametrize("time", [None, 4.0])
def test_a_waypoint_that_gives_all_is_one_of_q(time: float | None) -> None:
    way = {"q": {"x": 0.5, "y": 0.4, "heading": 1.0, "roll": 2.0}} | (
        {"time": time} if time else {}
    )
    problem = planner.load_problem(PROBLEM, {"waypoints": [way]})
    (point,) = problem.waypoints
    np.testing.assert_allclose(problem.system.user(point.q), [0.5, 0.4, 1.0, 2.0], atol=1e-12)
    assert not problem.on_the_way.parts
    assert planner.solve(problem).verified


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"start.q": {"x": 0.0, "y": 0.0, "heading": 0.0}}, "start.q lacks roll"),
        ({"goal.q": {"x": 0.0, "y": 1.0, "eta": 0.0}}, "goal.q has no coordinate 'eta'"),
        ({"limits.q": {"sigma": 1.0}}, "limits.q has no coordinate 'sigma'"),
        ({"waypoints": [{"q": {"eta": 1.0}}]}, r"waypoints\[0\].q has no coordinate 'eta'"),
        ({"limits.q": {"y": 0.9}}, "goal y = 1 m lies outside its limit of 0.9 m"),
        (
            {"goal.q": {"x": "free", "y": "free", "roll": "free"}, "goal.travel": "free"},
            "goal.q leaves every coordinate free",
        ),
    ],
)
def test_what_a_file_says_wrong_is_named_in_user_coordinates(changes: dict, says: str) -> None:
    with pytest.raises(planner.InputError, match=says):
        planner.load_problem(PROBLEM, changes)


# -- given as texts ----------------------------------------------------------------------------


@pytest.fixture
def front() -> dict:
    """Its path coordinate, x of the rear axle, is none of the user's."""
    return tomllib.loads((PROBLEM.parent / "front-axle.toml").read_text("utf-8"))


def changed(data: dict, changes: dict) -> dict:
    return planner.Problem.from_dict(data).changed(changes).to_dict()


def test_a_car_is_steered_by_the_place_of_its_front_axle(front: dict) -> None:
    problem = planner.Problem.from_dict(front)
    assert problem.travel == pytest.approx(6 - 2 * np.cos(0.3) + 2)
    assert problem == planner.Problem.from_dict(problem.to_dict())
    for method in ("collocation", "convex"):
        plan = planner.solve(problem, method)
        t = np.linspace(0.0, plan.duration, 1001)
        x, steering, heading, y = plan.q(t).T
        place = np.stack([x + 2 * np.cos(heading), y + 2 * np.sin(heading)])
        np.testing.assert_allclose(place[:, -1], [6.0, 1.0], atol=1e-4)
        np.testing.assert_allclose(plan.user(t), np.stack([*place, heading, steering], axis=-1))
        assert np.max(np.abs(place[1])) < 1.1 * (1 + 2e-6)
        assert {c.status for c in planner.certify(plan).claims if c.required} == {"proven"}


def test_a_travel_that_follows_from_the_goal_is_not_given(front: dict) -> None:
    with pytest.raises(planner.InputError, match=r"goal\.travel; goal\.q "):
        changed(front, {"goal.travel": 6.0})
    assert travel_changes(planner.Problem.from_dict(front)) == []  # no advice that says so
    assert travel_changes(planner.load_problem(PROBLEM)) != []
    problem = planner.Problem.from_dict(front)
    assert problem.travel_key == ""
    with pytest.raises(planner.InputError, match="the goal's coordinates determine the travel"):
        problem.with_travel(6.0)
    tight = problem.changed({"limits.q.steering": 0.15})
    with pytest.raises(planner.VerificationError) as refused:
        planner.solve(tight, "polynomial")
    assert "goal.travel" not in str(refused.value.advice)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("units", ["m", "m", "rad"], "user.units has 3 entries for 4 coordinates"),
        ("coordinates", ["a", "a", "heading", "steering"], "'front_x' in .* is not understood"),
        (
            "expressions",
            ["x + cos(heading)", "y + 2 * sin(heading)", "heading", "steering"],
            "user.inverse does not undo user.expressions: at x = .* it gives x = ",
        ),
        (
            "expressions",
            ["x + 2 * cos(heading)", "y + 2 * sin(heading)", "2 * heading", "steering"],
            "'heading' in user.coordinates is a triangular coordinate too: give 'heading' the unit",
        ),
        (
            "inverse",
            ["sqrt(-1 - front_x**2)", "steering", "heading", "front_y"],
            "are not both real",
        ),
    ],
)
def test_maps_that_do_not_belong_together_are_refused(
    front: dict, key: str, value: list[str], says: str
) -> None:
    front["system"]["user"][key] = value
    with pytest.raises(planner.InputError, match=says):
        planner.Problem.from_dict(front)


def test_a_start_off_the_map_is_refused(front: dict) -> None:
    """On (0, π) the cosine has an inverse; a start beyond it leads elsewhere."""
    front["system"]["user"] |= {
        "coordinates": ["front_x", "front_y", "side", "steering"],
        "units": ["m", "m", "", "rad"],
        "expressions": ["x", "y", "sin(heading)", "steering"],
        "inverse": ["front_x", "steering", "asin(side)", "front_y"],
    }
    front["goal"]["q"] = {"front_x": 6.0, "front_y": 1.0, "side": 0.3, "steering": 0.0}
    front["start"]["q"] = {"front_x": 0.0, "front_y": 0.0, "side": 1.5, "steering": 0.0}
    front["limits"] = {}
    with pytest.raises(planner.InputError, match=r"start\.q: .* map "):
        planner.Problem.from_dict(front)
