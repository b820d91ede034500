import numpy as np
import pytest

from planner.support.calculus.chebyshev import Grid
from planner.support.calculus.extremes import maximum, minimum, sample_times, zeros
from planner.support.calculus.inverse import inverse


def test_samples_cover_both_sides_of_every_break() -> None:
    times = sample_times(np.array([0.0, 1.0, 3.0]), 40)
    assert times[0] == 0.0
    assert times[-1] == 3.0
    assert np.all(np.diff(times) >= 0)
    assert 1.0 in times
    assert np.nextafter(1.0, 0.0) in times


def test_extremes_are_found_between_samples() -> None:
    times = np.linspace(0, 3, 7)
    value, when = minimum(lambda t: (t - 1.234) ** 2 - 2.0, times)
    assert value == pytest.approx(-2.0, abs=1e-12)
    assert when == pytest.approx(1.234, abs=1e-5)
    assert maximum(np.sin, times) == pytest.approx((1.0, np.pi / 2), abs=1e-6)
    assert np.isnan(minimum(lambda t: t * np.nan, times)[0])


def test_zeros_by_sign_change() -> None:
    found = zeros(np.cos, np.linspace(0, 7, 50))
    np.testing.assert_allclose(found, [np.pi / 2, 3 * np.pi / 2], atol=1e-12)
    found = zeros(lambda t: np.where(t > 0.5, np.nan, 1.0), np.linspace(0, 1, 10))
    np.testing.assert_allclose(found, [0.5], atol=1e-9)  # NaN counts as outside
    found = zeros(lambda t: (t - 30.3) ** 9, np.linspace(0.0, 80.0, 3))
    assert found == pytest.approx([30.3], abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_short_excursion_between_two_samples_is_not_missed(sign: int) -> None:
    times = np.linspace(0, 1, 11)

    def dip(t: np.ndarray) -> np.ndarray:
        return sign * ((t - 0.55) ** 2 - 1e-4)

    np.testing.assert_allclose(zeros(dip, times), [0.54, 0.56], atol=1e-9)


def test_the_lowest_dip_is_found_though_others_were_sampled_better() -> None:
    """Five dips at samples, and between two samples one that is deeper by 1e-6."""
    times = np.linspace(0, 10, 1001)
    centres, depths = np.array([1, 2, 3, 4, 5, 7.005]), np.array([1, 1, 1, 1, 1, 1 + 1e-6])

    def dips(t: np.ndarray) -> np.ndarray:
        return np.asarray(np.min((t[..., None] - centres) ** 2 - depths, axis=-1))

    value, when = minimum(dips, times)
    assert value == pytest.approx(-1 - 1e-6, abs=1e-9)
    assert when == pytest.approx(7.005, abs=1e-4)


def test_dips_with_corners_are_found_between_samples_however_many_there_are() -> None:
    """Thirty whose corners lie on samples, and one between two that seems the least of all."""
    times = np.linspace(0, 40, 4001)
    centres, depths = np.append(np.arange(1, 31), 35.005), np.append(np.ones(30), 1 + 1e-7)

    def corners(t: np.ndarray) -> np.ndarray:
        return np.asarray(np.min(np.abs(t[..., None] - centres) - depths, axis=-1))

    value, when = minimum(corners, times)
    assert value == pytest.approx(-1 - 1e-7, abs=1e-11)
    assert when == pytest.approx(35.005, abs=1e-10)


def test_all_short_excursions_are_found() -> None:
    """Thirty of 0.004 s, all of them between two samples that are 0.01 s apart."""
    times, centres = np.linspace(0, 40, 4001), np.arange(1, 31) + 0.005

    def corners(t: np.ndarray) -> np.ndarray:
        return np.asarray(np.min(np.abs(t[..., None] - centres), axis=-1) - 0.002)

    ends = np.sort(np.concatenate([centres - 0.002, centres + 0.002]))
    np.testing.assert_allclose(zeros(corners, times), ends, atol=1e-9)


def test_an_inverse_is_found_by_newton_and_not_by_halving() -> None:
    asked = 0

    def tangent(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal asked
        asked += 1
        return np.tan(x), 1 / np.cos(x) ** 2

    values = np.array([-3.0, -0.2, 0.1, 0.7, 20.0])
    found = inverse(tangent, values, -np.pi / 2, np.pi / 2, 1.0)
    np.testing.assert_allclose(found.x, np.arctan(values), rtol=1e-14)
    assert asked < 20  # halving takes 52


def test_pieces_of_a_curve_join_exactly() -> None:
    grid = Grid(np.array([0.0, 0.7, 1.0, 3.0]))
    values = np.sin(5 * grid.times)
    values[1:, 0] = values[:-1, -1]
    curve = grid.curve(values)
    np.testing.assert_array_equal(curve.c[0], values[:, 0])
    np.testing.assert_array_equal(curve.c[-1], values[:, -1])
