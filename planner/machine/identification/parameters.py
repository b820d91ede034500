"""What recorded runs can tell of a machine, and the machine that such numbers make.

A log of commands and joint angles does not tell every effect apart. Merged are

- backlash, friction and stiffness of a joint, as its lost motion
  w = backlash/2 + friction/stiffness: w shows to some 0.01 degrees, its parts to a degree. Both
  parts keep their share of w,
- delay and servo bandwidth, as the time delay + 1/bandwidth by which a motor comes late,
- viscous friction and stiffness of a joint, as its lag friction/stiffness,
- the gain of motor 1, as a common part of the joints' ratios.

Friction also loads the contacts, which pass on less under load. So it is a parameter of its own,
though one log tells little of it: held at the preset's value, which is another than the arm's, it
made everything else look surer than it was (lost motion off by 1.6 of its deviations, rms, and by
1.1 with it). With inertia the parts of w show, too: friction decides how far a link coasts, and
backlash, unlike twist, lets it fly. A dynamic machine has twist's share in w besides.

Every parameter has a prior, about the preset: three times the preset's spread from machine to
machine, since an arm on the bench may be no prototype; where that has none, a usual uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.machine.feedback.means import lost_motion, lost_spread
from planner.machine.machine import Draws, Machine, draw
from planner.problem.tables.machine_effects import EFFECTS
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

PRIOR_SPREADS = 3.0
"""Standard deviation of the prior, in spreads of the preset."""

DEG = np.pi / 180

DIGITS = 6
"""Significant digits of a machine that is written down; the least uncertainty is some 0.1 %."""

OF_A_RUN = ("initial_angle_error_deg", "initial_play")
"""Effects that are of a run: how the arm stood when it began."""

SHARE_SPREAD = 0.06
"""Spread of twist's share of the lost motion, with a tenth in backlash, friction and stiffness."""

LOADED = {"lateral_friction", "friction_capacity_nm"}
"""Effects by which the joints' friction shows: contacts that it loads pass on less."""

LEAST_LAG_S = 0.001
"""A servo that follows sooner is as good as direct; the steps of the simulation are longer."""


@dataclass(frozen=True)
class Parameter:
    """One number that is fitted.

    Attributes:
        key: Its name in results, as in "w2".
        name: What it is, in words.
        unit: Unit in which it is shown.
        scale: One such unit in that of `value`.
        value: The preset's.
        prior: Standard deviation about it.
        low, high: Its range.
        merged: What else it stands for, in words; or "".
    """

    key: str
    name: str
    unit: str
    scale: float
    value: float
    prior: float
    low: float
    high: float
    merged: str = ""


@dataclass(frozen=True)
class _Direct:
    """Parameters that are values of one effect, as they stand in the `[machine]` table.

    Attributes:
        effect: The effect.
        key, name: Of a parameter; "{}" is the number of its motor or joint.
        unit, scale: As of `Parameter`.
        usual: Standard deviation from machine to machine where the preset has none.
        low, high: Range.
        first: Number of the motor or joint that the effect's first value belongs to.
        fitted: Which of its values are looked for, from this place on.
        merged: As of `Parameter`.
        always: Whether it is looked for where it is off in the preset, too.
    """

    effect: str
    key: str
    name: str
    unit: str
    scale: float
    usual: float
    low: float
    high: float
    first: int = 1
    fitted: int = 0
    merged: str = ""
    always: bool = True


DIRECT = (
    _Direct("gear_ratio_error", "ratio{}", "ratio of joint {}", "%", 0.01, 0.005, -0.5, 0.5,
            first=2, merged="gear ratio, gain of motor 1, creep"),
    _Direct("input_gain_error", "gain{}", "gain of motor {}", "%", 0.01, 0.003, -0.5, 0.5,
            fitted=1),
    _Direct("input_bias_rad_s", "bias{}", "bias of motor {}", "mrad/s", 1e-3, 5e-4, -0.05, 0.05),
    _Direct("gearhead_backlash_deg", "gear{}", "backlash of gearhead {}", "deg", 1.0, 0.1, 0.0, 8.0,
            always=False),
    _Direct("creep_per_nm", "creep_load", "creep under load", "%/N m", 0.01, 0.002, 0.0, 0.2,
            always=False),
    _Direct("lateral_friction", "lateral", "lateral friction of contacts", "", 1.0, 0.05, 0.0, 1.0,
            always=False),
)  # fmt: skip


class Parameters:
    """The parameters of a machine, as a vector x: 0 is the preset, 1 a prior's deviation more.

    Args:
        machine: The preset: where the search begins, what its priors come from, and what stays that
            is not looked for.
        system: The arm.

    Attributes:
        system: The arm.
        preset: The machine without spreads, and without what belongs to a run and no machine.
        rows: The parameters, in the order of x.
        low, high: Ranges of x, (P,).
    """

    def __init__(self, machine: Machine, system: Manipulator) -> None:
        self.preset = machine.nominal().without(*OF_A_RUN).with_(start_state="unwound")
        self._machine, self.system = machine, system
        self._base = draw(self.preset, system.n, np.zeros(1, dtype=np.int64), 0)
        self._lost = lost_motion(system, self.preset)
        self._twist = self._each("coulomb_friction_nm") / self._each("shaft_stiffness_nm_per_rad")
        rubs = bool(np.all(self._twist > 0))
        self._has_inertia = machine.fidelity == "dynamic" and rubs
        self._has_friction = rubs and (self._has_inertia or machine.effects.keys() >= LOADED)
        self.rows = tuple(self._rows())
        self._value = np.array([row.value for row in self.rows])
        self._prior = np.array([row.prior for row in self.rows])
        self.low = (np.array([row.low for row in self.rows]) - self._value) / self._prior
        self.high = (np.array([row.high for row in self.rows]) - self._value) / self._prior

    def _each(self, effect: str) -> Array:
        """Values of an effect in the preset, one for each that can have one of its own, (c,)."""
        return np.array(
            np.broadcast_to(self._base[effect][:, 0], EFFECTS[effect].count(self.system.n))
        )

    def _rows(self) -> Iterator[Parameter]:
        effects, numbers = self._machine.effects, range(2, self.system.n + 1)
        spreads = np.maximum(
            lost_spread(self._machine, self.system.n), 0.1 * self._lost + 0.1 * DEG
        )
        for j, w, spread in zip(numbers, self._lost, spreads, strict=True):
            words, prior = (f"w{j}", f"lost motion of joint {j}", "deg"), PRIOR_SPREADS * spread
            merged = "" if self._has_inertia else "backlash, friction and stiffness"
            yield Parameter(*words, DEG, w, prior, 0.02 * w, 5 * w + 10 * DEG, merged)
        if self._has_friction:
            yield from self._parts_of_lost_motion()
        if {"viscous_friction_nms_per_rad", "shaft_stiffness_nm_per_rad"} <= effects.keys():
            lags = self._each("viscous_friction_nms_per_rad") / self._each(
                "shaft_stiffness_nm_per_rad"
            )
            for j, lag in zip(numbers, lags, strict=True):
                words, prior = (f"lag{j}", f"lag of joint {j}", "ms"), PRIOR_SPREADS * 0.3 * lag
                merged = "viscous friction and stiffness"
                yield Parameter(*words, 1e-3, lag, prior, 0.0, 20 * lag, merged)
        if "servo_bandwidth_rad_s" in effects:
            delay = float(self._each("delay_s")[0])
            for i, lag in enumerate(delay + 1 / self._each("servo_bandwidth_rad_s"), start=1):
                words, prior = (f"servo{i}", f"lag of motor {i}", "ms"), PRIOR_SPREADS * 0.2 * lag
                merged = "delay and servo bandwidth"
                yield Parameter(*words, 1e-3, lag, prior, delay + LEAST_LAG_S, 0.3, merged)
        for one in DIRECT:
            if one.effect in effects or (one.always and one.effect in EFFECTS):
                quantity = effects.get(one.effect)
                spread = max(quantity.spread) if quantity and quantity.varies else one.usual
                prior = PRIOR_SPREADS * spread
                for i, value in list(enumerate(self._each(one.effect)))[one.fitted :]:
                    words = one.key.format(i + one.first), one.name.format(i + one.first), one.unit
                    yield Parameter(*words, one.scale, value, prior, one.low, one.high, one.merged)

    def _parts_of_lost_motion(self) -> Iterator[Parameter]:
        numbers = range(2, self.system.n + 1)
        friction = self._each("coulomb_friction_nm")
        spreads = self._machine.spread("coulomb_friction_nm", self.system.n)
        spreads = np.maximum(spreads, 0.1 * friction)
        for j, f, spread in zip(numbers, friction, spreads, strict=True):
            words, prior = (f"friction{j}", f"friction of joint {j}", "N m"), spread
            yield Parameter(*words, 1.0, f, PRIOR_SPREADS * prior, 0.1 * f, 10 * f)
        if self._has_inertia:
            for j, share in zip(numbers, self._twist / self._lost, strict=True):
                words, prior = (f"twist{j}", f"twist in w{j}", "%"), PRIOR_SPREADS * SHARE_SPREAD
                yield Parameter(*words, 0.01, share, prior, 0.05, 0.95)

    # -- what they make ------------------------------------------------------------------------

    def values(self, x: Array) -> Array:
        """Parameters (…, P) in their units, from x (…, P)."""
        return np.asarray(self._value + self._prior * x)

    def effects(self, x: Array) -> dict[str, Array]:
        """The effects that machines x (S, P) have in place of the preset's, each (c, S)."""
        found = dict(zip((row.key for row in self.rows), self.values(x).T, strict=True))
        numbers = range(2, self.system.n + 1)
        lost = np.stack([found[f"w{j}"] for j in numbers])
        share = (self._twist / np.where(self._lost > 0, self._lost, 1.0))[:, None]
        friction = self._each("coulomb_friction_nm")[:, None]
        out = {}
        if self._has_inertia:
            share = np.stack([found[f"twist{j}"] for j in numbers])
        if self._has_friction:
            friction = out["coulomb_friction_nm"] = np.stack(
                [found[f"friction{j}"] for j in numbers]
            )
        out["backlash_deg"] = np.rad2deg(2 * (1 - share) * lost)
        stiffness = self._each("shaft_stiffness_nm_per_rad")[:, None]
        if np.any(share > 0):
            stiffness = out["shaft_stiffness_nm_per_rad"] = friction / (share * lost)
        if "lag2" in found:
            lags = np.stack([found[f"lag{j}"] for j in numbers])
            out["viscous_friction_nms_per_rad"] = lags * stiffness
        if "servo1" in found:
            lags = np.stack([found["servo1"], found["servo2"]])
            out["servo_bandwidth_rad_s"] = 1 / (lags - self._each("delay_s")[0])
        for one in DIRECT:
            count = EFFECTS[one.effect].count(self.system.n) if one.effect in EFFECTS else 0
            keys = [one.key.format(i + one.first) for i in range(one.fitted, count)]
            if keys and keys[0] in found:
                kept = np.repeat(self._each(one.effect)[: one.fitted, None], len(x), axis=1)
                out[one.effect] = np.concatenate([kept, [found[key] for key in keys]])
        return {
            name: np.broadcast_to(value, (EFFECTS[name].count(self.system.n), len(x)))
            if EFFECTS[name].owner != "machine"
            else value[:1]
            for name, value in out.items()
        }

    def draws(self, x: Array) -> Draws:
        """Single machines x (S, P)."""
        count = len(x)
        base = {k: np.repeat(v, count, axis=1) for k, v in self._base.values.items()}
        values = {**base, **self.effects(x)}
        start = np.repeat(self._base.start, count, axis=1)
        return Draws(np.arange(count), values, start)

    def machine(self, x: Array) -> Machine:
        """The machine with these parameters (P,), without spreads but of how a run begins."""
        run = {name: q for name, q in self._machine.effects.items() if name in OF_A_RUN}
        settings: dict[str, Any] = {name: q.to_setting() for name, q in run.items()}
        settings["start_state"] = list(self._machine.start_state)
        for name, values in self.effects(x[None]).items():
            numbers = [float(f"{value:.{DIGITS}g}") for value in values[:, 0]]
            settings[name] = numbers[0] if len(set(numbers)) == 1 else numbers
        return self.preset.with_(**settings)
