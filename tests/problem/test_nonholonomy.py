import numpy as np

import planner
from planner.problem.nonholonomy import nonholonomy


def test_regular_start_and_the_drop_at_zero(paper: planner.Problem) -> None:
    found = nonholonomy(paper)
    growth = {place.name: place.finding.growth for place in found.places if place.finding}
    assert growth == {
        "start": (2, 3, 4),
        "goal": (2, 3, 4),
        "start with theta1 = 0": (2, 2, 3, 4),
    }
    assert "Frobenius: not involutive" in str(found.places[0])
    assert "Chow: controllable" in str(found.places[2])


def test_the_papers_recursion_is_judged(paper: planner.Problem, unlimited: planner.Problem) -> None:
    assert "fails at step 1, 2" in nonholonomy(paper).recursion_verdict
    straight = unlimited.changed({"start.theta_deg": [0, 10, 10]})
    assert "corrected for cos^3 it divides by zero at step 1" in (
        nonholonomy(straight).recursion_verdict
    )


def test_deep_singularities_are_bounded_and_said(unlimited: planner.Problem) -> None:
    data = unlimited.to_dict()
    data["system"] = {"kind": "manipulator", "joints": 6, "K": [0.8] * 5, "k_g": 0.7}
    data["start"], data["goal"]["theta_deg"] = {"theta_deg": [0.0] * 6}, [10.0] * 6
    found = nonholonomy(planner.Problem.from_dict(data)).places[0]
    assert found.finding is not None
    assert not found.finding.chow
    assert "not shown up to bracket length 8" in str(found)


def test_other_systems_have_no_recursion(unlimited: planner.Problem) -> None:
    car = planner.load_problem(str(unlimited.source).replace("paper.toml", "car.toml"))
    found = nonholonomy(car)
    assert found.recursion is None
    assert found.to_dict()["paper_recursion"] is None
    assert [place.name for place in found.places] == ["start", "goal"]
    assert np.all([place.finding is not None for place in found.places])
