"""What the encoders tell: the coordinates, and how much faster than planned each joint is driven.

Two ideas. An angle is known to one step of its encoder, so the forecast is moved into the interval
that a reading leaves, and not further (F. C. Schweppe, *Recursive state estimation: unknown but
bounded errors and system inputs*, IEEE Transactions on Automatic Control 13, 1968): an angle in
motion is known better than its encoder's resolution. And a passive joint that is in contact moves
(1 + ε) times as far as forecast, ε being what gears and creep make of its ratio: a Kalman filter
(B. D. O. Anderson, J. B. Moore, *Optimal Filtering*, 1979, section 3.1) with the states angle and ε
finds it. A reading that does not fit says that the joint is in its play: ε is left as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.systems.base import Array, TriangularSystem

RATE_SPREAD = 0.01
"""Standard deviation expected of ε."""

CORRELATED = 2.0
"""By how much the variance of rounding is taken larger: slow joints stay in one step for long."""

UNMODELLED = float(np.deg2rad(0.003))
"""Standard deviation of what moves a joint besides, rad a period."""

EXACT = 1e-9
"""Standard deviation of a reading without resolution, in the coordinate's unit."""

FITTING = 3.0
"""Standard deviations within which a reading fits."""


class Estimate:
    """Coordinates of S samples.

    Args:
        system: The system.
        q: Coordinates expected at the start, (N, S).
        resolution: Smallest step of each reading, (N, 1), in the coordinates' units; 0 is exact,
            infinite is not measured.

    Attributes:
        q: The estimate, (N, S).
        rate_error: ε of the passive coordinates, (N−2, S).
    """

    def __init__(self, system: TriangularSystem, q: Array, resolution: Array) -> None:
        self.q = q
        shape = (system.size - 2, q.shape[1])
        self.rate_error = np.zeros(shape)
        self._half = resolution / 2
        self._noise = CORRELATED * resolution[2:] ** 2 / 12 + EXACT**2
        self._var_q = np.repeat(self._noise, q.shape[1], axis=1)
        self._cov, self._var_e = np.zeros(shape), np.full(shape, RATE_SPREAD**2)
        self._fitted = np.zeros(shape, dtype=bool)

    def predicted(self, q: Array) -> None:
        """Take over a forecast (N, S) that knows nothing of ε."""
        moved = q[2:] - self.q[2:]
        self.q = q.copy()
        self.q[2:] += self.rate_error * moved
        self._var_q = self._var_q + moved * (2 * self._cov + moved * self._var_e) + UNMODELLED**2
        self._cov = self._cov + moved * self._var_e

    def read(self, measured: Array) -> None:
        """Take in a reading (N, S), NaN where it is lost."""
        self._filter(measured[2:] - self.q[2:], np.isnan(measured[2:]))
        inside = np.clip(self.q, measured - self._half, measured + self._half)
        self.q = np.where(np.isnan(measured), self.q, inside)

    def _filter(self, surprise: Array, lost: NDArray[np.bool_]) -> None:
        """Correct angle and ε by the difference (N−2, S) between reading and forecast."""
        total = self._var_q + self._noise
        fits = np.abs(surprise) <= FITTING * np.sqrt(total)
        both = fits & self._fitted
        gain_q, gain_e = self._var_q / total, self._cov / total
        self.q[2:] += np.where(fits & ~lost, gain_q * surprise, 0.0)
        self.rate_error = self.rate_error + np.where(both, gain_e * surprise, 0.0)
        self._var_e = np.where(both, self._var_e - gain_e * self._cov, self._var_e)
        self._cov = np.where(both, self._cov * (1 - gain_q), np.where(lost, self._cov, 0.0))
        var_q = np.where(fits, self._var_q * (1 - gain_q), self._noise)
        self._var_q = np.where(lost, self._var_q, var_q)
        self._fitted = np.where(lost, self._fitted, fits)
