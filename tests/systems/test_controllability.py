"""Brackets and ranks against an independent SymPy computation, and against known results."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from planner import (
    BallGear,
    Car,
    InputError,
    Manipulator,
    Trailers,
    TriangularSystem,
    Unicycle,
    controllability,
)
from planner.problem.nonholonomy import paper_recursion
from planner.systems.controllability import bracket_name, brackets, lyndon_words, split

HALF = sp.Rational(1, 2)
ARM = Manipulator([0.75, 0.5], 0.5)
ARM4 = Manipulator([0.75, 0.5, 1.25], 0.5)
D30 = np.pi / 6


@cache
def equations(name: str) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
    """q, g₁ and g₂ in SymPy, from the literature's equations and not from the package."""
    if name == "unicycle":
        q = sp.Matrix(sp.symbols("x theta y"))
        return q, sp.Matrix([sp.cos(q[1]), 0, sp.sin(q[1])]), sp.Matrix([0, 1, 0])
    if name == "car":
        q = sp.Matrix(sp.symbols("x phi theta y"))
        g1 = [sp.cos(q[2]), 0, sp.tan(q[1]) / 2, sp.sin(q[2])]
        return q, sp.Matrix(g1), sp.Matrix([0, 1, 0, 0])
    n = int(name[-1])
    q = sp.Matrix(sp.symbols(f"phi theta1:{n + 1}"))
    k_g, K = HALF, [sp.Rational(3, 4), HALF, sp.Rational(5, 4)][: n - 1]

    def product(last: int) -> Any:
        return sp.prod([sp.cos(q[j]) for j in range(1, last + 1)])

    passive = [k_g * K[i - 2] * sp.cos(q[i - 1]) ** 3 * product(i - 2) for i in range(2, n + 1)]
    g1 = sp.Matrix([k_g * product(n - 2), 0, *passive])
    return q, g1, sp.Matrix([0, 1, *[0] * (n - 1)])


SYSTEMS: dict[str, TriangularSystem] = {
    "unicycle": Unicycle(),
    "car": Car(2.0),
    "arm3": ARM,
    "arm4": ARM4,
}


def sympy_bracket(f: sp.Matrix, g: sp.Matrix, q: sp.Matrix) -> sp.Matrix:
    return g.jacobian(q) * f - f.jacobian(q) * g


@cache
def named(name: str, bracket: str) -> sp.Matrix:
    """The bracket of that name, by reading the name."""
    q, g1, g2 = equations(name)
    if bracket in ("g1", "g2"):
        return g1 if bracket == "g1" else g2
    depth, inner = 0, bracket[1:-1]
    for k, letter in enumerate(inner):
        depth += (letter == "[") - (letter == "]")
        if letter == "," and depth == 0:
            return sympy_bracket(named(name, inner[:k]), named(name, inner[k + 1 :]), q)
    raise AssertionError(bracket)


def growth_by_sympy(name: str, at: list[Any], depth: int) -> list[int]:
    """Ranks of all right-nested brackets [a,[b,[…]]], a spanning family other than ours."""
    q, g1, g2 = equations(name)
    level, seen, ranks = [g1, g2], [g1, g2], []
    for length in range(1, depth + 1):
        if length == 2:
            level = [sympy_bracket(g1, g2, q)]
        elif length > 2:
            level = [sympy_bracket(g, b, q) for b in level for g in (g1, g2)]
        seen = seen if length == 1 else seen + level
        values = [b.subs(dict(zip(q, at, strict=True))) for b in seen]
        columns = sp.Matrix.hstack(*values).applyfunc(lambda e: sp.N(e, 40))
        ranks.append(columns.rank(iszerofunc=lambda e: abs(e) < 1e-25))
    return ranks


THIRTY = sp.pi / 6
POINTS: list[tuple[str, list[Any], tuple[int, ...]]] = [
    ("unicycle", [0, 0, 0], (2, 3)),
    ("unicycle", [1, 2, 3], (2, 3)),
    ("car", [0, 0, 0, 0], (2, 3, 4)),
    ("car", [0, THIRTY, 2, 1], (2, 3, 4)),
    ("arm3", [0, THIRTY, THIRTY, THIRTY], (2, 3, 4)),
    ("arm3", [1, sp.pi / 180, sp.pi / 180, sp.pi / 180], (2, 3, 4)),
    ("arm3", [0, 0, THIRTY, THIRTY], (2, 2, 3, 4)),
    ("arm3", [0, THIRTY, 0, THIRTY], (2, 3, 3, 4)),
    ("arm3", [0, 0, 0, 0], (2, 2, 3, 3, 4)),
    ("arm4", [0, THIRTY, THIRTY, THIRTY, 0], (2, 3, 4, 5)),
    ("arm4", [0, 0, THIRTY, THIRTY, 0], (2, 2, 3, 4, 5)),
    ("arm4", [0, THIRTY, 0, THIRTY, 0], (2, 3, 3, 4, 5)),
]


@pytest.mark.parametrize(("name", "at", "growth"), POINTS)
def test_growth_vectors_against_sympy(name: str, at: list[Any], growth: tuple[int, ...]) -> None:
    found = controllability(SYSTEMS[name], [float(v) for v in at])
    assert found.growth == growth == tuple(growth_by_sympy(name, at, len(growth)))
    assert found.degree == len(growth)
    assert found.chow
    assert not found.involutive
    assert len(found.basis) == len(at)
    usual = tuple(range(2, len(at) + 1))
    assert found.regular == (found.growth == usual)
    assert all(around[: len(usual)] == usual for around in found.neighbours)


def test_the_page_of_the_theory_has_these_growth_vectors() -> None:
    """In its order: θ₁ = 0, elsewhere, θ₂ = 0 alone, both zero; and what the first bracket does."""
    page = (Path(__file__).parents[2] / "docs" / "theory.md").read_text(encoding="utf-8")
    section = page.partition("\n## Controllability\n")[2].partition("\n## ")[0]
    said = [tuple(map(int, v.split(", "))) for v in re.findall(r"\((\d(?:, \d)+)\)", section)]
    places = ([0, 0, D30, D30], [0, D30, D30, D30], [0, D30, 0, D30], [0, 0, 0, D30])
    found = [controllability(ARM, place) for place in places]
    assert said == [each.growth for each in found]
    first = [np.linalg.norm(brackets(ARM).values(np.array(place), 2)) for place in places]
    assert [value > 1e-12 for value in first] == [False, True, True, False]
    assert re.search(r"At \$\\theta_1 = 0\$ the first bracket vanishes", section)
    assert re.search(r"At \$\\theta_2 = 0\$ alone the\s+first bracket does not vanish", section)


def test_values_of_brackets_and_depth() -> None:
    """At 30 degrees: the matrix of g₁, g₂, [g₁,g₂] and both brackets of length 3, by SymPy."""
    q, *_ = equations("arm3")
    at = dict(zip(q, [0, THIRTY, THIRTY, THIRTY], strict=True))
    names = ["g1", "g2", "[g1,g2]", "[g1,[g1,g2]]", "[[g1,g2],g2]"]
    columns = sp.Matrix.hstack(*(named("arm3", n).subs(at) for n in names))
    values = np.linalg.svd(np.array(columns.evalf(), dtype=float), compute_uv=False)
    found = controllability(ARM, [0, D30, D30, D30])
    np.testing.assert_allclose(found.singular_values, values, rtol=1e-10)
    assert controllability(ARM, [0, D30, D30, D30], depth=5).growth == (2, 3, 4, 4, 4)
    shallow = controllability(ARM, [0, 0, 0, 0], depth=3)
    assert shallow.growth == (2, 2, 3)
    assert (shallow.chow, shallow.degree) == (False, None)
    assert "not shown to this depth" in str(shallow)
    assert "above 3" in str(shallow)
    assert controllability(BallGear([0.75, 0.5]), np.zeros(4)).regular


@pytest.mark.parametrize("name", SYSTEMS)
def test_bracket_values_against_sympy(name: str) -> None:
    system = SYSTEMS[name]
    rng = np.random.default_rng(0)
    q, *_ = equations(name)
    at = rng.uniform(-1, 1, system.size)
    family = brackets(system)
    for length in (1, 2, 3, 4):
        names, values = family.names(length), family.values(at, length)
        for bracket, value in zip(names, values, strict=True):
            exact = named(name, bracket).subs(dict(zip(q, at, strict=True)))
            wanted = np.array(exact.evalf(), dtype=float)[:, 0]
            np.testing.assert_allclose(value, wanted, rtol=1e-11, atol=1e-12, err_msg=bracket)


@pytest.mark.parametrize("n", [2, 3, 4, pytest.param(5, marks=pytest.mark.campaign)])
def test_the_straight_arm_needs_brackets_of_length_2n_minus_1(n: int) -> None:
    found = controllability(Manipulator([0.8, 0.7, 0.6, 0.5][: n - 1]), np.zeros(n + 1))
    assert found.degree == 2 * n - 1
    assert found.growth == tuple(2 + k // 2 for k in range(2 * n - 1))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_trailers_are_controllable_and_jackknifed_ones_with_longer_brackets(n: int) -> None:
    system = Trailers([2.0, 1.5, 1.0][:n], 2.0)
    straight = controllability(system, np.zeros(n + 4))
    assert straight.growth == tuple(range(2, n + 5))
    bent = np.zeros(n + 4)
    bent[2] = np.pi / 2
    found = controllability(system, bent)
    assert found.chow
    assert (found.degree or 0) >= n + 3


class _Plane(Unicycle):
    """ẋ = u₁, θ̇ = u₂, ẏ = u₁: y − x never changes."""

    kind = "plane"

    def rates_expr(self, q: Any, u: Any) -> list[Any]:
        return [u[0], u[1], u[0]]


def test_an_integrable_distribution_is_recognised() -> None:
    found = controllability(_Plane(), np.zeros(3))
    assert found.involutive
    assert not found.chow
    assert found.growth == (2, 2, 2)
    assert "is involutive" in str(found)


def test_report_names_what_is_tested() -> None:
    text = str(controllability(ARM, [0, D30, D30, D30]))
    for part in ("(2, 3, 4)", "Frobenius", "Chow", "[g1,[g1,g2]]", "singular values", "1e-14"):
        assert part in text
    text = str(controllability(ARM, [0, 0, D30, D30]))
    assert "singular point (around it: (2, 3, 4, 4))" in text
    data = controllability(ARM, [0, 0, D30, D30]).to_dict()
    assert data["growth_vector"] == [2, 2, 3, 4]
    assert data["regular"] is False


@pytest.mark.parametrize(
    ("system", "q", "depth", "says"),
    [
        (ARM, [0, 1], None, "needs 4 finite numbers"),
        (ARM, [0, 1, np.nan, 0], None, "finite"),
        (ARM, [0, 1, 1, 0], 0, "depth = 0"),
        (Car(2.0), [0, np.pi / 2, 0, 0], None, "infinite"),
    ],
)
def test_impossible_questions_are_refused(
    system: TriangularSystem, q: list[float], depth: int | None, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        controllability(system, q, depth)


def test_lyndon_words_count_and_factor() -> None:
    """Witt's formula over two letters: 2, 1, 2, 3, 6, 9, 18, 30 words of length 1 … 8."""
    assert [len(lyndon_words(k)) for k in range(1, 9)] == [2, 1, 2, 3, 6, 9, 18, 30]
    assert [bracket_name(w) for w in lyndon_words(3)] == ["[g1,[g1,g2]]", "[[g1,g2],g2]"]
    with pytest.raises(ValueError, match="letter"):
        split((1,))


# -- the paper's recursion -------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 4, 5, pytest.param(6, marks=pytest.mark.campaign)])
def test_corrected_recursion_builds_the_basis_and_the_printed_one_does_not(n: int) -> None:
    """From four joints on it is dependent everywhere: at any two points."""
    system = Manipulator([0.8, 0.7, 0.6, 0.5, 0.9][: n - 1], 0.7)
    for q in np.linspace([0.2, 1.2], [0.9, 0.3], n + 1).T:
        found = paper_recursion(system, q)
        assert max(found.corrected.x_error + found.corrected.y_error) < 1e-9
        assert found.corrected.divides_by_zero == ()
        assert found.corrected.determinant == pytest.approx(system.k_g, rel=1e-9)
        if n >= 4:
            assert found.printed.determinant == pytest.approx(0, abs=1e-9)


def test_printed_recursion_fails_at_every_step_on_its_own_mechanism() -> None:
    """By hand: (12) gives X₂ = (0, 1 + 2s², y₂/(k₂c²)), (13) gives Y₂ = −2k₂c³s ∂/∂θ₂."""
    printed = paper_recursion(ARM, [0, 0.5, 0.7, 0.3]).printed
    s, c, k2, k3, k_g = np.sin(0.5), np.cos(0.5), 0.375, 0.25, 0.5
    rest = max(k3 * np.cos(0.7) ** 3, k_g)
    assert printed.x_error[0] == pytest.approx(max(2 * s**2, rest / (k2 * c**2)))
    assert printed.y_error[0] == pytest.approx(max(2 * k2 * c**3 * s, rest))
    assert min(printed.x_error + printed.y_error) > 0.1
    assert abs(printed.determinant) > 0.1
    assert paper_recursion(ARM, [0, 0, 0.5, 0.3]).printed.determinant == pytest.approx(0)


def test_division_by_zero_is_named() -> None:
    found = paper_recursion(ARM, [0, D30, 0, D30])
    assert found.corrected.divides_by_zero == (2,)
    assert found.corrected.x_error[0] < 1e-12
    assert np.isnan(found.corrected.determinant)
    text = str(found)
    assert "step 1: does not hold" in text
    assert "step 1: holds" in text
    assert "step 2: divides by zero" in text
    both = paper_recursion(ARM, [0, 0, 0, D30])
    assert both.corrected.divides_by_zero == (1, 2)
    assert "step 1: divides by zero" in str(both)


def test_recursion_is_for_the_manipulator() -> None:
    with pytest.raises(InputError, match="not the ball-gear"):
        paper_recursion(BallGear([0.8]), [0, 0.1, 0.2])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"\b4 numbers"):
        paper_recursion(ARM, [0.1])
