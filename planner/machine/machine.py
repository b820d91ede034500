"""The emulated machine as a set of named effects, each on or off, each with an optional spread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from planner.errors import InputError
from planner.machine.presets import PRESETS
from planner.schema import MachineTable, nearest, parse
from planner.schema.effect import Spread
from planner.schema.machine import EFFECTS

DEFAULT_STEP_S = 0.001


@dataclass(frozen=True)
class Quantity:
    """An effect that is on.

    Attributes:
        value: Mean: one number for all, or one for each motor, joint or gear constant.
        spread: Standard deviation from machine to machine, likewise.
    """

    value: tuple[float, ...]
    spread: tuple[float, ...] = (0.0,)

    @property
    def varies(self) -> bool:
        """Whether samples differ in it."""
        return any(s > 0 for s in self.spread)

    def to_setting(self) -> Any:
        """The number, list or table of a problem file that gives it back."""
        value, spread = _plain(self.value), _plain(self.spread)
        return {"value": value, "spread": spread} if self.varies else value


@dataclass(frozen=True, repr=False)
class Machine:
    """What stands between a plan and the motion that it makes; immutable.

    Build it with `Machine.prototype()`, `Machine.ideal()` or `Machine.from_table`. The effects,
    with units and meaning, are the keys of the `[machine]` table (`planner.schema.MachineTable`).

    Attributes:
        preset: What it started from.
        step_s: Largest simulation step, seconds.
        effects: The effects that are on, by name; those missing are off.
        fidelity: "quasi-static", or "dynamic" with inertia and torque (of a manipulator; other
            systems have nothing between motor and motion, and are the same in both).
    """

    preset: str
    step_s: float
    effects: Mapping[str, Quantity]
    fidelity: str = "quasi-static"

    @classmethod
    def prototype(cls, **changes: Any) -> Machine:
        """The paper's prototype, with changes: `Machine.prototype(backlash_deg=0.5)`.

        Calibrated, not measured: see `planner.machine.presets`.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return cls._of({**changes, "preset": "prototype"})

    @classmethod
    def ideal(cls, **changes: Any) -> Machine:
        """A machine with every effect off, with changes.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return cls._of({**changes, "preset": "ideal"})

    @classmethod
    def from_table(cls, table: MachineTable | Mapping[str, Any]) -> Machine:
        """The machine that a `[machine]` table describes.

        Raises:
            InputError: If the table is a plain mapping with an unknown key or impossible value.
        """
        if isinstance(table, MachineTable):
            return cls._merged(table)
        return cls._of(table)

    @classmethod
    def _of(cls, data: Mapping[str, Any]) -> Machine:
        plain = {key: _listed(value) for key, value in data.items()}
        return cls._merged(parse(MachineTable, plain, "machine"))

    @classmethod
    def _merged(cls, table: MachineTable) -> Machine:
        base = parse(MachineTable, dict(PRESETS[table.preset]), f"preset {table.preset}")
        effects = {}
        for name in EFFECTS:
            own = getattr(table, name)
            setting = getattr(base, name) if own is None else own
            if setting is not None and setting is not False:
                effects[name] = _quantity(setting)
        step = table.step_s or base.step_s or DEFAULT_STEP_S
        fidelity = table.fidelity or base.fidelity or "quasi-static"
        return cls(table.preset, step, MappingProxyType(effects), fidelity)

    # -- variations ----------------------------------------------------------------------------

    def with_(self, **changes: Any) -> Machine:
        """The same machine with some effects set; `False` switches one off.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return Machine._of({**self.to_dict(), **changes})

    def without(self, *names: str) -> Machine:
        """The same machine with these effects off.

        Raises:
            InputError: If a name is unknown.
        """
        return self.with_(**dict.fromkeys(_known(names), False))

    def only(self, *names: str) -> Machine:
        """The same machine with every other effect off.

        Raises:
            InputError: If a name is unknown.
        """
        kept = set(_known(names))
        return self.without(*(name for name in EFFECTS if name not in kept))

    def nominal(self) -> Machine:
        """The same machine with every spread zero, so that all samples are alike."""
        return self.with_(**{name: _plain(q.value) for name, q in self.effects.items()})

    # -- looking -------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The complete `[machine]` table: every effect, so that a later preset changes nothing."""
        settings = {
            name: self.effects[name].to_setting() if name in self.effects else False
            for name in EFFECTS
        }
        return {
            "preset": self.preset,
            "step_s": self.step_s,
            "fidelity": self.fidelity,
            **settings,
        }

    def __repr__(self) -> str:
        base = Machine._of({"preset": self.preset}).to_dict()
        changes = [f"{k}={v!r}" for k, v in self.to_dict().items() if v != base[k]]
        return f"Machine.{self.preset}({', '.join(changes)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Machine) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(repr(self.to_dict()))

    def __reduce__(self) -> tuple[Any, ...]:
        return Machine.from_table, (self.to_dict(),)


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if name not in EFFECTS:
            raise InputError(f"the machine has no effect '{name}'; {nearest(name, list(EFFECTS))}")
    return names


def _quantity(setting: Any) -> Quantity:
    if isinstance(setting, Spread):
        return Quantity(_tuple(setting.value), _tuple(setting.spread))
    return Quantity(_tuple(setting))


def _tuple(numbers: float | list[float]) -> tuple[float, ...]:
    return tuple(numbers) if isinstance(numbers, list) else (numbers,)


def _plain(numbers: tuple[float, ...]) -> float | list[float]:
    return numbers[0] if len(numbers) == 1 else list(numbers)


def _listed(value: Any) -> Any:
    """Tuples and NumPy values as the lists and numbers that a file would hold."""
    if isinstance(value, Mapping):
        return {key: _listed(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_listed(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value
