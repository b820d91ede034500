"""What the encoders tell of the true coordinates: an angle is known to one step of its encoder.

The forecast is moved into the interval that a reading leaves, and not further (F. C. Schweppe,
*Recursive state estimation: unknown but bounded errors and system inputs*, IEEE Transactions on
Automatic Control 13, 1968). So angles in motion are known better than their encoders' resolution.
"""

from __future__ import annotations

import numpy as np

from planner.systems.base import Array, TriangularSystem


class Estimate:
    """Coordinates of S samples.

    Args:
        system: The system.
        q: Coordinates expected at the start, (N, S).
        resolution: Smallest step of each reading, (N, 1), in the coordinates' units; 0 is exact,
            infinite is not measured.

    Attributes:
        q: The estimate, (N, S).
        rate_error: Relative errors of the passive coordinates' rates, (N−2, S).
    """

    def __init__(self, system: TriangularSystem, q: Array, resolution: Array) -> None:
        self.q = q
        self.rate_error = np.zeros((system.size - 2, q.shape[1]))
        self._half = resolution / 2

    def predicted(self, q: Array) -> None:
        """Take over a forecast, (N, S)."""
        self.q = q

    def read(self, measured: Array) -> None:
        """Take in a reading (N, S); NaN where it is lost."""
        moved = np.clip(self.q, measured - self._half, measured + self._half)
        self.q = np.where(np.isnan(measured), self.q, moved)
