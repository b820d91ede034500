"""A user's own system: what it accepts, what it refuses, and its numeric inverse."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from every_system import SYSTEMS
from hypothesis import given
from hypothesis import strategies as st

import planner
from planner import CustomSystem, InputError, chained_form
from planner.systems.triangular_system import Coordinate

X, THETA, Y = Coordinate("x", "m"), Coordinate("theta", "rad"), Coordinate("y", "m")


def unicycle(**changes: object) -> CustomSystem:
    arguments = {
        "name": "own",
        "coordinates": [X, THETA, Y],
        "slopes": ["tan(theta)"],
        "drive": "cos(theta)",
        **changes,
    }
    return CustomSystem(**arguments)  # type: ignore[arg-type]


def test_texts_and_functions_make_the_same_system() -> None:
    as_text = unicycle()
    as_function = unicycle(slopes=lambda q: [ca.tan(q[1])], drive=lambda q: ca.cos(q[1]))
    assert as_text == as_function
    assert as_text.to_dict()["slopes"] == ["tan(theta)"]


@pytest.mark.parametrize("name", ["custom-manipulator-3", "custom-trailers-1"])
def test_copies_agree_with_their_originals(name: str) -> None:
    copy, original = SYSTEMS[name], SYSTEMS[name.removeprefix("custom-")]
    rng = np.random.default_rng(0)
    q = rng.uniform(0.2, 1.2, (50, copy.size))
    np.testing.assert_allclose(copy.slopes(q), original.slopes(q), rtol=1e-12)
    form, other = chained_form(copy), chained_form(original)
    np.testing.assert_allclose(form.z(q), other.z(q), rtol=1e-10)
    z = other.z(q) * rng.uniform(0.6, 1.4, q.shape)
    np.testing.assert_allclose(
        form.q(z, copy.branch(q[0])), other.q(z, original.branch(q[0])), atol=1e-9
    )


@given(value=st.floats(-2.0, 2.0), sign=st.sampled_from([-1.0, 1.0]))
def test_a_link_that_turns_once_has_two_branches(value: float, sign: float) -> None:
    """y' = s − s² on (−3, 3) turns at s = 1/2, where it is 1/4."""
    s = Coordinate("s", "")
    system = CustomSystem("turning", [X, s, Y], ["s - s**2"], intervals={"s": (-3.0, 3.0)})
    branch = np.array([1.0, sign, 1.0])
    z = np.array([0.0, value, 0.0])
    found = chained_form(system).q(z, branch)[1]
    margins = chained_form(system).margins(z, branch)
    root = np.sqrt(max(0.25 - value, 0.0))
    wanted = 0.5 - sign * root
    if value > 0.25:
        assert np.isnan(found)
        assert margins[2] == pytest.approx(-(value - 0.25), abs=1e-12)
    elif value < 0.25 - 1e-9:
        assert found == pytest.approx(wanted, abs=1e-7)
        np.testing.assert_allclose(
            margins, [(found + 3) / 6, (3 - found) / 6, 2 * root], rtol=1e-6, atol=1e-7
        )
        assert system.branch(np.array([0.0, found, 0.0]))[1] == sign


def test_there_is_no_branch_where_a_slope_turns_but_for_rounding() -> None:
    """y' = sin θ turns at π/2, where the cosine of the nearest number is 6e-17. Nor is there any at
    the ends of the interval."""
    system, turn = unicycle(slopes=["sin(theta)"], intervals={"theta": (0.0, np.pi)}), np.pi / 2
    signs = {0.0: 0, 1e-6: 1, turn - 1e-6: 1, turn: 0, turn + 1e-6: -1, np.pi: 0}
    for theta, sign in signs.items():
        assert system.branch(np.array([0.0, theta, 0.0]))[1] == sign


@pytest.mark.parametrize(("value", "failing"), [(-1.3, 0), (1.2, 1)])
def test_margin_of_a_slope_beyond_the_interval(value: float, failing: int) -> None:
    s = Coordinate("s", "")
    system = CustomSystem("straight", [X, s, Y], ["s"], intervals={"s": (-1.0, 1.0)})
    z, ones = np.array([0.0, value, 0.0]), np.ones(3)
    margins = chained_form(system).margins(z, ones)
    assert np.isnan(chained_form(system).q(z, ones)[1])
    assert margins[failing] == pytest.approx(-(abs(value) - 1), abs=1e-8)
    assert np.all(np.delete(margins, failing) >= 0)


def test_each_margin_says_of_which_coordinate_it_is() -> None:
    copy = SYSTEMS["custom-manipulator-3"]
    names = [c.name for c in copy.coordinates]
    labels = copy.margin_labels
    assert [i for i, _ in labels] == [1, 1, 1, 2, 2, 2]
    for i, label in labels:
        assert names[i] in label
    for i, label in labels[2::3]:  # of the slope of the next one
        assert [name for name in names if name in label.split()] == names[i : i + 2]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"slopes": ["tan(theta)", "x"]}, "3 coordinates need 1 slopes, not 2"),
        ({"slopes": ["x + theta"]}, "slope of y depends on x; in triangular form"),
        ({"slopes": ["2.0 * y"]}, "does not depend on theta"),
        ({"slopes": ["sin(3*theta)"]}, "has more than one extremum"),
        ({"slopes": ["tan(thta)"]}, "'thta' in 'tan"),
        ({"slopes": ["tan(theta"]}, "is not an expression"),
        ({"slopes": lambda q: [ca.if_else(q[1] > 0, q[1], 0)]}, "cannot be written"),
        ({"slopes": lambda q: [q]}, "not a scalar"),
        ({"drive": "__import__('os')"}, "not understood"),
        ({"coordinates": [X, THETA]}, "at least 3"),
        ({"coordinates": [X, Coordinate("a b", "rad"), Y]}, "'a b' cannot be the name"),
        ({"coordinates": [X, Coordinate("sin", "rad"), Y]}, "'sin' cannot be the name"),
        ({"coordinates": [X, THETA, X]}, "two coordinates are called 'x'"),
        ({"coordinates": [X, Coordinate("theta", "m"), Y]}, "give the interval of theta in m"),
        ({"intervals": {"y": (0, 1)}}, "intervals of y: only theta"),
        ({"intervals": {"theta": (1, 1)}}, r"interval of theta is \(1, 1\)"),
        ({"intervals": {"theta": (0, np.inf)}}, "interval of theta"),
    ],
)
def test_refusals_name_what_is_wrong(changes: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        unicycle(**changes)


def test_its_problem_file_gives_it_back_and_is_planned(tmp_path: Path) -> None:
    problem = planner.Problem.from_dict(
        {
            "system": unicycle().to_dict(),
            "start": {"q": {"x": 0.0, "theta": 0.1, "y": 0.0}},
            "goal": {"q": {"theta": 0.0, "y": 1.0}, "travel": 2.0},
        }
    )
    assert problem.system == unicycle()
    plan = planner.solve(problem, "polynomial")
    assert plan.verified
    saved = plan.save(tmp_path / "plan.json")
    np.testing.assert_array_equal(planner.load_plan(saved).q(3.0), plan.q(3.0))
