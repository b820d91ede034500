"""The `[limits]` tables: what every kind's says, and the arms'."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from planner.schema.base import Table
from planner.systems.base import Array

Positive = Annotated[float, Field(gt=0)]


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


class ArmLimits(BaseLimits):
    """Limits every plan must keep at all times; each may be left out."""

    input_rad_s: PerInput = Field(
        None, description="Largest |u1|, |u2| in rad/s: one number for both, or two."
    )
    input_rate_rad_s2: PerInput = Field(
        None, description="Largest |du/dt| in rad/s^2: one number for both inputs, or two."
    )
    joint_deg: (
        Annotated[float, Field(gt=0, lt=90)] | list[Annotated[float, Field(gt=0, lt=90)]] | None
    ) = Field(None, description="Largest |theta| in degrees, below 90: one number, or one a joint.")

    def inputs(self) -> Array:
        """Largest |u|, shape (2,), rad/s."""
        return bound(self.input_rad_s, 2)

    def input_rates(self) -> Array:
        """Largest |du/dt|, shape (2,), rad/s²."""
        return bound(self.input_rate_rad_s2, 2)


class LimitsTable(ArmLimits):
    """Limits every plan must keep at all times; each may be left out."""

    z2_margin: Annotated[float, Field(ge=0)] | None = Field(
        None, description="Keep z2 at least this far from zero, on the side it starts on."
    )

    def least_z2(self) -> float | None:
        """Least |z₂| on the side of the start."""
        return self.z2_margin
