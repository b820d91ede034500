"""The parameters that recorded runs determine, and the machine that they describe.

A log of commands and joint angles cannot separate all effects. These are merged:


- backlash, friction and stiffness of a joint, as its lost motion
  w = backlash/2 + friction/stiffness: a log determines w to about 0.01 degrees, but its parts only
  to a degree. Both parts keep their share of w,
- delay and servo bandwidth, as a motor's lag, delay + 1/bandwidth,
- viscous friction and stiffness of a joint, as its lag friction/stiffness,
- the gain of motor 1, as a common part of the joints' ratios.

Friction also loads the contacts, which transmit less under load. So it is a parameter of its own,
although one log hardly determines it. If it is fixed at the preset's value, which is not the arm's,
all other parameters seem more certain than they are (the error of lost motion is 1.6 of its
standard deviations, rms, instead of 1.1). With inertia the parts of w can be separated: friction
decides how far a link coasts, and a link moves freely in backlash but not in twist. So a dynamic
machine also has the share of twist in w as a parameter.

Every parameter has a prior about the preset. Its standard deviation is three times the preset's
spread between machines, since an arm on the bench may differ from the prototype; without a spread
it is a usual uncertainty.
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
"""Significant digits of a machine that is saved; the least uncertainty is some 0.1 %."""

OF_A_RUN = ("initial_angle_error_deg", "initial_play")
"""Effects that belong to a run, not to the machine: the state of the arm when it began."""

SHARE_SPREAD = 0.06
"""Spread of the share of twist in the lost motion, for 10 % spread of backlash, friction and
stiffness."""

LOAD_EFFECTS = {"lateral_friction", "friction_capacity_nm"}
"""Effects through which the joints' friction can be seen: loaded contacts transmit less."""

LEAST_LAG_S = 0.001
"""Least lag of a servo beyond the delay that is fitted, s; steps of the simulation are longer."""


ZERO_PRIOR_DEG, ZERO_MOST_DEG = 2.0, 20.0
"""Standard deviation of the prior of an encoder's zero, and the end of its range, degrees."""


@dataclass(frozen=True)
class FitParameter:
    """Parameter of the fit.

    Attributes:
        key: Name in results, such as "w2".
        name: Name in words.
        unit: Unit in which the parameter is shown.
        scale: Size of this unit in the unit of `value`.
        value: The preset's value.
        prior: Standard deviation of the prior.
        low, high: Range of the parameter.
        merged: The effects that the parameter stands for, in words; "" if only one.
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
    """Parameters that are the values of one effect in the `[machine]` table.

    Attributes:
        effect: The effect.
        key, name: Key and name of a parameter; "{}" is the number of its motor or joint.
        unit, scale: See `FitParameter`.
        usual: Standard deviation between machines if the preset has none.
        low, high: Range.
        first: Number of the motor or joint that the effect's first value belongs to.
        fitted: Index of the first value that is fitted.
        merged: See `FitParameter`.
        always: Whether the effect is fitted even if it is off in the preset.
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


def _zero(joint: int) -> FitParameter:
    prior, most = ZERO_PRIOR_DEG * DEG, ZERO_MOST_DEG * DEG
    words = f"zero{joint}", f"zero of encoder {joint}", "deg"
    return FitParameter(*words, DEG, 0.0, prior, -most, most)


class Parameters:
    """The parameters of a machine as a vector x: preset plus x standard deviations of the prior.

    Args:
        machine: The preset: start of the search, source of the priors, and values of all effects
            that are not fitted.
        system: The arm.
        zeros: Whether the zeros of its encoders are parameters too.

    Attributes:
        system: The arm.
        preset: The machine without spreads and without the effects of a run (`OF_A_RUN`).
        rows: The parameters, in the order of x.
        low, high: Ranges of x, (P,).
    """

    def __init__(self, machine: Machine, system: Manipulator, zeros: bool = False) -> None:
        self.preset = machine.nominal().without(*OF_A_RUN).with_(start_state="unwound")
        self._machine, self.system = machine, system
        self._base = draw(self.preset, system.n, np.zeros(1, dtype=np.int64), 0)
        self._lost = lost_motion(system, self.preset)
        self._twist = self._each("coulomb_friction_nm") / self._each("shaft_stiffness_nm_per_rad")
        rubs = bool(np.all(self._twist > 0))
        self._has_inertia = machine.fidelity == "dynamic" and rubs
        self._has_friction = rubs and (self._has_inertia or machine.effects.keys() >= LOAD_EFFECTS)
        self.rows = (*self._rows(), *(_zero(i) for i in range(1, system.n) if zeros))
        self._value = np.array([row.value for row in self.rows])
        self._prior = np.array([row.prior for row in self.rows])
        self.low = (np.array([row.low for row in self.rows]) - self._value) / self._prior
        self.high = (np.array([row.high for row in self.rows]) - self._value) / self._prior

    def _each(self, effect: str) -> Array:
        """Return the values of an effect in the preset, one for each motor or joint that has its
        own, (c,)."""
        count = EFFECTS[effect].count(self.system.n)
        return np.array(np.broadcast_to(self._base[effect][:, 0], count))

    def _rows(self) -> Iterator[FitParameter]:
        effects, numbers = self._machine.effects, range(2, self.system.n + 1)
        least = 0.1 * self._lost + 0.1 * DEG
        spreads = np.maximum(lost_spread(self._machine, self.system.n), least)
        for j, w, spread in zip(numbers, self._lost, spreads, strict=True):
            words, prior = (f"w{j}", f"lost motion of joint {j}", "deg"), PRIOR_SPREADS * spread
            merged = "" if self._has_inertia else "backlash, friction and stiffness"
            yield FitParameter(*words, DEG, w, prior, 0.02 * w, 5 * w + 10 * DEG, merged)
        if self._has_friction:
            yield from self._parts_of_lost_motion()
        if {"viscous_friction_nms_per_rad", "shaft_stiffness_nm_per_rad"} <= effects.keys():
            stiffness = self._each("shaft_stiffness_nm_per_rad")
            lags = self._each("viscous_friction_nms_per_rad") / stiffness
            for j, lag in zip(numbers, lags, strict=True):
                words, prior = (f"lag{j}", f"lag of joint {j}", "ms"), PRIOR_SPREADS * 0.3 * lag
                merged = "viscous friction and stiffness"
                yield FitParameter(*words, 1e-3, lag, prior, 0.0, 20 * lag, merged)
        if "servo_bandwidth_rad_s" in effects:
            delay = float(self._each("delay_s")[0])
            for i, lag in enumerate(delay + 1 / self._each("servo_bandwidth_rad_s"), start=1):
                words, prior = (f"servo{i}", f"lag of motor {i}", "ms"), PRIOR_SPREADS * 0.2 * lag
                merged = "delay and servo bandwidth"
                yield FitParameter(*words, 1e-3, lag, prior, delay + LEAST_LAG_S, 0.3, merged)
        for one in DIRECT:
            if one.effect in effects or (one.always and one.effect in EFFECTS):
                quantity = effects.get(one.effect)
                spread = max(quantity.spread) if quantity and quantity.varies else one.usual
                prior = PRIOR_SPREADS * spread
                for i, value in list(enumerate(self._each(one.effect)))[one.fitted :]:
                    words = one.key.format(i + one.first), one.name.format(i + one.first), one.unit
                    yield FitParameter(
                        *words, one.scale, value, prior, one.low, one.high, one.merged
                    )

    def _parts_of_lost_motion(self) -> Iterator[FitParameter]:
        numbers = range(2, self.system.n + 1)
        friction = self._each("coulomb_friction_nm")
        spreads = self._machine.spread("coulomb_friction_nm", self.system.n)
        spreads = np.maximum(spreads, 0.1 * friction)
        for j, f, spread in zip(numbers, friction, spreads, strict=True):
            words, prior = (f"friction{j}", f"friction of joint {j}", "N m"), spread
            yield FitParameter(*words, 1.0, f, PRIOR_SPREADS * prior, 0.1 * f, 10 * f)
        if self._has_inertia:
            for j, share in zip(numbers, self._twist / self._lost, strict=True):
                words, prior = (f"twist{j}", f"twist in w{j}", "%"), PRIOR_SPREADS * SHARE_SPREAD
                yield FitParameter(*words, 0.01, share, prior, 0.05, 0.95)

    def zeros(self, x: Array) -> Array:
        """Return the encoder readings at joint angles of zero, (S, n), rad, from x (S, P).

        The reading of the last joint is zero, since no rate depends on its angle.
        """
        rows = [k for k, row in enumerate(self.rows) if row.key.startswith("zero")]
        out = np.zeros((len(x), self.system.n))
        out[:, : len(rows)] = self.values(x)[:, rows]
        return out

    # -- machines ------------------------------------------------------------------------------

    def values(self, x: Array) -> Array:
        """Return the parameters (…, P) in their units, from x (…, P)."""
        return np.asarray(self._value + self._prior * x)

    def effects(self, x: Array) -> dict[str, Array]:
        """Return the effects in which machines x (S, P) differ from the preset, each (c, S)."""
        values = dict(zip((row.key for row in self.rows), self.values(x).T, strict=True))
        numbers = range(2, self.system.n + 1)
        lost = np.stack([values[f"w{j}"] for j in numbers])
        share = (self._twist / np.where(self._lost > 0, self._lost, 1.0))[:, None]
        friction = self._each("coulomb_friction_nm")[:, None]
        out = {}
        if self._has_inertia:
            share = np.stack([values[f"twist{j}"] for j in numbers])
        if self._has_friction:
            each = [values[f"friction{j}"] for j in numbers]
            friction = out["coulomb_friction_nm"] = np.stack(each)
        out["backlash_deg"] = np.rad2deg(2 * (1 - share) * lost)
        stiffness = self._each("shaft_stiffness_nm_per_rad")[:, None]
        if np.any(share > 0):
            stiffness = out["shaft_stiffness_nm_per_rad"] = friction / (share * lost)
        if "lag2" in values:
            lags = np.stack([values[f"lag{j}"] for j in numbers])
            out["viscous_friction_nms_per_rad"] = lags * stiffness
        if "servo1" in values:
            lags = np.stack([values["servo1"], values["servo2"]])
            out["servo_bandwidth_rad_s"] = 1 / (lags - self._each("delay_s")[0])
        for one in DIRECT:
            count = EFFECTS[one.effect].count(self.system.n) if one.effect in EFFECTS else 0
            keys = [one.key.format(i + one.first) for i in range(one.fitted, count)]
            if keys and keys[0] in values:
                kept = np.repeat(self._each(one.effect)[: one.fitted, None], len(x), axis=1)
                out[one.effect] = np.concatenate([kept, [values[key] for key in keys]])
        return {
            name: np.broadcast_to(value, (EFFECTS[name].count(self.system.n), len(x)))
            if EFFECTS[name].owner != "machine"
            else value[:1]
            for name, value in out.items()
        }

    def draws(self, x: Array) -> Draws:
        """Return the machines with the parameters x (S, P), one sample each."""
        count = len(x)
        base = {k: np.repeat(v, count, axis=1) for k, v in self._base.values.items()}
        values = {**base, **self.effects(x)}
        start = np.repeat(self._base.start, count, axis=1)
        return Draws(np.arange(count), values, start)

    def machine(self, x: Array) -> Machine:
        """Return the machine with the parameters x (P,), without spreads except of a run's start
        state."""
        run = {name: q for name, q in self._machine.effects.items() if name in OF_A_RUN}
        settings: dict[str, Any] = {name: q.to_setting() for name, q in run.items()}
        settings["start_state"] = list(self._machine.start_state)
        for name, values in self.effects(x[None]).items():
            numbers = [float(f"{value:.{DIGITS}g}") for value in values[:, 0]]
            settings[name] = numbers[0] if len(set(numbers)) == 1 else numbers
        return self.preset.with_(**settings)
