"""Each system's symbolic and numeric forms against each other, and against mechanics."""

from functools import cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from every_system import NAMES, SYSTEMS, few, inputs, points
from hypothesis import given
from hypothesis import strategies as st

from planner import (
    BallGear,
    Car,
    Gear,
    InputError,
    Manipulator,
    Trailers,
    TriangularSystem,
    Unicycle,
    chained_form,
)
from planner.systems.triangular_system import Coordinate, arm_points_expr

every_system = pytest.mark.parametrize("name", NAMES)
INDEPENDENT = [name for name in NAMES if not name.startswith("custom")]


@cache
def symbolic(name: str) -> tuple[ca.Function, ca.Function]:
    system = SYSTEMS[name]
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    rates = ca.Function("rates", [q, u], [ca.vertcat(*system.rates_expr(q, u))])
    path = ca.vertcat(system.drive_expr(q), *system.slopes_expr(q))
    return rates, ca.Function("path", [q], [path])


@every_system
@few
@given(data=st.data(), u=inputs)
def test_symbolic_and_numeric_rates_agree(name: str, data: st.DataObject, u: np.ndarray) -> None:
    system = SYSTEMS[name]
    q = data.draw(points(system, 0.0, 1.5))
    rates, path = symbolic(name)
    numeric = system.rates(q, u)
    np.testing.assert_allclose(numeric, rates(q, u).full()[:, 0], rtol=1e-11, atol=1e-12)
    numeric_path = np.array([system.drive(q), *system.slopes(q)])
    np.testing.assert_allclose(numeric_path, path(q).full()[:, 0], rtol=1e-11, atol=1e-12)


@every_system
@few
@given(data=st.data(), u=inputs)
def test_rates_have_the_triangular_form(name: str, data: st.DataObject, u: np.ndarray) -> None:
    """q̇₁ = γu₁, q̇₂ = u₂, q̇ᵢ = fᵢ q̇₁, and fᵢ reads qᵢ₋₁ and later coordinates only."""
    system = SYSTEMS[name]
    q = data.draw(points(system, 0.0, 1.3))
    general = TriangularSystem.rates(system, q, u)
    np.testing.assert_allclose(system.rates(q, u), general, rtol=1e-10, atol=1e-11)
    for k in range(1, system.size - 1):
        moved = q.copy()
        moved[:k] += 0.3
        np.testing.assert_allclose(
            system.slopes(moved)[k - 1 :], system.slopes(q)[k - 1 :], rtol=1e-12, atol=1e-12
        )


@pytest.mark.parametrize("name", INDEPENDENT)
def test_rates_stay_finite_where_the_chart_ends(name: str) -> None:
    """The chart's edges are not the machine's; steering at 90 degrees is, and is left out."""
    system = SYSTEMS[name]
    rates, _ = symbolic(name)
    q, u = np.full(system.size, 0.3), np.array([1.0, 1.0])
    names = [c.name for c in system.coordinates]
    for i in range(1, system.size - 1):
        if names[i] == "steering":
            continue
        across = q.copy()
        across[i] = np.pi / 2
        assert np.max(np.abs(system.rates(across, u))) < 10
        np.testing.assert_allclose(rates(across, u).full()[:, 0], system.rates(across, u))


@pytest.mark.parametrize("name", ["unicycle", "car", "trailers-1", "trailers-3"])
@given(data=st.data(), u=inputs)
def test_wheels_roll_without_slip_and_bodies_are_rigid(
    name: str, data: st.DataObject, u: np.ndarray
) -> None:
    """Mechanics, not the chart: no axle moves sideways, and axles keep their distances."""
    system = SYSTEMS[name]
    assert isinstance(system, Unicycle | Car | Trailers)
    q = data.draw(points(system, 0.0, 1.2))
    rates, h = system.rates(q, u), 1e-6
    behind, where, ahead = system.axle_points(q + h * np.outer([-1, 0, 1], rates))
    velocity = (ahead - behind) / (2 * h)
    headings = _headings(system, q)
    across = np.stack([-np.sin(headings), np.cos(headings)], axis=-1)
    np.testing.assert_allclose(np.sum(velocity * across, axis=-1), 0, atol=1e-7)
    if len(where) > 1:
        lengths = np.linalg.norm(np.diff(where, axis=0), axis=-1)
        wanted = [system.wheelbase_m, *getattr(system, "trailer_lengths_m", [])]
        np.testing.assert_allclose(lengths, wanted, rtol=1e-12)
    rear = 0 if isinstance(system, Unicycle) else 1
    speed = np.linalg.norm(velocity[rear])
    assert speed == pytest.approx(abs(u[0]), abs=1e-7)


@pytest.mark.parametrize("name", ["unicycle", "car", "trailers-3", "coin"])
def test_axle_points_of_many_states_are_those_of_each(name: str) -> None:
    system: Any = SYSTEMS[name]
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 4, system.size))
    found = system.axle_points(q)
    for place in np.ndindex(2, 4):
        np.testing.assert_allclose(found[place], system.axle_points(q[place]), rtol=1e-12)


def _headings(system: TriangularSystem, q: np.ndarray) -> np.ndarray:
    """Of the wheels at each of `axle_points`, front wheels first."""
    if isinstance(system, Unicycle):
        return q[1:2]
    hitches = q[2:-2]
    bodies = [q[-2], *(q[-2] + np.cumsum(hitches[::-1]))][::-1]
    return np.array([bodies[0] + q[1], *bodies])


@pytest.mark.parametrize("n", [1, 2, 3])
@given(
    coefficients=st.lists(st.floats(-0.15, 0.15), min_size=5, max_size=5), at=st.floats(-1.0, 1.0)
)
def test_path_of_the_last_trailer_determines_everything(
    n: int, coefficients: list[float], at: float
) -> None:
    """Flatness (Rouchon et al. 1993): from y(x) alone, by geometry, against the inverse chart."""
    system = SYSTEMS[f"trailers-{n}"]
    assert isinstance(system, Trailers)
    angles, derivatives = _by_geometry(system)
    q = angles(at, coefficients).full()[:, 0]
    z = np.array([at, *derivatives(at, coefficients).full()[::-1, 0]])
    np.testing.assert_allclose(chained_form(system).q(z, np.ones(system.size)), q, atol=1e-9)


def _by_geometry(system: Trailers) -> tuple[ca.Function, ca.Function]:
    """From x and the coefficients of y(x): q by following the axles, and y and its derivatives."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c", 5)
    y = sum(c[k] * x**k for k in range(5)) + 0.1 * ca.sin(x)
    px, py, length = x, y, list(system.trailer_lengths_m[::-1])
    headings = []
    for d in [*length, system.wheelbase_m]:
        headings.append(ca.atan2(ca.gradient(py, x), ca.gradient(px, x)))
        last = (px, py)
        px, py = px + d * ca.cos(headings[-1]), py + d * ca.sin(headings[-1])
    speed = ca.sqrt(ca.gradient(last[0], x) ** 2 + ca.gradient(last[1], x) ** 2)
    steering = ca.atan(system.wheelbase_m * ca.gradient(headings[-1], x) / speed)
    hitches = [ahead - behind for behind, ahead in pairwise(headings)]
    q = ca.vertcat(x, steering, *hitches[::-1], headings[0], y)
    chain = [y]
    for _ in range(system.size - 2):
        chain.append(ca.gradient(chain[-1], x))
    return ca.Function("q", [x, c], [q]), ca.Function("z", [x, c], [ca.vertcat(*chain)])


def test_ball_gear_and_paper_differ_by_their_law_alone() -> None:
    """sinθ against cos³θ; at θ = 0 the ball gear stands still while the friction disks drive."""
    K, u = [0.8, 0.7], np.array([1.0, 0.0])
    straight = np.zeros(4)
    np.testing.assert_array_equal(BallGear(K).rates(straight, u), [1, 0, 0, 0])
    np.testing.assert_array_equal(Manipulator(K).rates(straight, u), [1, 0, 0.8, 0.7])


def test_arm_points_are_a_chain_of_links() -> None:
    arm = BallGear([0.8, 0.7], link_lengths=[1.0, 2.0, 0.5])
    theta = np.array([[0.1, 0.2, -0.4], [0.0, 0.0, 0.0]])
    found = arm.arm_points(theta)
    assert found.shape == (2, 4, 2)
    np.testing.assert_array_equal(arm.arm_points(theta[0]), found[0])
    np.testing.assert_allclose(found[1], [[0, 0], [1, 0], [3, 0], [3.5, 0]])
    np.testing.assert_allclose(np.linalg.norm(np.diff(found[0], axis=0), axis=-1), [1.0, 2.0, 0.5])
    same = Manipulator([0.8, 0.7], link_lengths=[1.0, 2.0, 0.5]).arm_points(theta)
    np.testing.assert_array_equal(same, found)
    traced = np.array(arm_points_expr(theta[0].tolist(), arm.link_lengths))
    np.testing.assert_allclose(traced, found[0], atol=1e-15)


@every_system
def test_coordinates_have_names_and_units(name: str) -> None:
    system = SYSTEMS[name]
    assert len({c.name for c in system.coordinates}) == system.size == len(system.coordinates)
    assert {c.unit for c in system.coordinates} <= {"m", "rad"}
    assert 0 not in system.limited
    assert all(system.coordinates[i].unit == "rad" for i in system.limited) or name[:3] == "cus"
    assert {c.unit for c in system.user_coordinates} <= {"m", "rad"}
    assert len({c.name for c in system.user_coordinates}) == system.size


@pytest.mark.parametrize(
    ("name", "first"),
    [("manipulator-2", "phi1"), ("manipulator-5", "phi4"), ("ball-gear-4", "phi4")],
)
def test_an_arm_is_named_by_the_disk_or_ball_that_turns_with_its_path(
    name: str, first: str
) -> None:
    """The paper's arm by the last but one, the arm of ball gears by the last."""
    arm = SYSTEMS[name]
    joints = [f"theta{i}" for i in range(1, arm.size)]
    assert [c.name for c in arm.coordinates] == [first, *joints]


def test_a_rate_has_the_unit_per_second() -> None:
    rates = {"m": "m/s", "rad": "rad/s", "m/s": "m/s^2", "rad/s": "rad/s^2"}
    cart = Unicycle()
    assert {c.unit: c.rate_unit for c in (*cart.coordinates, *cart.inputs)} == rates
    assert Coordinate("a", "").rate_unit == "1/s"


def test_equal_systems_are_equal() -> None:
    assert Car(2.0) == Car(2.0)
    assert hash(Car(2.0)) == hash(Car(2.0))
    assert Car(2.0) != Car(2.1)
    assert BallGear([0.8]) != Manipulator([0.8])


def test_car_turns_on_a_circle() -> None:
    rates = Car(2.0).rates(np.array([0.0, 0.3, 0.7, 0.0]), np.array([3.0, 0.0]))
    assert rates[2] == pytest.approx(3.0 * np.tan(0.3) / 2.0)


@pytest.mark.parametrize(
    ("build", "names"),
    [
        (lambda: Car(0.0), "wheelbase_m"),
        (lambda: Trailers([]), "trailer_lengths_m"),
        (lambda: Trailers([1.0, -1.0]), "trailer_lengths_m"),
        (lambda: Trailers([1.0], np.nan), "wheelbase_m"),
        (lambda: BallGear([0.8, np.inf]), "K"),
        (lambda: BallGear([0.8], 0.0), "k_g"),
        (lambda: BallGear([0.8], link_lengths=[1.0]), "link_lengths has 1 values for 2 joints"),
        (lambda: Manipulator([]), "K"),
        (lambda: Manipulator("..."), r"K = '\.\.\.' must be positive finite numbers"),
        (lambda: Manipulator([0.8, 10**400]), "K = .* must be positive finite numbers"),
        (lambda: Manipulator([0.8], {}), "k_g"),
        (lambda: Manipulator.from_gear(1, Gear(1, 1, 1, 1, 1)), "at least 2 joints"),
        (lambda: Manipulator.from_gear(3, Gear(1, 1, 1, 1, 1), rule="x"), "k_g_rule"),
    ],
)
def test_impossible_constants_are_named(build: object, names: str) -> None:
    assert callable(build)
    with pytest.raises(InputError, match=names):
        build()
