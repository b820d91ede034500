"""What a setting of the `[machine]` table may be: its unit, range, and who has one of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from planner.schema.base import Table, nearest

Per = Literal["machine", "motor", "joint", "passive"]
Numbers = float | list[float]


class Spread(Table):
    """A setting that differs from machine to machine."""

    value: Numbers = Field(description="Mean: one number, or one a motor or joint.")
    spread: Numbers = Field(
        0.0, description="Standard deviation in the same unit (normal, truncated to the range)."
    )


Setting = float | list[float] | Spread | Literal[False]


@dataclass(frozen=True)
class Effect:
    """What one effect of the machine is measured in, and which values it may have.

    As an annotation of a field it validates that field, with one message for each mistake.

    Attributes:
        unit: Unit of value and spread; "" for plain numbers.
        per: What has a value of its own: the machine, each of 2 motors, each of n joints, or each
            of the n−1 passive ones, 2 … n, which the disk chain drives.
        off: The value that means "no such effect".
        low: Least value; not allowed itself when `positive`.
        high: Greatest value.
        positive: Whether zero is impossible.
        spreads: Whether it may differ from machine to machine.
        dynamic: Whether it acts in dynamic fidelity alone.
    """

    unit: str
    per: Per
    off: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    positive: bool = False
    spreads: bool = True
    dynamic: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda value, _: self.checked(value), handler(source)
        )

    def checked(self, setting: Any) -> Any:
        """The setting in its plain form; raises ValueError with one line when it cannot be."""
        if setting is None or setting is False:
            return setting
        if isinstance(setting, Spread):
            setting = setting.model_dump()
        if isinstance(setting, Mapping):
            return self._table(setting)
        numbers = self._numbers(setting)
        self._in_range(numbers)
        return numbers

    def _table(self, table: Mapping[str, Any]) -> Spread:
        for key in table:
            if key not in ("value", "spread"):
                raise ValueError(f"unknown key '{key}'; {nearest(str(key), ['value', 'spread'])}")
        if "value" not in table:
            raise ValueError("needs a value beside its spread: { value = ..., spread = ... }")
        value = self._numbers(table["value"])
        self._in_range(value)
        spread = self._numbers(table.get("spread", 0.0))
        if min(_flat(spread)) < 0:
            raise ValueError("spread is a standard deviation and must be >= 0")
        if max(_flat(spread)) > 0 and not self.spreads:
            raise ValueError("is the same for every sample; it cannot have a spread")
        return Spread(value=value, spread=spread)

    def _numbers(self, value: Any) -> Numbers:
        if _is_number(value):
            return _finite(value)
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise ValueError(
                "must be a number, a list of numbers, { value = ..., spread = ... },"
                " or false to switch it off"
            )
        if self.per == "machine":
            raise ValueError("is one number for the whole machine, not a list")
        if not value or not all(_is_number(v) for v in value):
            raise ValueError(f"must hold numbers, one for each of {self.every}")
        if self.per == "motor" and len(value) != 2:
            raise ValueError(f"has {len(value)} values; give one, or one for each of 2 motors")
        return [_finite(v) for v in value]

    def count(self, joints: int) -> int:
        """How many values it can have on a system of so many joints."""
        return {"machine": 1, "motor": 2, "joint": joints, "passive": joints - 1}[self.per]

    def mismatch(self, key: str, numbers: Sequence[float], joints: int) -> str | None:
        """What is wrong with so many numbers on a system of so many joints, or None."""
        count = self.count(joints)
        if len(numbers) in (1, count):
            return None
        return f"{key} has {len(numbers)} values, but needs one, or {count} for {self.every}"

    @property
    def every(self) -> str:
        """What a list has one number for, in words."""
        return _EVERY[self.per]

    def _in_range(self, numbers: Numbers) -> None:
        unit = f" {self.unit}" if self.unit else ""
        for number in _flat(numbers):
            if self.positive and number <= self.low:
                raise ValueError(f"must be > {self.low:g}{unit}; false switches it off")
            if number < self.low:
                raise ValueError(f"must be >= {self.low:g}{unit}")
            if number > self.high:
                raise ValueError(f"must be <= {self.high:g}{unit}")


_EVERY = {
    "machine": "the machine",
    "motor": "2 motors",
    "joint": "joints 1 ... n",
    "passive": "joints 2 ... n",
}


def _flat(numbers: Numbers) -> list[float]:
    return numbers if isinstance(numbers, list) else [numbers]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _finite(value: Any) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number; false switches an effect off")
    return float(value)
