"""Places a motion must pass through, and discs that the links of an arm must clear."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place on the way.

    Attributes:
        number: From 1, in the order of the problem file.
        q: Coordinates, shape (N,), NaN where free.
        time_s: When, in seconds; None at any time.
    """

    number: int
    q: Array
    time_s: float | None

    @property
    def label(self) -> str:
        """What is demanded, for messages."""
        return f"distance from waypoint {self.number}"

    def distance(self, q: Array) -> Array:
        """Largest difference of a coordinate that it fixes, shape (…,), at q (…, N)."""
        return np.asarray(np.nanmax(np.abs(q - self.q), axis=-1))


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A disc.

    Attributes:
        number: From 1, in the order of the problem file.
        centre: Shape (2,), metres.
        radius: Metres.
    """

    number: int
    centre: Array
    radius: float

    def label(self, link: int) -> str:
        """What is demanded of a link (from 1), for messages."""
        return f"clearance of link {link} from obstacle {self.number}"

    def clearances(self, points: Array) -> Array:
        """Distance of each link from the disc, negative inside, shape (…, L).

        Args:
            points: The links' ends one after the other, shape (…, L+1, 2), metres.
        """
        start, step = points[..., :-1, :], np.diff(points, axis=-2)
        length = np.sum(step**2, axis=-1)
        along = np.sum((self.centre - start) * step, axis=-1)
        share = np.clip(along / np.where(length > 0, length, 1.0), 0.0, 1.0)
        nearest = start + share[..., None] * step
        return np.asarray(np.linalg.norm(nearest - self.centre, axis=-1) - self.radius)
