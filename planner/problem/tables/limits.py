"""The `[limits]` tables: what every kind's says; those of arms are in `arms`, and so on."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from planner.support.arrays import Array
from planner.support.user_tables import Positive, Table


def _two(value: float | list[float] | None) -> float | list[float] | None:
    if isinstance(value, list) and len(value) != 2:
        raise ValueError(f"has {len(value)} values; give one, or one for each of the 2 inputs")
    return value


PerInput = Annotated[Positive | list[Positive] | None, AfterValidator(_two)]


def bound(value: float | Sequence[float] | None, size: int) -> Array:
    """Limits as an array (size,); infinite where there is none."""
    return np.broadcast_to(np.asarray(np.inf if value is None else value, dtype=float), size)


def bound_deg(value: float | Sequence[float] | None, size: int) -> Array:
    """Limits given in degrees as an array (size,) in radians; infinite where there is none."""
    return np.deg2rad(bound(value, size))


class BaseLimits(Table):
    """What every kind's limits answer."""

    @abstractmethod
    def inputs(self) -> Array:
        """Largest |u|, shape (2,), in the inputs' units; infinite where there is none."""

    @abstractmethod
    def input_rates(self) -> Array:
        """Largest |du/dt|, shape (2,); infinite where there is none."""

    def least_z2(self) -> float | None:
        """Least |z₂| on the side of the start; None when z₂ is free."""
        return None
