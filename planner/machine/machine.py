"""The emulated machine: a set of named effects, each on or off, with an optional random spread.

`draw` takes single machines from a machine with spreads, reproducibly. Every effect has its own
random stream, keyed by the seed and the effect's name; sample k is the k-th entry of each stream.
So the same seed gives every plan the same machines, sample k does not depend on the number of
samples, and switching one effect off does not change the draws of the others: comparisons are
paired.

There are two presets: `IDEAL`, with every effect off, and `PROTOTYPE`, the paper's arm. The paper
gives no data sheet. The prototype is **calibrated, not measured**: its parameters are the most
probable ones within the usual ranges of such parts, given that the largest error of θ₃ was
5 degrees (Fig. 9), that of θ₂ no larger (eq. 29), and that the motors followed their commands
precisely (Fig. 10). `planner calibrate` computes the numbers again and reports which of them the
paper does not determine; results/calibration has the ranges, their sources and the figures.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError, expect, factory
from planner.problem.tables.machine_effects import (
    EFFECTS,
    MachineTable,
    Spread,
    Worth,
    start_mismatch,
)
from planner.support.arrays import Array, Frozen, locked, plain
from planner.support.files import read_toml
from planner.support.user_tables import allowed_hint, parse

DEFAULT_STEP_S = 0.001


@dataclass(frozen=True)
class Quantity:
    """Mean and spread of one effect of a machine.

    Attributes:
        value: Mean: one number for all, or one for each motor, joint or gear constant.
        spread: Standard deviation between machines, in the same form.
    """

    value: tuple[float, ...]
    spread: tuple[float, ...] = (0.0,)

    @property
    def varies(self) -> bool:
        """Whether the effect differs between samples."""
        return any(s > 0 for s in self.spread)

    def to_setting(self) -> Any:
        """Return the number, list or table that states this quantity in a problem file."""
        value, spread = _as_plain(self.value), _as_plain(self.spread)
        return {"value": value, "spread": spread} if self.varies else value


@factory("planner.Machine.prototype(), .ideal() or .from_table({...})")
@dataclass(frozen=True, repr=False)
class Machine(Frozen):
    """The emulated machine: everything between a plan's inputs and the real motion; immutable.

    Build it with `Machine.prototype()`, `Machine.ideal()` or `Machine.from_table`. The effects,
    with units and meaning, are the keys of the `[machine]` table
    (`planner.problem.tables.machine_effects.MachineTable`).

    Attributes:
        preset: Name of the preset that the machine was made from.
        step_s: Largest simulation step, seconds.
        effects: The effects that are on, by name; all others are off.
        fidelity: "quasi-static", or "dynamic" with inertia and torque. The fidelity matters for
            manipulators only; other systems have no mechanism between motor and motion.
        start_state: How the arm came to rest before the start: one word, or a word or share −1 … 1
            for each joint, before them perhaps one for the gearhead of motor 1.
        worth: How far plans for the machine can be believed, if it was identified; else None.
        source: File that the machine was read from, for messages and commands only.
    """

    preset: str
    step_s: float
    effects: Mapping[str, Quantity]
    fidelity: str = "quasi-static"
    start_state: tuple[str | float, ...] = ("unwound",)
    worth: Worth | None = None
    source: str = ""

    @classmethod
    def prototype(cls, **changes: Any) -> Machine:
        """Return the emulated prototype of the paper with the given settings changed, as in
        `Machine.prototype(backlash_deg=0.5)`.

        Its parameters are calibrated, not measured: see `planner.machine.machine`.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return cls.from_table({**changes, "preset": "prototype"})

    @classmethod
    def ideal(cls, **changes: Any) -> Machine:
        """Return a machine with all effects off, except for the given changes.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return cls.from_table({**changes, "preset": "ideal"})

    @classmethod
    def from_table(cls, table: MachineTable | Mapping[str, Any]) -> Machine:
        """Return the machine that a `[machine]` table describes.

        Raises:
            InputError: If the table is a plain mapping with an unknown key or impossible value.
        """
        if not isinstance(table, MachineTable):
            table = parse(MachineTable, plain(table), "machine")
        base = parse(MachineTable, dict(PRESETS[table.preset]), f"preset {table.preset}")
        effects = {}
        for name in EFFECTS:
            override = getattr(table, name)
            setting = getattr(base, name) if override is None else override
            if setting is not None and setting is not False:
                is_spread = isinstance(setting, Spread)
                value, spread = (setting.value, setting.spread) if is_spread else (setting, 0.0)
                effects[name] = Quantity(_as_tuple(value), _as_tuple(spread))
        step = table.step_s or base.step_s or DEFAULT_STEP_S
        fidelity = table.fidelity or base.fidelity or "quasi-static"
        state = table.start_state or base.start_state or "unwound"
        given = [state] if isinstance(state, str) else state
        states = tuple(each if isinstance(each, str) else each + 0.0 for each in given)  # no -0.0
        if len(states) == 1 and not isinstance(states[0], str):
            raise InputError("machine.start_state: one entry for all joints must be a word")
        return cls(table.preset, step, effects, fidelity, states, table.worth)

    # -- variations ----------------------------------------------------------------------------

    def with_(self, **changes: Any) -> Machine:
        """Return a copy of the machine with changed settings; `False` switches an effect off.

        Raises:
            InputError: If a name is unknown or a value impossible.
        """
        return Machine.from_table({**self.to_dict(), **changes})

    def without(self, *names: str) -> Machine:
        """Return a copy of the machine with the named effects off.

        Raises:
            InputError: If a name is unknown.
        """
        return self.with_(**dict.fromkeys(_check_names(names), False))

    def only(self, *names: str) -> Machine:
        """Return a copy of the machine that keeps the named effects and has all others off.

        Raises:
            InputError: If a name is unknown.
        """
        names_off = set(_check_names(names))
        return self.without(*(name for name in EFFECTS if name not in names_off))

    def nominal(self) -> Machine:
        """Return a copy of the machine with all spreads zero, so that all samples are equal.

        An unknown start state becomes "unwound", the middle of the possible states.
        """
        if "unknown" not in self.start_state and not any(q.varies for q in self.effects.values()):
            return self
        states = ["unwound" if word == "unknown" else word for word in self.start_state]
        means = {name: _as_plain(q.value) for name, q in self.effects.items()}
        return self.with_(start_state=states, **means)

    def mean(self, name: str, joints: int | None = None) -> Array:
        """Return the mean of an effect: one number, or one per motor or joint. The mean of an
        effect that is off is its off value.

        Args:
            name: The effect.
            joints: Number of coordinates after the first; a preset's list is then cut or extended
                to that number, see `fit_to_joints`.
        """
        value = self.effects[name].value if name in self.effects else (EFFECTS[name].off_value,)
        return np.array(value if joints is None else fit_to_joints(name, value, joints))

    def spread(self, name: str, joints: int) -> Array:
        """Return the standard deviation of an effect between machines, in the form of `mean`; an
        effect that is off has 0."""
        spread = self.effects[name].spread if name in self.effects else (0.0,)
        return np.array(fit_to_joints(name, spread, joints))

    # -- description ---------------------------------------------------------------------------

    @property
    def origin(self) -> str:
        """The file or preset that the machine comes from, in words."""
        return f"from {self.source}" if self.source else self.preset

    @property
    def start_words(self) -> str:
        """Phrase that says how the arm came to rest before the start."""
        texts = [each if isinstance(each, str) else f"{each:.3g}" for each in self.start_state]
        return f"{', '.join(texts)} at the start"

    def to_dict(self) -> dict[str, Any]:
        """Return the machine's `[machine]` table with every effect in it, so that the table does
        not depend on presets."""
        on = self.effects
        settings = {name: on[name].to_setting() if name in on else False for name in EFFECTS}
        first = self.start_state[0]
        return {
            "preset": self.preset,
            "step_s": self.step_s,
            "fidelity": self.fidelity,
            "start_state": first if len(self.start_state) == 1 else list(self.start_state),
            **({"worth": self.worth.model_dump(exclude_none=True)} if self.worth else {}),
            **settings,
        }

    def __repr__(self) -> str:
        base = Machine.from_table({"preset": self.preset}).to_dict()
        changes = [f"{k}={v!r}" for k, v in self.to_dict().items() if v != base[k]]
        return f"Machine.{self.preset}({', '.join(changes)})"

    def __str__(self) -> str:
        """Return the effects that are on, one per line: mean, standard deviation, unit."""
        rows = [f"{self.preset} machine, {self.fidelity}"]
        for name, quantity in self.effects.items():
            mean = ", ".join(f"{number:.4g}" for number in quantity.value)
            spread = ", ".join(f"{number:.4g}" for number in quantity.spread)
            varies = f" ± {spread}" if quantity.varies else ""
            rows.append(f"  {name:26} {mean}{varies} {EFFECTS[name].unit}".rstrip())
        return "\n".join(rows if self.effects else [*rows, "  no effect is on"])

    def __getattr__(self, name: str) -> float | list[float]:
        """Return the mean of the effect `name` in its unit, as in `machine.backlash_deg`; the mean
        of an effect that is off is its off value."""
        if name in EFFECTS:
            return _as_plain(tuple(self.mean(name).tolist()))
        hint = allowed_hint(name, list(EFFECTS))
        raise AttributeError(f"a Machine has no '{name}'; effects: {hint}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Machine) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(repr(self.to_dict()))


def machine_for(table: MachineTable, given: Machine | str | None) -> Machine:
    """Return the machine that a caller asks for.

    Args:
        table: The problem's `[machine]` table.
        given: A machine, the name of a preset, or None for the machine of the table.

    Raises:
        InputError: If `given` is none of these.
    """
    if given is None:
        return Machine.from_table(table)
    if isinstance(given, str) and given in PRESETS:
        return Machine.from_table({"preset": given})
    expect(
        Machine,
        given,
        "planner.Machine.prototype(backlash_deg=0.5) makes a machine; you can also give the name"
        " of a preset:"
        f" {', '.join(PRESETS)}",
    )
    return cast("Machine", given)


def load_machine(path: str | Path) -> Machine:
    """Read a machine from the `[machine]` table of a file: a problem, or one that `planner
    identify` wrote.

    Raises:
        InputError: If the file cannot be read, has no such table, or a key or value is wrong.
    """
    table = read_toml(path, "a machine file").get("machine")
    if not isinstance(table, dict):
        raise InputError(f"{path} has no table [machine]")
    try:
        return replace(Machine.from_table(table), source=str(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if name not in EFFECTS:
            raise InputError(
                f"the machine has no effect '{name}'; {allowed_hint(name, list(EFFECTS))}"
            )
    return names


def _as_tuple(numbers: float | list[float]) -> tuple[float, ...]:
    return tuple(numbers) if isinstance(numbers, list) else (numbers,)


def _as_plain(numbers: tuple[float, ...]) -> float | list[float]:
    return numbers[0] if len(numbers) == 1 else list(numbers)


POSITIVE_FLOOR = 0.1
"""Least value that is drawn for an effect that must be positive, as a fraction of its mean."""


@dataclass(frozen=True, eq=False)
class Draws(Frozen):
    """Parameters of S single machines.

    Attributes:
        numbers: Sample numbers, shape (S,).
        values: For each effect that is on, its values (c, S), c being the number of motors (2),
            joints (N−1), passive joints (N−2) or 1.
        start: Position of the gears before the start within the range in which friction lets them
            rest, −1 … 1, for the gearhead of motor 1 and joints 1 … n, (1+n, S); NaN where the arm
            is unwound.
        seed: Seed of the samples' random numbers, here of the noise of their encoders.
        pose: True angles θ before the start, (N−1, S), where another run left the machines; None
            for those of the plan with their initial errors.
    """

    numbers: NDArray[np.int64]
    values: Mapping[str, Array]
    start: Array
    seed: int = 0
    pose: Array | None = None

    @property
    def count(self) -> int:
        """Number of samples S."""
        return len(self.numbers)

    def has_effect(self, name: str) -> bool:
        """Return whether the effect is on."""
        return name in self.values

    def __getitem__(self, name: str) -> Array:
        """Return the values (c, S) of an effect that is on, or the off value (1, 1) of one that is
        off."""
        if name in self.values:
            return self.values[name]
        return np.array([[EFFECTS[name].off_value]])

    def part(self, chosen: slice) -> Draws:
        """Return the parameters of the samples in the range `chosen`."""
        values = {name: value[:, chosen] for name, value in self.values.items()}
        pose = None if self.pose is None else self.pose[:, chosen]
        return Draws(self.numbers[chosen], values, self.start[:, chosen], self.seed, pose)

    def noise(self, t: float, joints: int) -> Array:
        """Return the noise of the encoders at a time t, s, in standard deviations, (N−1, S).

        It depends on seed, sample and time (to 1 µs) only: not on other samples or earlier
        readings.
        """
        from scipy.special import ndtri  # slow to import

        tick = round(1e6 * t)
        uniform = _uniform(
            "encoder_noise_deg", self.numbers, joints, self.seed, int(tick < 0), abs(tick)
        )
        return np.asarray(ndtri(np.maximum(uniform, np.finfo(float).tiny)))


MOST_MACHINES = 1_000_000
"""Largest number of machines in one replay, which then takes 15 minutes to hours and half a GB."""


def sample_numbers(samples: int | Sequence[int]) -> NDArray[np.int64]:
    """Return sample numbers, shape (S,): those of the first `samples` samples, or the list itself.

    Raises:
        InputError: If the number is not in 1 … `MOST_MACHINES`, or the list is not of numbers ≥ 0.
    """
    if isinstance(samples, int) and samples > MOST_MACHINES:
        raise InputError(f"samples = {samples}: at most {MOST_MACHINES} machines")
    numbers = np.arange(samples) if isinstance(samples, int | np.integer) else np.asarray(samples)
    whole = numbers.ndim == 1 and numbers.size > 0 and numbers.dtype.kind in "iu"
    if not whole or isinstance(samples, bool) or numbers.min() < 0:
        raise InputError(
            f"samples = {samples}: give a number of samples (at least 1), or a list of sample"
            " numbers from 0"
        )
    return numbers.astype(np.int64)


def draw(machine: Machine, joints: int, numbers: NDArray[np.int64], seed: int) -> Draws:
    """Draw the parameters of single machines from the distribution that a machine describes.

    Args:
        machine: The machine with its spreads.
        joints: Coordinates after the first, N−1 (n for the manipulator).
        numbers: Numbers of the samples, counted from 0, shape (S,).
        seed: Seed, ≥ 0.

    Returns:
        The parameters, in the units of the machine's table.

    Raises:
        InputError: If a list of the machine does not match the system's joints.
    """
    values = {}
    for name, quantity in machine.effects.items():
        count = EFFECTS[name].count(joints)
        if quantity.varies:
            uniform = _uniform(name, numbers, count, seed)
            values[name] = locked(at_quantiles(name, quantity, joints, uniform))
        else:  # one number for all samples, without a copy for each
            mean = locked(at_quantiles(name, quantity, joints, np.full((count, 1), 0.5)))
            values[name] = np.broadcast_to(mean, (count, len(numbers)))
    return Draws(numbers, values, draw_start(machine, joints, numbers, seed), seed)


_SHARES = {"unwound": np.nan, "forward": 1.0, "backward": -1.0}


def draw_start(machine: Machine, joints: int, numbers: NDArray[np.int64], seed: int) -> Array:
    """Return the gears' positions before the start, `Draws.start`; draw unknown ones uniformly.

    Raises:
        InputError: If the start state fits no arm of so many joints.
    """
    given = machine.start_state * (joints if len(machine.start_state) == 1 else 1)
    if wrong := start_mismatch(given, joints):
        raise InputError(wrong)
    rows = given if len(given) > joints else (given[min(1, joints - 1)], *given)
    told = [_SHARES.get(each, 0.0) if isinstance(each, str) else each for each in rows]
    position = locked(np.array(told)[:, None])
    if "unknown" not in rows:
        return np.broadcast_to(position, (len(rows), len(numbers)))
    unknown = np.array([word == "unknown" for word in rows])[:, None]
    drawn = 2 * _uniform("start_state", numbers, len(rows), seed) - 1
    return locked(np.where(unknown, drawn, position))


def _uniform(name: str, numbers: NDArray[np.int64], count: int, seed: int, *key: int) -> Array:
    """Return the random numbers (count, S), uniform in 0 … 1, of the samples `numbers` (S,) from
    the stream of an effect; `key` distinguishes several streams of one effect."""
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()), *key))
    # As in `numpy.random.default_rng`; each number advances it by one step.
    bits = np.random.PCG64(sequence)
    generator, passed, runs = np.random.Generator(bits), 0, []
    unique, place = np.unique(numbers, return_inverse=True)
    for run in np.split(unique, np.flatnonzero(np.diff(unique) > 1) + 1):
        bits.advance((int(run[0]) - passed) * count)
        runs.append(generator.random((len(run), count)))
        passed = int(run[-1]) + 1
    return np.concatenate(runs)[place].T


def at_quantiles(name: str, quantity: Quantity, joints: int, uniform: Array) -> Array:
    """Return the values of an effect at given quantiles.

    Args:
        name: The effect.
        quantity: Mean and spread of the effect.
        joints: Coordinates after the first, N−1.
        uniform: Quantiles, 0 … 1, shape (c, S), c being the number of values of that effect (see
            `Draws`).

    Returns:
        The values, (c, S); the mean where the spread is zero.

    Raises:
        InputError: If a list of the quantity does not match the system's joints.
    """
    effect = EFFECTS[name]
    both = [fit_to_joints(name, given, joints) for given in (quantity.value, quantity.spread)]
    for given in both:
        wrong = effect.mismatch(f"machine.{name}", given, joints)
        if wrong:
            raise InputError(wrong)
    mean, spread = (np.broadcast_to(np.array(given), len(uniform))[:, None] for given in both)
    if not quantity.varies:
        return np.repeat(mean, uniform.shape[1], axis=1)
    from scipy.special import ndtr, ndtri  # slow to import

    # Invert a truncated normal: one uniform number per value, so that streams stay aligned.
    low = np.maximum(effect.low, POSITIVE_FLOOR * mean) if effect.positive else effect.low
    sigma = np.where(spread > 0, spread, 1.0)
    least, most = ndtr((low - mean) / sigma), ndtr((effect.high - mean) / sigma)
    drawn = mean + sigma * ndtri(least + uniform * (most - least))
    return np.asarray(np.where(spread > 0, np.clip(drawn, low, effect.high), mean))


IDEAL: Mapping[str, Any] = MappingProxyType({"step_s": 0.001})
"""Preset with every effect off: commands are continuous and kinematics exact."""

PROTOTYPE: Mapping[str, Any] = MappingProxyType(
    read_toml(Path(__file__).with_name("prototype.toml"), "a machine file")["machine"]
)

_DRAWN = [setting for setting in PROTOTYPE.values() if isinstance(setting, Mapping)]
_PRESET_LISTS = {tuple(n) for each in _DRAWN for n in each.values() if isinstance(n, list)}


def fit_to_joints(name: str, numbers: Sequence[float], joints: int) -> Sequence[float]:
    """Return the values of an effect for an arm with `joints` joints.

    The prototype has three joints. For an arm with fewer or more, its lists are cut, or their last
    entry is repeated. Lists that a user gives are not changed.
    """
    count = EFFECTS[name].count(joints)
    if tuple(numbers) not in _PRESET_LISTS:
        return numbers
    return [*numbers, *[numbers[-1]] * count][:count]


PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {"prototype": PROTOTYPE, "ideal": IDEAL}
)
