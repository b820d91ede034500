"""The proof between the nodes, against dense sampling; both ways."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from planner.methods.convex.band import Band, cap_excess, floor_excess

K = np.array([0.87, 0.71])
BAND = Band(sign=1.0, floor=0.05, cap_factor=1.0, K=K)


def pieces(seed: int, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random p near the cap, decreasing z₃, and the samples of both."""
    rng = np.random.default_rng([seed, degree])
    count = 9
    z3 = np.sort(rng.uniform(0.3, 0.7, count * (degree + 1) + 1))[::-1]
    z3 = np.stack([z3[k :: degree + 1][:count] for k in range(degree + 2)])
    p = BAND.cap(z3[: degree + 1]) * rng.uniform(0.9, 1.06, (degree + 1, count))
    return p, z3, np.linspace(0, 1, 2001)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_proven_excess_bounds_every_sample_closely(seed: int, degree: int) -> None:
    p, z3, tau = pieces(seed, degree)
    breaks = np.arange(10.0)
    at = (breaks[:-1, None] + np.minimum(tau, 1 - 1e-12)).ravel()
    excess = BPoly(p, breaks)(at) - BAND.cap(BPoly(z3, breaks)(at))
    found = cap_excess(BAND, p, z3, 1e-9, proof=False)
    assert found.proven >= excess.max() - 1e-15
    worst = excess.reshape(9, -1).max(axis=1)
    assert set(found.piece) >= set(np.flatnonzero(worst > 0.05 * max(worst.max(), 0)))
    if worst.max() > 0:
        k = int(np.argmax(found.value))
        assert found.value[k] >= 0.97 * worst.max()
        place = found.piece[k] + found.local[k]
        own = BPoly(p, breaks)(place) - BAND.cap(BPoly(z3, breaks)(place))
        if 0 < found.local[k] < 1:
            assert own == pytest.approx(found.value[k], abs=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_path_inside_by_a_hair_is_proven_inside(degree: int) -> None:
    p, z3, tau = pieces(1, degree)
    breaks = np.arange(10.0)
    at = (breaks[:-1, None] + np.minimum(tau, 1 - 1e-12)).ravel()
    excess = BPoly(p, breaks)(at) - BAND.cap(BPoly(z3, breaks)(at))
    shift = excess.max() + 1e-6  # sampling at 2000 points a piece misses less than this
    assert cap_excess(BAND, p - shift, z3, 1e-9, proof=True).proven <= 0
    assert cap_excess(BAND, p - shift + 1e-5, z3, 1e-9, proof=True).proven > 0


def test_floor_is_found_between_the_ends_of_a_piece() -> None:
    """0.06 at both ends, 0.04 in the middle: only the middle is below 0.05."""
    z2 = np.array([[0.06], [0.02], [0.06]])
    found = floor_excess(BAND, z2, 1e-12, proof=False)
    assert found.piece.tolist() == [0]
    assert found.local[0] == pytest.approx(0.5, abs=0.1)
    assert found.proven == pytest.approx(0.01, rel=0.05)
    assert floor_excess(BAND, z2 + 0.0101, 1e-12, proof=True).proven <= 0


def test_beyond_the_domain_of_z3_nothing_is_proven_inside() -> None:
    p = np.full((2, 1), 0.01)
    z3 = np.array([[0.70], [0.71], [0.73]])  # ends above K₃, where no angle exists
    assert cap_excess(BAND, p, z3, 1e-9, proof=True).proven > 0.009


def test_cap_is_concave_and_tangents_lie_above() -> None:
    z3 = np.linspace(1e-6, K[1] * (1 - 1e-9), 4001)
    cap = BAND.cap(z3)
    assert np.all(np.diff(cap, 2) <= 1e-15)
    assert cap.max() == pytest.approx(BAND.top, rel=1e-6)
    for at in np.linspace(0.01, 0.709, 40):
        slope, offset = BAND.tangent(np.array([at]))
        assert np.all(slope * z3 + offset >= cap - 1e-13)
        assert slope * at + offset == pytest.approx(BAND.cap(np.array([at])))
