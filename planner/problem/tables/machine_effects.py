"""The `[machine]` table: the preset of the emulated machine and changes to it.

`Effect` describes a key of the table: its unit, its range, and how many values it can have.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from planner.support.user_tables import Table, allowed_hint

Owner = Literal["machine", "motor", "joint", "passive"]
Numbers = float | list[float]


class Spread(Table):
    """A setting that differs from machine to machine."""

    value: Numbers
    """Mean: one number, or one per motor or joint."""
    spread: Numbers = 0.0
    """Standard deviation in the same unit (normal, truncated to the range)."""


Setting = float | list[float] | Spread | Literal[False] | None


@dataclass(frozen=True)
class Effect:
    """Unit and range of one effect of the machine.

    Used as an annotation of a field, it validates the field and reports each mistake.

    Attributes:
        unit: Unit of value and spread; "" for plain numbers.
        owner: What has its own value: the machine, each of 2 motors, each of n joints, or each of
            the n−1 passive joints 2 … n, which the disk chain drives.
        off_value: The value that switches the effect off.
        low: Least value, by default 0; excluded itself if `positive`.
        high: Greatest value.
        positive: Whether `low` itself is excluded.
        may_spread: Whether the effect may differ from machine to machine.
        dynamic_only: Whether the effect acts only in dynamic fidelity.
    """

    unit: str
    owner: Owner
    off_value: float = 0.0
    low: float = 0.0
    high: float = math.inf
    positive: bool = False
    may_spread: bool = True
    dynamic_only: bool = False

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            lambda value, _: self.check_setting(value), handler(source)
        )

    def check_setting(self, setting: Any) -> Any:
        """Validate a setting and return its plain form; a ValueError says what is wrong."""
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
                raise ValueError(
                    f"unknown key '{key}'; {allowed_hint(str(key), ['value', 'spread'])}"
                )
        if "value" not in table:
            raise ValueError("needs a value beside its spread: { value = ..., spread = ... }")
        value = self._numbers(table["value"])
        self._in_range(value)
        spread = self._numbers(table.get("spread", 0.0))
        if min(_as_list(spread)) < 0:
            raise ValueError("spread is a standard deviation and must be >= 0")
        if max(_as_list(spread)) > 0 and not self.may_spread:
            raise ValueError("is the same for every sample; it cannot have a spread")
        return Spread(value=value, spread=spread)

    def _numbers(self, value: Any) -> Numbers:
        if _is_number(value):
            return _check_finite(value)
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise ValueError(
                "must be a number, a list of numbers, { value = ..., spread = ... },"
                " or false to switch it off"
            )
        if self.owner == "machine":
            raise ValueError("is one number for the whole machine, not a list")
        if not value or not all(_is_number(v) for v in value):
            raise ValueError(f"must hold numbers, one for each of {_OWNER_WORDS[self.owner]}")
        if self.owner == "motor" and len(value) != 2:
            raise ValueError(f"has {len(value)} values; give one, or one for each of 2 motors")
        return [_check_finite(v) for v in value]

    def count(self, joints: int) -> int:
        """Return the number of values of the effect on a system with `joints` joints."""
        return {"machine": 1, "motor": 2, "joint": joints, "passive": joints - 1}[self.owner]

    def mismatch(self, key: str, numbers: Sequence[float], joints: int) -> str | None:
        """Describe how the list `numbers` has the wrong length for `joints` joints; else None."""
        count = self.count(joints)
        if len(numbers) in (1, count):
            return None
        owners = _OWNER_WORDS[self.owner]
        return f"{key} has {len(numbers)} values, but needs one, or {count} for {owners}"

    def _in_range(self, numbers: Numbers) -> None:
        unit = f" {self.unit}" if self.unit else ""
        for number in _as_list(numbers):
            if self.positive and number <= self.low:
                raise ValueError(f"must be > {self.low:g}{unit}; false switches it off")
            if number < self.low:
                raise ValueError(f"must be >= {self.low:g}{unit}")
            if number > self.high:
                raise ValueError(f"must be <= {self.high:g}{unit}")


_unlimited = partial(Effect, off_value=math.inf, positive=True)
"""An effect that is off at infinity."""

_OWNER_WORDS = {
    "machine": "the machine",
    "motor": "2 motors",
    "joint": "joints 1 ... n",
    "passive": "joints 2 ... n",
}


def _as_list(numbers: Numbers) -> list[float]:
    return numbers if isinstance(numbers, list) else [numbers]


def effect_words(name: str) -> str:
    """Return the name of an effect in words, without the unit at the end of its key."""
    unit = r"(?<!_per)_(deg|nm|s|rad_s2?|nm_per_rad|nms_per_rad|kgm2)$"
    return re.sub(unit, "", name).replace("_nm", "_torque").replace("_", " ")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _check_finite(value: Any) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number; false switches an effect off")
    return float(value)


StartState = Literal["unwound", "forward", "backward", "unknown"]
"""Word for how an arm came to rest before a motion."""

StartShare = Annotated[float, Field(ge=-1, le=1)]
"""Place of an axis at rest within the range that its joint's friction allows, 1 as after a motion
forward."""


def start_mismatch(state: Sequence[str | float], joints: int) -> str | None:
    """Return what is wrong with the number of entries of a start state for `joints` joints."""
    if len(state) in (joints, joints + 1):
        return None
    return (
        f"machine.start_state has {len(state)} entries, but needs one word, or {joints} entries,"
        f" one per joint, or {joints + 1}, first that of motor 1's gearhead"
    )


class Worth(Table):
    """How far plans for an identified machine can be believed.

    Written by `planner identify`, from its prediction of a run that was kept out of the fit. Only a
    run in which every joint after the first reverses tests that.
    """

    tested: bool
    """Whether such a run was kept out."""
    improves: bool | None = None
    """Whether the machine predicts that run better than the preset does."""
    half_width_deg: Annotated[float, Field(ge=0)] | None = None
    """About three of four plans end within this angle of the predicted end, degrees; no confidence
    interval."""

    @property
    def words(self) -> str:
        """Phrase that says so."""
        if self.half_width_deg is None:
            return "an arm may end anywhere: its machine was not tested by a run that reverses"
        near = f"an arm mostly ends within {self.half_width_deg:.2g} deg of what is predicted"
        return near + " (the preset predicts it no worse)" * (self.improves is False)


class MachineTable(Table):
    """Overrides of a machine preset.

    Each effect is a number, a list (one per motor or joint), `{ value = …, spread = … }`, or false,
    which switches it off. Effects that are left out are as in the preset.
    """

    preset: Literal["prototype", "ideal"] = "prototype"
    """Preset to start from."""
    step_s: Annotated[float, Field(ge=1e-6, le=0.01)] | None = None
    """Largest simulation step in seconds."""
    fidelity: Literal["quasi-static", "dynamic"] | None = None
    """quasi-static: joint motion from the balance of torques, without inertia; dynamic: two masses
    per joint and motors with limited torque. Default: quasi-static."""

    start_state: (
        StartState | Annotated[list[StartState | StartShare], Field(min_length=1)] | None
    ) = None
    """State of the arm before the start. unwound: no torsion of shafts, backlash as in
    initial_play. forward, backward: as after a motion in that direction, with backlash taken up and
    shafts wound up as far as friction holds them. unknown: anywhere between. One word, or a list
    with one entry per joint (the gearhead of motor 1 is then in the state of joint 2), or with that
    gearhead's entry before them. An entry is a word or a number: 1 is forward, -1 backward, 0 the
    middle, as a share of each machine's own lost motion; a compensated plan has its last state as
    notes.end_state. Default: unwound."""

    worth: Worth | None = None
    """How far plans for this machine can be believed, if it was identified."""

    control_period_s: Annotated[
        Setting, Effect("s", "machine", low=1e-5, high=1, positive=True, may_spread=False)
    ] = None
    """Sample and hold: period in seconds at which the command is read."""
    delay_s: Annotated[Setting, Effect("s", "machine", high=1)] = None
    """Time from command to motor, seconds."""
    velocity_resolution_rad_s: Annotated[Setting, Effect("rad/s", "motor", may_spread=False)] = None
    """Smallest step of the velocity command, rad/s."""
    input_gain_error: Annotated[Setting, Effect("", "motor", low=-0.9)] = None
    """Motor runs at (1 + this) times its command (fraction)."""
    input_bias_rad_s: Annotated[Setting, Effect("rad/s", "motor", low=-math.inf)] = None
    """Added to each motor's speed while a plan runs, rad/s."""
    velocity_limit_rad_s: Annotated[Setting, _unlimited("rad/s", "motor")] = None
    """Largest motor speed, rad/s."""
    acceleration_limit_rad_s2: Annotated[Setting, _unlimited("rad/s^2", "motor")] = None
    """Largest motor acceleration, rad/s^2."""
    servo_bandwidth_rad_s: Annotated[Setting, _unlimited("rad/s", "motor")] = None
    """Velocity loop: corner frequency of a first-order lag, or natural frequency when servo_damping
    is given, rad/s."""
    servo_damping: Annotated[Setting, Effect("", "motor", off_value=math.nan, positive=True)] = None
    """Damping ratio of a second-order velocity loop; off: first order."""
    motor_inertia_kgm2: Annotated[Setting, Effect("kg m^2", "motor", dynamic_only=True)] = None
    """Inertia of each motor with its gearhead, at the gearhead's output, kg m^2 (dynamic)."""
    servo_gain_nms_per_rad: Annotated[
        Setting, _unlimited("N m s/rad", "motor", dynamic_only=True)
    ] = None
    """Velocity loop: torque for each rad/s of lag behind the drive's own reference, at the
    gearhead's output, N m s/rad (dynamic); off: rigid."""
    servo_integral_time_s: Annotated[Setting, _unlimited("s", "motor", dynamic_only=True)] = None
    """Velocity loop: integral time in seconds (dynamic); off: no integral action."""
    torque_limit_nm: Annotated[Setting, _unlimited("N m", "motor", dynamic_only=True)] = None
    """Largest torque of each motor at its gearhead's output, N m (dynamic)."""

    creep: Annotated[Setting, Effect("", "machine", high=1)] = None
    """Rate lost at each friction contact under no load (fraction)."""
    creep_per_nm: Annotated[Setting, Effect("1/(N m)", "machine")] = None
    """Rate lost at each contact for each N m it transmits (fraction per N m)."""
    lateral_friction: Annotated[Setting, Effect("", "machine", high=1)] = None
    """Friction of a contact sideways relative to that along its drive, 0 ... 1: a contact slides
    sideways when its joint turns, which loads the driver and loses rate under load; 1 for plain
    disks, less for rollers. Acts together with friction_capacity_nm."""
    friction_capacity_nm: Annotated[Setting, _unlimited("N m", "machine")] = None
    """Largest torque a contact transmits, mu N r of disk B, N m; if more is needed, the driven part
    stands still (gross slip)."""
    disk_inertia_kgm2: Annotated[Setting, Effect("kg m^2", "passive", dynamic_only=True)] = None
    """Inertia of the disks between two stages, about the axle of the first one's driving disk, kg
    m^2 (dynamic)."""
    gear_ratio_error: Annotated[Setting, Effect("", "passive", low=-0.9)] = None
    """Error of the gear constants K2 ... Kn (fraction)."""
    gearhead_backlash_deg: Annotated[Setting, Effect("deg", "motor", high=45)] = None
    """Total backlash of each motor's gearhead at its output, degrees."""
    backlash_deg: Annotated[Setting, Effect("deg", "passive", high=45)] = None
    """Total backlash of the bevel gears and belt of each of joints 2 ... n, at the joint,
    degrees."""
    initial_play: Annotated[Setting, Effect("", "passive", low=-1, high=1)] = None
    """Position in the backlash at the start, for each of joints 2 ... n: 0 in the middle, 1 in
    contact for motion in positive direction, -1 in negative direction."""
    axis_inertia_kgm2: Annotated[Setting, Effect("kg m^2", "passive", dynamic_only=True)] = None
    """Inertia of the gears and pulleys that drive joints 2 ... n, on the motor side of the
    backlash, at the joint, kg m^2 (dynamic)."""
    shaft_stiffness_nm_per_rad: Annotated[Setting, _unlimited("N m/rad", "passive")] = None
    """Torsional stiffness of the shaft into joints 2 ... n, N m/rad."""
    shaft_damping_nms_per_rad: Annotated[
        Setting, Effect("N m s/rad", "passive", dynamic_only=True)
    ] = None
    """Damping of the twist of those shafts, N m s/rad (dynamic)."""
    link_inertia_kgm2: Annotated[Setting, Effect("kg m^2", "joint", dynamic_only=True)] = None
    """Inertia of each link about its joint, with the mass of all that it carries at the next joint,
    kg m^2 (dynamic)."""
    link_length_m: Annotated[Setting, Effect("m", "joint", dynamic_only=True)] = None
    """Distance of each joint from the next, metres (dynamic): with link_moment_kgm it couples the
    motions of the links; 0: each link reacts only with its link_inertia_kgm2."""
    base_friction_nm: Annotated[Setting, Effect("N m", "machine", dynamic_only=True)] = None
    """Coulomb friction of joint 1, N m (dynamic)."""
    coulomb_friction_nm: Annotated[Setting, Effect("N m", "passive")] = None
    """Coulomb friction of joints 2 ... n, N m; it loads the contacts and twists a soft shaft."""
    viscous_friction_nms_per_rad: Annotated[Setting, Effect("N m s/rad", "passive")] = None
    """Viscous friction of joints 2 ... n, N m s/rad; it also loads the contacts and twists a soft
    shaft."""
    incline_deg: Annotated[Setting, Effect("deg", "machine", high=90)] = None
    """Slope of the plane in which the arm moves, degrees: gravity pulls the links towards -y of the
    base; 0 is level."""
    link_moment_kgm: Annotated[Setting, Effect("kg m", "joint")] = None
    """Mass of each link, with all that it carries, times the distance of its centre of mass from
    its joint, kg m: what gravity acts on when the plane is inclined, and the links' reaction where
    they have a link_length_m."""
    initial_angle_error_deg: Annotated[Setting, Effect("deg", "joint", low=-math.inf)] = None
    """True minus assumed angle of each joint at the start, degrees."""
    encoder_noise_deg: Annotated[Setting, Effect("deg", "joint", high=45, may_spread=False)] = None
    """Noise of the joint encoders before rounding, standard deviation, degrees."""
    encoder_resolution_deg: Annotated[Setting, Effect("deg", "joint", may_spread=False)] = None
    """Smallest step of the joint encoders, degrees."""

    def mismatch(self, joints: int) -> str | None:
        """Describe the first list whose length does not fit `joints` joints; None without one."""
        if isinstance(self.start_state, list):
            wrong = start_mismatch(self.start_state, joints)
            if wrong:
                return wrong
        for name, effect in EFFECTS.items():
            setting = getattr(self, name)
            parts = [setting.value, setting.spread] if isinstance(setting, Spread) else [setting]
            for numbers in parts:
                if isinstance(numbers, list):
                    wrong = effect.mismatch(f"machine.{name}", numbers, joints)
                    if wrong:
                        return wrong
        return None


_META = [(name, meta) for name, f in MachineTable.model_fields.items() for meta in f.metadata]
EFFECTS: dict[str, Effect] = {name: meta for name, meta in _META if isinstance(meta, Effect)}
"""All effects of a machine by key, in the order of the signal path."""
