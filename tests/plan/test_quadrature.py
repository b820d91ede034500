"""Series on cells, against functions whose extremes, slopes and integrals are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebder, chebroots, chebval
from scipy.linalg import expm

from planner import Unicycle
from planner.plan import quadrature
from planner.plan.curves import Cells
from planner.plan.trajectory import Pieces
from planner.support.calculus.chebyshev import points

BREAKS = np.array([0.0, 1.5, 1.5, 2.0, 4.5])
"""The second piece takes no time."""


def _cells() -> Cells:
    """Parts of the first, third and fourth piece, of different widths, without a hole."""
    low, size = np.array([0.0, 0.25, 0.0, 0.0]), np.array([0.25, 0.75, 1.0, 1.0])
    return Cells(BREAKS, np.array([0, 0, 2, 3]), low, size)


def _times(cells: Cells) -> np.ndarray:
    """Of the 16 points of each cell, by the definition of Chebyshev–Lobatto points."""
    x = -np.cos(np.pi * np.arange(16) / 15)
    return cells.time(np.arange(len(cells.piece)), x[:, None])


def test_cells_lie_one_behind_the_other_and_skip_what_takes_no_time() -> None:
    np.testing.assert_array_equal(Cells.of(BREAKS).piece, [0, 2, 3])
    cells = _cells()
    np.testing.assert_allclose(cells.width, [0.375, 1.125, 0.5, 2.5], rtol=1e-15)
    times = _times(cells)
    np.testing.assert_allclose(times[0], [0.0, 0.375, 1.5, 2.0], rtol=1e-15)
    np.testing.assert_allclose(times[-1], [0.375, 1.5, 2.0, 4.5], rtol=1e-15)
    np.testing.assert_allclose(cells.time(np.array(3), np.array(0.5)), 2.0 + 0.75 * 2.5)
    x = (1 - np.cos(np.pi * np.arange(5) / 4)) / 2
    np.testing.assert_allclose(cells.fractions(points(5))[:, 1], 0.25 + 0.75 * x, rtol=1e-15)


def test_a_cell_is_split_into_four_of_the_same_width() -> None:
    cells = _cells().select(np.array([1, 3])).split()[0]
    np.testing.assert_array_equal(cells.piece, [0, 0, 0, 0, 3, 3, 3, 3])
    np.testing.assert_allclose(cells.width, [1.125 / 4] * 4 + [2.5 / 4] * 4, rtol=1e-15)
    begins = _times(cells)[0]
    np.testing.assert_allclose(begins, [*(0.375 + 0.28125 * np.arange(4)), 2, 2.625, 3.25, 3.875])


@pytest.mark.parametrize(
    ("function", "value", "time"),
    [
        (lambda t: np.cos(0.7 * (t - 0.2)), 1.0, 0.2),
        (lambda t: np.cos(0.7 * (t - 3.1234)), 1.0, 3.1234),
        (lambda t: -((t - 0.9) ** 2) - 3, -3.0, 0.9),
        (lambda t: t**3 / 9, 4.5**3 / 9, 4.5),  # at the last end
        (lambda t: 2 - t, 2.0, 0.0),
        (lambda t: (t - 1) ** 2 * (3 - t), 32 / 27, 7 / 3),  # beside a least value; more at t = 0
    ],
)
def test_greatest_value_and_its_time(
    function: Callable[[np.ndarray], np.ndarray], value: float, time: float
) -> None:
    """By calculus. The last function is 3 at t = 0, which lies in a cell that is left out."""
    cells = _cells().select(np.array([1, 2, 3])) if value == 32 / 27 else _cells()
    found, when = quadrature.greatest(cells, function(_times(cells))[..., None])
    assert found[0] == pytest.approx(value, rel=1e-13)
    assert when[0] == pytest.approx(time, abs=1e-7)
    low = quadrature.largest(cells, -function(_times(cells))[..., None])
    values = function(np.linspace(cells.time(np.array(0), np.array(-1.0)), 4.5, 100_001))
    assert low[0] == pytest.approx(np.max(np.abs(values)), rel=1e-9)


def test_the_greatest_may_lie_in_a_cell_whose_samples_are_lower() -> None:
    """A narrow top between two samples, 1.01 high, beside a wide one of height 1 at a sample."""
    cells = Cells.of(np.array([0.0, 1.0, 2.0, 3.0]))
    x = _times(cells) - np.arange(3)
    grid = (1 - np.cos(np.pi * np.arange(33) / 32)) / 2
    middle = (grid[16] + grid[17]) / 2
    top = 1.01 - 3000 * (x - middle) ** 2
    assert 1.01 - 3000 * (grid[16] - middle) ** 2 < 0.5
    values = np.where(np.arange(3) == 2, top, 1 - (x - grid[16]) ** 2)
    found, when = quadrature.greatest(cells, values[..., None])
    assert found[0] == pytest.approx(1.01, rel=1e-12)
    assert when[0] == pytest.approx(2 + middle, abs=1e-7)


def test_the_greatest_of_many_cells_need_not_be_in_the_highest_samples() -> None:
    """Eight parabolas; seven have their tops on samples, a lower one's is between two: by how much
    it is higher no sample tells."""
    cells, cell = Cells.of(np.arange(9.0)), np.arange(8)
    grid = (1 - np.cos(np.pi * np.arange(33) / 32)) / 2
    top = np.where(cell == 5, (grid[20] + grid[21]) / 2, grid[16])
    height = np.where(cell == 5, 1 + 1e-9, 1 - 1e-4 * cell)
    values = height - (_times(cells) - cell - top) ** 2
    at_samples = height - np.min((grid[:, None] - top) ** 2, axis=0)
    assert np.sum(at_samples > at_samples[5]) >= 5
    found, when = quadrature.greatest(cells, values[..., None])
    assert found[0] == pytest.approx(1 + 1e-9, abs=1e-14)
    assert when[0] == pytest.approx(5 + top[5], abs=1e-7)


def test_of_two_tops_in_a_cell_the_greater_may_have_the_lower_samples() -> None:
    """T₁₅ less a slope: its first top is between two close samples; its last, lower one is at the
    cell's end."""
    cells, series = Cells.of(np.array([0.0, 2.0])), np.eye(16)[15] - 1e-3 * np.eye(16)[1]
    values = chebval(_times(cells) - 1, series)
    close = chebval(-np.cos(np.pi * np.arange(129) / 128), series)
    assert np.argmax(close) == 128
    turns = chebroots(chebder(series))
    first = turns[np.argmax(chebval(turns, series))]
    found, when = quadrature.greatest(cells, values[..., None])
    assert found[0] == pytest.approx(chebval(first, series), rel=1e-12)
    assert when[0] == pytest.approx(1 + first, abs=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_the_greatest_of_any_series_is_where_its_slope_is_zero(seed: int) -> None:
    """Random series of degree 15, rough and smooth ones, and a hundred times the same but for a
    millionth; the zeros of their slopes are eigenvalues."""
    rng = np.random.default_rng(seed)
    series = rng.normal(size=(16, 30, 6)) * np.exp(
        -rng.uniform(0, 1.2, 6) * np.arange(16)[:, None, None]
    )
    series[..., 3:] = series[:, :1, 3:] + 1e-6 * series[..., 3:]
    cells = Cells.of(np.cumsum([0.0, *rng.uniform(0.1, 2, 30)]))
    x = -np.cos(np.pi * np.arange(16) / 15)
    found, when = quadrature.greatest(cells, chebval(x, series).transpose(2, 0, 1))
    for f in range(6):
        best = -np.inf
        for c in series[..., f].T:
            turns = chebroots(chebder(c))
            places = np.clip(np.append(turns.real[np.abs(turns.imag) < 1e-6], [-1, 1]), -1, 1)
            best = max(best, np.max(chebval(places, c)))
        size = np.max(np.abs(series[..., f]))
        assert found[f] == pytest.approx(best, abs=1e-11 * size)
        begins, ends = cells.breaks[:-1], cells.breaks[1:]
        near = (begins - 1e-12 <= when[f]) & (when[f] <= ends + 1e-12)  # two at a break
        at = 2 * (when[f] - begins[near]) / (ends - begins)[near] - 1
        there = [chebval(x, c) for x, c in zip(at, series[:, near, f].T, strict=True)]
        assert max(there) == pytest.approx(best, abs=1e-9 * size)


def test_functions_are_told_apart_and_none_hides_what_is_not_a_number() -> None:
    cells = _cells()
    t = _times(cells)
    values = np.stack([np.cos(t - 1), np.full_like(t, np.nan), np.cos(t - 3)], axis=-1)
    values[0, 0, 1] = 5.0
    found, when = quadrature.greatest(cells, values)
    np.testing.assert_allclose(found, [1, np.nan, 1], rtol=1e-13)
    np.testing.assert_allclose(when[[0, 2]], [1, 3], atol=1e-7)
    values[..., 1], values[3, 2, 1] = 0.0, np.nan
    with np.errstate(invalid="ignore"):
        assert np.isnan(quadrature.largest(cells, values)[1])


def test_slopes_of_a_polynomial_and_of_a_constant_with_rounding() -> None:
    """The rounding of 1 + 1e-16 in a cell of a microsecond must not become a slope."""
    cells = _cells()
    t = _times(cells)
    values = np.stack([t**5 - 2 * t, np.sin(t / 2)], axis=-1)
    exact = np.stack([5 * t**4 - 2, np.cos(t / 2) / 2], axis=-1)
    found = quadrature.slopes(cells, values)
    np.testing.assert_allclose(found[..., 0], exact[..., 0], rtol=0, atol=1e-10 * 5 * 4.5**4)
    np.testing.assert_allclose(found[..., 1], exact[..., 1], rtol=0, atol=1e-11)
    short = Cells.of(np.array([0.0, 1e-6]))
    x = _times(short)
    noise = 1e-16 * np.random.default_rng(0).choice([-1.0, 1.0], x.shape)
    found = quadrature.slopes(short, (1 + 3 * x + noise)[..., None])
    np.testing.assert_allclose(found, 3.0, rtol=1e-8)
    values = np.ones((16, 1, 2))
    values[4, 0, 1] = np.nan
    found = quadrature.slopes(short, values)
    np.testing.assert_array_equal(found[..., 0], 0.0)
    assert np.isnan(found[4, 0, 1])


def test_jumps_are_more_than_a_millionth_of_the_size() -> None:
    cells = _cells()
    t = _times(cells)
    after = t >= 1.9  # from the last cell on, but for the end of the one before
    after[-1, 2] = False
    size = [0.0, 0.9e-6, 1.1e-6, 1.1e-5]
    values = np.stack([1 + s * after for s in size], axis=-1)
    values[..., 3] *= -10
    np.testing.assert_array_equal(quadrature.jumps(values), [False, False, True, True])
    large = 100 * np.stack([1 + s * after for s in size], axis=-1)
    np.testing.assert_array_equal(quadrature.jumps(large), [False, False, True, True])
    assert not quadrature.jumps(values[:, :1]).any()


# -- the motion under an input -------------------------------------------------------------------


@dataclass(frozen=True)
class _Plane:
    """Rates given by a matrix: q̇ = M q u₁. The diagonal and above are what no chain reads."""

    matrix: np.ndarray

    @property
    def size(self) -> int:
        return len(self.matrix)

    def rates(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(q @ self.matrix.T * u[..., :1])


def _motion(
    system: Any,
    start: np.ndarray,
    breaks: np.ndarray,
    v: float = 2.0,
    degree: int = 0,
    **claim: Callable[[np.ndarray], np.ndarray],
) -> Any:
    """Under u = (v, w(t)), from a claimed q(t), by default the start at all times."""
    size = len(start)

    def inside(piece: Pieces, fraction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = breaks[piece] + np.diff(breaks)[piece] * fraction
        q = np.broadcast_to(start, (*t.shape, size)) if "q" not in claim else claim["q"](t)
        w = claim["w"](t) if "w" in claim else np.zeros_like(t)
        return q, np.stack([np.full_like(t, v), w], axis=-1)

    trajectory: Any = SimpleNamespace(
        system=system, breaks=breaks, piece_values=inside, degree=degree
    )
    return quadrature.integrate(trajectory, start)


@pytest.mark.parametrize("breaks", [[0.0, 3.0], [0.0, 0.2, 1.0, 3.0]])
@pytest.mark.parametrize("start", [[1.0, 0.5, -0.4], [1.0, 0.0, -0.4]])
def test_a_motion_whose_rates_read_themselves(breaks: list[float], start: list[float]) -> None:
    """A decaying oscillation and, driven by it, a third coordinate: exp(2 t M) q(0)."""
    system = _Plane(np.array([[-0.1, 2.0, 0.0], [-2.0, -0.1, 0.0], [0.0, 1.0, 0.3]]))
    motion = _motion(system, np.array(start), np.array(breaks))
    assert motion.error < 1e-7
    for t in (0.0, 0.13, 1.0, 2.9, 3.0):
        exact = expm(2 * t * system.matrix) @ start
        np.testing.assert_allclose(motion.q_at_time(t), exact, rtol=0, atol=1e-9)


def test_cells_are_split_until_the_motion_itself_is_resolved() -> None:
    """It claims to stand still, where no cell would be split, and turns eight times round."""
    motion = _motion(Unicycle(), np.zeros(3), np.array([0.0, 5.0]), w=lambda t: np.full_like(t, 10))
    assert motion.error < 1e-7
    assert len(motion.cells.piece) >= 4
    for t in (0.0, 1.3, 4.9, 5.0):
        turned = [np.sin(10 * t) / 5, 10 * t, (1 - np.cos(10 * t)) / 5]
        np.testing.assert_allclose(motion.q_at_time(t), turned, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("power", "error"), [(12, 0.0), (13, 1e-11), (14, 1e-11), (15, 1e-11)])
def test_the_error_is_what_the_last_three_coefficients_move(power: int, error: float) -> None:
    """Turning on the spot, at 1e-12 rad/s times a Chebyshev polynomial: in 10 s 1e-11 rad at most.

    The integral of the last one is a polynomial of degree 16, of which 3 % is not held.
    """
    series, breaks = 1e-12 * np.eye(16)[power], np.array([0.0, 10.0])
    found = _motion(Unicycle(), np.zeros(3), breaks, 0.0, w=lambda t: chebval(t / 5 - 1, series))
    assert found.error == pytest.approx(error, rel=0.04, abs=1e-14)


def test_the_gap_is_greatest_where_the_claim_is_farthest_off() -> None:
    """Straight on at 2 m/s; the claim is 0.02 m off in the middle of the second piece."""
    breaks = np.array([0.0, 1.0, 3.0])

    def claim(t: np.ndarray) -> np.ndarray:
        off = np.where(t > 1, 0.02 * (1 - (t - 2) ** 2), 0.0)
        return np.stack([2 * t, 0 * t, off], axis=-1)

    motion = _motion(Unicycle(), np.zeros(3), breaks, q=claim)
    assert motion.gap == (pytest.approx(0.02), pytest.approx(2.0))


def _vanishing(counts: tuple[int, ...], width: float) -> Callable[[np.ndarray], np.ndarray]:
    """A polynomial of t, one high, that is zero at sets of so many Chebyshev–Lobatto points."""
    cosines = [-np.cos(np.pi * np.arange(n) / (n - 1)) for n in counts]
    zeros = np.unique(np.round(np.concatenate(cosines), 12))
    fine = np.linspace(-1, 1, 10_001)
    most = np.max(np.abs(np.prod(fine - zeros[:, None], axis=0)))
    return lambda t: (
        np.prod(2 * t / width - 1 - zeros.reshape(-1, *[1] * np.ndim(t)), axis=0) / most
    )


@pytest.mark.parametrize(
    ("counts", "degree"), [((16,), 0), ((16,), 16), ((16, 29), 43), ((16, 31), 32)]
)
def test_an_input_that_vanishes_at_all_points_is_seen(counts: tuple[int, ...], degree: int) -> None:
    """In a microsecond it moves nothing; one of degree 43 is zero at the 29 control points too, one
    of degree 31 at 31 points, which contain the 16 that are read."""
    wiggle, width = _vanishing(counts, 1e-6), 1e-6
    breaks = np.array([0.0, width, 1.0])

    def w(t: np.ndarray) -> np.ndarray:
        return 0.1 + np.where(t <= width, wiggle(np.minimum(t, width)), 0.0)

    motion = _motion(Unicycle(), np.zeros(3), breaks, w=w, degree=degree)
    peak = np.max(w(np.linspace(0, width, 100_001)))
    assert peak > 1
    assert quadrature.largest(motion.cells, motion.u)[1] == pytest.approx(peak, rel=1e-6)
    assert motion.unresolved_input[0] < quadrature.INPUT_TOLERANCE


@pytest.mark.parametrize("size", [1e-3, 1.0, 50.0])
def test_an_input_that_no_cells_resolve_is_told_with_its_time(size: float) -> None:
    """A jump inside a piece, of a part in 100,000: it moves less than the integral's tolerance."""
    breaks = np.array([0.0, 3.0])
    motion = _motion(
        Unicycle(), np.zeros(3), breaks, 0.0, w=lambda t: size + 1e-5 * size * (t > 2.2)
    )
    amount, when = motion.unresolved_input
    assert 1e-6 < amount < 1e-5
    assert when == pytest.approx(2.2, abs=1e-5)


def test_rounding_in_an_input_is_compared_with_the_larger_one() -> None:
    """A steering input of 1e-9 that is all noise, beside a speed of one."""
    rng = np.random.default_rng(0)
    breaks = np.array([0.0, 3.0])
    noise = lambda t: rng.uniform(-1e-10, 1e-10, np.shape(t))  # noqa: E731
    motion = _motion(Unicycle(), np.zeros(3), breaks, 1.0, w=noise)
    assert len(motion.cells.piece) <= 4
    assert motion.unresolved_input[0] < quadrature.INPUT_TOLERANCE
