"""Find the mistake in a recorded run whose motion does not fit the arm's gears.

K and k_g are known, so commands and angles determine each joint's rate. Play, twist and errors of
gears change the turned angles little; a wrong sign, unit, order or clock changes them much. Such
mistakes are undone one at a time; if the run then fits, the message names the mistake.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, pairwise, permutations, product

import numpy as np

from planner.errors import InputError
from planner.plan.recorded.log import Log
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

FIT_SHARE, UNFIT_SHARE = 0.25, 0.7
"""Limits of the ratio of residual to motion, as root mean squares. Below the first a run fits. From
the first on a run is refused if undoing a mistake makes it fit and halves the ratio, from the
second on always. The ratio is 0.07 for an emulated arm, 0.18 if its servos lag by 0.1 s, up to 0.27
for twice the prototype's spreads and 0.65 for three times the spreads (40 arms each), of which no
delay of u1 leaves less than 0.65 and no factor less than 0.8. The mildest mistake, joints 2 and 3
exchanged, gives 0.3 or more, and most mistakes give 0.8."""

MOST_LATE_S, MOST_EARLY_S = 0.2, 0.03
"""Largest plausible lag of a motor, s; in the presets it is 0.04 s. The fit itself allows 0.3 s.
No motor leads, but the clocks of commands and readings may differ by some milliseconds."""

CLEAR_RATIO = 4.0
"""A delay is certain if no plausible one leaves less than this multiple of its squared residual. A
motor that turns at one speed shows no delay at all."""

LATEST_S, LATE_STEP_S = 2.0, 0.02
LEAST_LIKENESS = 0.99
"""Least correlation of joint 1 with motor 2 at the right delay; only a gearhead is between them."""

MAX_JOINTS = 4
"""Largest number of joints for which all orders are tried; for more, only exchanges of two."""

LEAST_SWING_DEG = 4.0
"""Least motion of a joint that is evidence, degrees; less may stay within its lost motion."""

PLAYS_DEG = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0])
"""Values of lost motion that are tried, degrees; the presets have one to four degrees."""

FACTORS = {
    np.pi / 180: "degrees/s",
    180 / np.pi: "radians/s where the header says degrees/s",
    np.pi / 30: "rpm",
    30 / np.pi: "radians/s where the header says rpm",
    6.0: "rpm where the header says degrees/s",
    1 / 6: "degrees/s where the header says rpm",
}
"""Units that are often confused, by the factor between them."""


TOO_LARGE = (2, 4)
"""Factors by which an encoder's readings are too large if its edges are counted twice or four
times. The inverse is not tried: friction, too, makes joints turn less."""

DEAD_DEG = 30.0
"""A reading that stays exactly the same while the commands turn the joint by more is dead. Lost
motion is 4 to 5 degrees in the presets, and 25 at most in an arm of half the stiffness and twice
the friction."""


def refuse_misfit(log: Log, system: Manipulator) -> None:
    """Refuse a recorded run that does not fit an arm.

    Args:
        log: The run.
        system: The arm, with its K and k_g.

    Raises:
        InputError: If the run does not fit. The message names another sign, unit, order of columns
            or clock that makes it fit, if there is one.
    """
    late = _delay(log)
    if not -MOST_EARLY_S <= late <= MOST_LATE_S:
        raise InputError(
            f"{log.source}: the joints turn {abs(late):.2g} s {'after' if late > 0 else 'before'}"
            " the commands; check that both were recorded with the same clock, and that each row"
            " has the command that holds from its time on"
        )
    left = _misfit(log, system)
    if np.all(left < FIT_SHARE):
        _refuse_dead(log, system)
        return
    worst = int(np.argmax(left))
    fault = min(_mistakes(log), key=lambda each: float(np.max(_misfit(each[1], system))))
    fits = np.max(_misfit(fault[1], system)) < min(FIT_SHARE, left[worst] / 2)
    if not fits:
        _refuse_dead(log, system)
    if not fits and left[worst] < UNFIT_SHARE:
        return  # an arm far from the prototype; what the fit leaves over is reported
    advice = f"the run fits if {fault[0]}" if fits else "no sign, unit or order makes the run fit"
    raise InputError(
        f"{log.source}: theta{worst + 1} does not turn as the commands and the problem's gears"
        f" (K, k_g) require; {advice}"
    )


def _refuse_dead(log: Log, system: Manipulator) -> None:
    """Refuse a run in which a reading stands still although the commands turn the joint."""
    commands = commanded(log, system)
    for i, read in enumerate(log.theta.T):
        first, last = longest_standstill(read)
        turned = np.rad2deg(np.ptp(commands[first:last, i]))
        if turned > DEAD_DEG:
            raise InputError(
                f"{log.source}: theta{i + 1} stays at {np.rad2deg(read[first]):.5g} deg from t ="
                f" {log.t[first]:.4g} to {log.t[last - 1]:.4g} s, while the commands turn it by"
                f" {turned:.3g} deg: its encoder is dead, or the joint is blocked or loose"
            )


def longest_standstill(read: Array) -> tuple[int, int]:
    """Return the first row of the longest stretch of equal readings (R,), and the row after its
    last."""
    edges = np.flatnonzero(np.diff(read, prepend=np.nan, append=np.nan) != 0).tolist()
    return max(pairwise(edges), key=lambda each: each[1] - each[0])


def commanded(log: Log, system: Manipulator) -> Array:
    """Return the angles (R, n) by which the commands turn the joints, by the gears, rad."""
    q = np.column_stack([np.zeros(len(log.t)), log.theta])
    middle = (q[:-1] + q[1:]) / 2
    steps = system.rates(middle, log.u[:-1])[:, 1:] * np.diff(log.t)[:, None]
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


def _misfit(log: Log, system: Manipulator) -> Array:
    """Return each joint's misfit, (n,): the root mean square of read minus commanded angles,
    divided by that of the larger of both motions.

    Joints 2 … n are given the lost motion of `PLAYS_DEG` with the least misfit.
    """
    commands = commanded(log, system)
    swing = np.maximum(np.std(commands, axis=0), np.std(log.theta, axis=0))
    passed = np.empty((len(log.t), len(PLAYS_DEG), commands.shape[1]))
    half = np.deg2rad(PLAYS_DEG)[:, None] * (np.arange(commands.shape[1]) > 0)
    now = np.repeat(commands[:1], len(PLAYS_DEG), axis=0)
    for k, angle in enumerate(commands):
        passed[k] = now = np.minimum(np.maximum(now, angle - half), angle + half)
    left = np.min(np.std(log.theta[:, None] - passed, axis=0), axis=0)
    widest = np.maximum(np.ptp(commands, axis=0), np.ptp(log.theta, axis=0))
    small = widest < np.deg2rad(LEAST_SWING_DEG)
    return np.asarray(np.where(small, 0.0, left / np.maximum(swing, 1e-12)))


def _mistakes(log: Log) -> Iterator[tuple[str, Log]]:
    """Yield possible mistakes, in words, each with the log in which it is undone."""
    for signs in ((-1, 1), (1, -1), (-1, -1)):
        names = " and ".join(f"u{i + 1}" for i, sign in enumerate(signs) if sign < 0)
        yield (
            f"{names} {'have' if sum(signs) < 0 else 'has'} the other sign",
            replace(log, u=log.u * signs),
        )
    for (factor, unit), which in product(FACTORS.items(), ((0,), (1,), (0, 1))):
        scale = np.array([factor if i in which else 1.0 for i in range(2)])
        names = " and ".join(f"u{i + 1}" for i in which)
        yield (
            f"{names} {'are' if len(which) > 1 else 'is'} in {unit}",
            replace(log, u=log.u * scale),
        )
    yield "u1 and u2 are exchanged", replace(log, u=log.u[:, ::-1])
    joints = tuple(range(log.theta.shape[1]))
    for i in joints:
        mirrored = np.array([-1.0 if i == k else 1.0 for k in joints])
        yield f"theta{i + 1} has the other sign", replace(log, theta=log.theta * mirrored)
    for factor in (1 / 4, 1 / 3, 1 / 2, 2, 3, 4):
        yield (
            f"motor 1 turns {factor:.2g} times as far as u1 says (or k_g is off by this factor)",
            replace(log, u=log.u * [factor, 1.0]),
        )
    for late in (*range(-10, -2), *range(4, 11)):  # tenths of a second
        u1 = np.interp(log.t - late / 10, log.t, log.u[:, 0])
        yield (
            f"u1 acts {abs(late) / 10} s {'after' if late > 0 else 'before'} the time of its row",
            replace(log, u=np.column_stack([u1, log.u[:, 1]])),
        )
    for i, factor in product(joints, TOO_LARGE):
        smaller = np.array([1 / factor if i == k else 1.0 for k in joints])
        yield (
            f"theta{i + 1} is read {factor} times too large"
            + (f" (or K{i + 1} is given so many times too small)" if i else ""),
            replace(log, theta=log.theta * smaller),
        )
    pairs = combinations(joints, 2)
    orders = [tuple(j if k == i else i if k == j else k for k in joints) for i, j in pairs]
    if len(joints) <= MAX_JOINTS:
        orders = list(permutations(joints))[1:]
    for order in orders:
        names = ", ".join(f"theta{i + 1}" for i in order)
        yield (
            f"the columns of angles belong, in this order, to the joints {names}",
            replace(log, theta=log.theta[:, np.argsort(order)]),
        )


def _delay(log: Log) -> float:
    """Return the delay, s, at which joint 1 best follows its commands; 0 if joint 1 hardly turns,
    or follows nearly as well with a plausible delay."""
    turned = np.concatenate([[0.0], np.cumsum(log.u[:-1, 1] * np.diff(log.t))])
    read = log.theta[:, 0]
    if min(np.ptp(turned), np.ptp(read)) < np.deg2rad(LEAST_SWING_DEG):
        return 0.0
    edge = min(LATEST_S, log.t[-1] / 4)
    inside = log.t[(log.t >= edge) & (log.t <= log.t[-1] - edge)]
    seen = np.interp(inside, log.t, read)
    delays = LATE_STEP_S * np.arange(-round(edge / LATE_STEP_S), round(edge / LATE_STEP_S) + 1)
    alike = [np.corrcoef(seen, np.interp(inside - late, log.t, turned))[0, 1] for late in delays]
    left = 1 - np.nan_to_num(np.square(alike))
    best, plausible = int(np.argmin(left)), (delays >= -MOST_EARLY_S) & (delays <= MOST_LATE_S)
    certain = CLEAR_RATIO * left[best] < np.min(left[plausible])
    return float(delays[best]) if certain and abs(alike[best]) > LEAST_LIKENESS else 0.0
