"""The drawn mechanism is the one that moves: its radii and contacts give the arm's rates."""

from __future__ import annotations

from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import planner
from planner import BallGear, Gear, InputError, Manipulator
from planner.report import plot_mechanism
from planner.report.figures.mechanism import BEND_ANGLE

GEAR = Gear(r1=30.0, R=36.0, r3=25.0, lam=1.3, eta=1.4)
LARGEST = 36.0

ARMS = {
    "gear, 2 joints": Manipulator.from_gear(2, GEAR),
    "gear, 3 joints": Manipulator.from_gear(3, GEAR),
    "gear, 5 joints": Manipulator.from_gear(5, GEAR),
    "gear by the printed rule": Manipulator.from_gear(4, GEAR, rule="printed"),
    "the paper's K": Manipulator([0.870125, 0.711625], 0.668811),
    "K of 2 joints": Manipulator([0.8], 0.6),
    "K of uneven stages": Manipulator([0.8, 0.7, 0.9], 0.5),
}


class Drawn:
    """Parts of a picture by name, as boxes (left, low, right, high)."""

    def __init__(self, system: Manipulator) -> None:
        self.figure, self.ax = plot_mechanism(system)
        self.n = system.n

    def box(self, gid: str) -> Any:
        (patch,) = (p for p in self.ax.patches if p.get_gid() == gid)
        points = patch.get_path().vertices @ patch.get_patch_transform().get_matrix()[:2, :2].T
        points = points + patch.get_patch_transform().get_matrix()[:2, 2]
        return np.concatenate([points.min(axis=0), points.max(axis=0)])

    def point(self, gid: str) -> Any:
        (dot,) = (line for line in self.ax.lines if line.get_gid() == gid)
        return np.ravel(dot.get_data())

    def words(self) -> str:
        return " ".join(text.get_text() for text in self.ax.texts)

    def centre(self, gid: str) -> Any:
        left, low, right, high = self.box(gid)
        return np.array([left + right, low + high]) / 2

    def radius(self, gid: str, axis: int) -> float:
        """Half of the width (0) or height (1)."""
        box = self.box(gid)
        return float(box[axis + 2] - box[axis]) / 2


FURTHER = ("gear, 3 joints", "K of 2 joints", "K of uneven stages")
CASES = [
    pytest.param(name, marks=pytest.mark.campaign) if name in FURTHER else name for name in ARMS
]


@pytest.fixture(scope="module", params=CASES)
def drawn(request: pytest.FixtureRequest) -> tuple[Manipulator, Drawn]:
    return ARMS[request.param], Drawn(ARMS[request.param])


def test_lengths_are_to_scale() -> None:
    picture = Drawn(ARMS["gear, 3 joints"])
    for i in (1, 2):
        assert picture.radius(f"B{i}", 1) == pytest.approx(30 / LARGEST)
        joint = picture.centre(f"B{i}")[0]
        assert picture.centre(f"A{i}")[0] - joint == pytest.approx(36 / LARGEST)
        assert picture.centre(f"A'{i}")[0] - joint == pytest.approx(25 / LARGEST)
    on_axle, on_shaft = picture.box("bevel gear of A1"), picture.box("bevel gear of B2")
    ratio = (on_shaft[3] - on_shaft[1]) / (on_axle[2] - on_axle[0])
    assert ratio == pytest.approx(1.3)
    pulleys = picture.radius("pulley of joint 2", 0) / picture.radius("pulley of A'1", 0)
    assert pulleys == pytest.approx(1.4)
    assert "$r_1$ = 30, $R$ = 36, $r_3$ = 25," in picture.words()
    assert "To scale, with" in picture.words()
    assert "inferred" not in picture.words()


def test_wheels_touch_disks_on_the_axis_of_the_joint(drawn: tuple[Manipulator, Drawn]) -> None:
    _, picture = drawn
    for i in range(1, picture.n):
        wheel, disk = picture.box(f"B{i}"), picture.box(f"A{i}")
        below, second = picture.box(f"B'{i}"), picture.box(f"A'{i}")
        axis = picture.centre(f"B{i}")[0]
        touching = {"P1": (wheel[1], disk[3]), "P2": (below[3], disk[1])}
        touching["P3"] = (below[1], second[3])
        for name, (of_wheel, of_disk) in touching.items():
            x, z = picture.point(f"{name} of joint {i}")
            assert x == pytest.approx(axis)
            assert z == pytest.approx(of_wheel)
            assert z == pytest.approx(of_disk)
        assert picture.centre(f"B'{i}")[0] == pytest.approx(axis)
        assert disk[0] < axis < disk[2]  # the contact lies within the rims
        assert second[0] < axis < second[2]


def test_what_is_drawn_moves_the_joints_as_the_arm_does(drawn: tuple[Manipulator, Drawn]) -> None:
    """Contact by contact and gear by gear, by the lengths in the picture alone."""
    system, picture = drawn
    n = system.n
    q = np.array([0.0, *np.linspace(0.3, -0.8, n)])
    rates = system.rates(q, np.array([1.0, 0.0]))
    disk = 1.0  # of B1, which motor 1 turns
    for i in range(1, n):
        cosine, axis = np.cos(q[i]), picture.centre(f"B{i}")[0]
        at_p1, at_p3 = picture.centre(f"A{i}")[0] - axis, picture.centre(f"A'{i}")[0] - axis
        face = disk * picture.radius(f"B{i}", 1) * cosine / at_p1
        idler = face * at_p1 * cosine / picture.radius(f"B'{i}", 1)
        lower = idler * picture.radius(f"B'{i}", 1) * cosine / at_p3
        own, other = f"pulley of A'{i}", f"pulley of joint {i + 1}"
        joint = lower * picture.radius(own, 0) / picture.radius(other, 0)
        assert joint == pytest.approx(rates[i + 1], rel=1e-12)
        if i < n - 1:
            on_shaft = picture.radius(f"bevel gear of B{i + 1}", 1)
            disk = face * picture.radius(f"bevel gear of A{i}", 0) / on_shaft
    if system.k_g_rule.startswith("chain"):
        assert disk == pytest.approx(rates[0], rel=1e-12)


def test_bevel_gears_mesh_and_lead_to_the_next_wheel() -> None:
    picture = Drawn(ARMS["gear, 3 joints"])
    on_axle, on_shaft = picture.box("bevel gear of A1"), picture.box("bevel gear of B2")
    apex = np.array([picture.centre("A1")[0], picture.centre("B2")[1]])  # where the axles meet
    assert picture.centre("bevel gear of A1")[0] == pytest.approx(apex[0])
    assert picture.centre("bevel gear of B2")[1] == pytest.approx(apex[1])
    assert on_axle[[2, 1]] == pytest.approx(on_shaft[[2, 1]])  # the outer end of the common edge
    assert not any(p.get_gid() == "bevel gear of A2" for p in picture.ax.patches)  # drives no disk


def test_parts_keep_clear_of_each_other(drawn: tuple[Manipulator, Drawn]) -> None:
    _, picture = drawn
    for i, k in pairwise(range(1, picture.n)):
        for upper in ("A", "A'"):
            assert picture.box(f"{upper}{i}")[2] < picture.box(f"{upper}{k}")[0]
    last = f"pulley of joint {picture.n}"
    assert picture.box(f"A'{picture.n - 1}")[2] < picture.box(last)[0]
    assert picture.box(last)[3] < picture.box("A'1")[1]


def test_the_view_from_above_shows_the_cosine(drawn: tuple[Manipulator, Drawn]) -> None:
    _, picture = drawn
    here = picture.point("P1 from above")
    radius = picture.centre("A1 from above") - here
    stage = picture.centre("A1")[0] - picture.centre("B1")[0]
    assert np.hypot(*radius) == pytest.approx(stage)
    assert np.arctan2(*radius[::-1]) == pytest.approx(BEND_ANGLE)
    assert picture.radius("B1 from above", 1) == pytest.approx(picture.radius("B1", 1))
    ends = {a.get_gid(): np.array(a.xy) - here for a in picture.ax.texts if a.get_gid()}
    rim, taken = ends["speed of B1"], ends["speed of A1"]
    assert np.hypot(*taken) / np.hypot(*rim) == pytest.approx(np.cos(BEND_ANGLE))
    assert taken @ radius == pytest.approx(0, abs=1e-12)  # A turns about its axle
    assert (rim - taken) @ taken == pytest.approx(0, abs=1e-12)


def test_what_was_inferred_is_said() -> None:
    words = Drawn(ARMS["the paper's K"]).words()
    assert "Not to scale, but with the same K and k_g:" in words
    assert "To scale" not in words
    assert "$r_1$ = 0.8178, $R$ = 1, $r_3$ = 1.405," in words
    assert "inferred from K and k_g with λ = η = 1 and R = 1; φ of the" in words
    assert "0.818 times the angle of the last wheel B" in words
    assert "$r_3$ of joint 1 =" in Drawn(ARMS["K of uneven stages"]).words()
    assert "R = 1 = r₁" in Drawn(ARMS["K of 2 joints"]).words()


def test_no_words_lie_on_each_other(drawn: tuple[Manipulator, Drawn]) -> None:
    _, picture = drawn
    picture.figure.draw_without_rendering()
    boxes = [(t.get_text(), t.get_window_extent()) for t in picture.ax.texts if t.get_text()]
    edges = picture.figure.bbox
    for text, box in boxes:
        assert edges.x0 <= box.x0 < box.x1 <= edges.x1, text
        assert edges.y0 <= box.y0 < box.y1 <= edges.y1, text
    for (one, a), (other, b) in combinations(boxes, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert wide <= 0 or high <= 4, (one, other)  # lines of formulas are that much higher


def test_it_draws_into_axes_of_mine_and_refuses_other_systems() -> None:
    figure = Figure()
    ax = figure.subplots()
    assert plot_mechanism(ARMS["gear, 2 joints"], axes=ax) == (figure, ax)
    assert figure.get_suptitle() == ""
    with pytest.raises(InputError, match="Manipulator"):
        plot_mechanism(BallGear([0.8]))


def test_a_problem_keeps_the_geometry_it_was_given(paper: planner.Problem) -> None:
    gear = {"r1": 30.0, "R": 36.0, "r3": 25.0, "lambda": 1.3, "eta": 1.4}
    system = {"kind": "manipulator", "joints": 3, "gear": gear}
    problem = planner.Problem.from_dict(paper.to_dict() | {"system": system})
    assert isinstance(problem.system, Manipulator)
    assert problem.system.gear == GEAR
    assert isinstance(paper.system, Manipulator)
    assert paper.system.gear is None
