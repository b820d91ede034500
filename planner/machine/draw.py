"""From a machine with spreads to single machines, reproducibly.

Every effect has a random stream of its own, keyed by the seed and the effect's name, and sample k
is the k-th entry of each. So the same seed gives every plan the same machines, sample k is the same
whatever the number of samples, and switching one effect off leaves the draws of all others as they
were: comparisons are paired.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from planner.errors import InputError
from planner.machine.machine import Machine, Quantity
from planner.schema.effect import Effect
from planner.schema.machine import EFFECTS
from planner.systems.base import Array

POSITIVE_FLOOR = 0.1
"""What must be positive is drawn no lower than this part of its mean."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Some single machines.

    Attributes:
        numbers: Sample numbers, shape (S,).
        values: For each effect that is on, its values (c, S), c being the number of motors (2),
            joints (N−1), passive joints (N−2) or 1.
    """

    numbers: NDArray[np.int64]
    values: Mapping[str, Array]

    @property
    def count(self) -> int:
        """Number of samples S."""
        return len(self.numbers)

    def on(self, name: str) -> bool:
        """Whether the effect is on."""
        return name in self.values

    def __getitem__(self, name: str) -> Array:
        """Values (c, S) of an effect that is on; its neutral value, (1, 1), when it is off."""
        if name in self.values:
            return self.values[name]
        return np.array([[EFFECTS[name].off]])

    def part(self, chosen: slice) -> Draws:
        """A run of the samples."""
        values = {name: value[:, chosen] for name, value in self.values.items()}
        return Draws(self.numbers[chosen], values)


def draw(machine: Machine, joints: int, numbers: NDArray[np.int64], seed: int) -> Draws:
    """Draw single machines.

    Args:
        machine: The distribution.
        joints: Coordinates after the first, N−1 (n for the manipulator).
        numbers: Which samples, shape (S,), counted from 0.
        seed: Seed, ≥ 0.

    Returns:
        Their parameters, in the units of the machine's table.

    Raises:
        InputError: If a list of the machine does not match the system's joints.
    """
    values = {
        name: _values(name, quantity, joints, numbers, seed)
        for name, quantity in machine.effects.items()
    }
    return Draws(numbers, values)


def _values(
    name: str, quantity: Quantity, joints: int, numbers: NDArray[np.int64], seed: int
) -> Array:
    count = EFFECTS[name].count(joints)
    if not quantity.varies:
        return at_quantiles(name, quantity, joints, np.full((count, len(numbers)), 0.5))
    stream = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_key(name),)))
    uniform = stream.random((int(numbers.max()) + 1, count))[numbers].T
    return at_quantiles(name, quantity, joints, uniform)


def at_quantiles(name: str, quantity: Quantity, joints: int, uniform: Array) -> Array:
    """Values of an effect at places in its distribution.

    Args:
        name: The effect.
        quantity: Its mean and spread.
        joints: Coordinates after the first, N−1.
        uniform: Shares of the distribution that lie below, 0 … 1, shape (c, S), c being the number
            of values of that effect (see `Draws`).

    Returns:
        The values, (c, S); the mean where nothing spreads.

    Raises:
        InputError: If a list of the quantity does not match the system's joints.
    """
    effect = EFFECTS[name]
    for given in (quantity.value, quantity.spread):
        wrong = effect.mismatch(f"machine.{name}", given, joints)
        if wrong:
            raise InputError(wrong)
    mean = np.broadcast_to(np.array(quantity.value), len(uniform))
    spread = np.broadcast_to(np.array(quantity.spread), len(uniform))
    return _truncated_normal(uniform, mean[:, None], spread[:, None], effect)


def _key(name: str) -> int:
    return zlib.crc32(name.encode())


def _truncated_normal(uniform: Array, mean: Array, spread: Array, effect: Effect) -> Array:
    """By the inverse distribution: one uniform number a value, so that streams stay aligned."""
    low = np.maximum(effect.low, POSITIVE_FLOOR * mean) if effect.positive else effect.low
    sigma = np.where(spread > 0, spread, 1.0)
    least, most = ndtr((low - mean) / sigma), ndtr((effect.high - mean) / sigma)
    drawn = mean + sigma * ndtri(least + uniform * (most - least))
    return np.asarray(np.where(spread > 0, np.clip(drawn, low, effect.high), mean))
