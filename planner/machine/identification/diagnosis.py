"""What is wrong with a recorded run whose motion the arm's gears cannot have made.

K and k_g are known, so that commands and angles tell each joint's rate. Play, twist and errors of
gears leave the turned angles alike; a wrong sign, unit, order or clock does not. What is wrong is
looked for among such mistakes, one at a time, and named if the run then fits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np

from planner.errors import InputError
from planner.plan.recorded.log import Log
from planner.support.arrays import Array
from planner.systems.manipulator import Manipulator

FIT_SHARE = 0.25
"""Root mean square of what is left, as a part of the motion's. An emulated arm leaves 0.07, one
whose servos lag by 0.1 s 0.18; the mildest mistake, joints 2 and 3 exchanged, 0.4."""

MOST_LATE_S = 0.2
"""A motor that follows later than this is not behind a servo: those of the presets lag by 0.04 s.
The fit itself allows for 0.3 s."""
LATEST_S, LATE_STEP_S = 2.0, 0.02
LEAST_LIKENESS = 0.99
"""Correlation of joint 1 with motor 2 at the right delay: only the gearhead is between them."""

MOST_REORDERED = 4
"""Arms of more joints have so many orders that only exchanges of two are tried."""

LEAST_SWING_DEG = 4.0
"""What moves less lies within its lost motion, and says nothing."""

PLAYS_DEG = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0])
"""Halves of lost motion that are tried: the presets' are one to four degrees."""

FACTORS = {
    np.pi / 180: "degrees/s",
    180 / np.pi: "radians/s where the header says degrees/s",
    np.pi / 30: "rpm",
    30 / np.pi: "radians/s where the header says rpm",
    6.0: "rpm where the header says degrees/s",
    1 / 6: "degrees/s where the header says rpm",
}
"""Units that are taken for each other, by what makes the one of the other."""


def refuse_misfit(log: Log, system: Manipulator) -> None:
    """Refuse a run that is not of this arm as it was written down.

    Args:
        log: The run.
        system: The arm, with its K and k_g.

    Raises:
        InputError: If another sign, unit or order of columns or another clock makes it fit, which
            the message names, or nothing does.
    """
    late = _delay(log)
    if abs(late) > MOST_LATE_S:
        raise InputError(
            f"{log.source}: the joints turn {abs(late):.2g} s {'after' if late > 0 else 'before'}"
            " the commands; were both recorded by the same clock, and each command in the row from"
            " which on it holds?"
        )
    left = _left(log, system)
    if np.all(left < FIT_SHARE):
        return
    worst = int(np.argmax(left))
    found = min(_mistakes(log), key=lambda each: float(np.max(_left(each[1], system))))
    fits = np.max(_left(found[1], system)) < FIT_SHARE
    advice = f"it fits if {found[0]}" if fits else "no sign, unit or order of columns makes it fit"
    raise InputError(
        f"{log.source}: theta{worst + 1} does not turn as the commands and the gears (K, k_g) of"
        f" the problem ask for; {advice}"
    )


def _left(log: Log, system: Manipulator) -> Array:
    """Root mean square of read less commanded angles, over that of the larger motion, (n,).

    Of joints behind contacts with the play that leaves least.
    """
    q = np.column_stack([np.zeros(len(log.t)), log.theta])
    middle = (q[:-1] + q[1:]) / 2
    steps = system.rates(middle, log.u[:-1])[:, 1:] * np.diff(log.t)[:, None]
    asked = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    swing = np.maximum(np.std(asked, axis=0), np.std(log.theta, axis=0))
    passed = np.empty((len(log.t), len(PLAYS_DEG), asked.shape[1]))
    half = np.deg2rad(PLAYS_DEG)[:, None] * (np.arange(asked.shape[1]) > 0)
    now = np.repeat(asked[:1], len(PLAYS_DEG), axis=0)
    for k, angle in enumerate(asked):
        passed[k] = now = np.minimum(np.maximum(now, angle - half), angle + half)
    left = np.min(np.std(log.theta[:, None] - passed, axis=0), axis=0)
    small = np.maximum(np.ptp(asked, axis=0), np.ptp(log.theta, axis=0)) < np.deg2rad(
        LEAST_SWING_DEG
    )
    return np.asarray(np.where(small, 0.0, left / np.maximum(swing, 1e-12)))


def _mistakes(log: Log) -> Iterator[tuple[str, Log]]:
    """What may be wrong, in words, and the log without it."""
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
    yield "u1 and u2 change places", replace(log, u=log.u[:, ::-1])
    joints = tuple(range(log.theta.shape[1]))
    for i in joints:
        mirrored = np.array([-1.0 if i == k else 1.0 for k in joints])
        yield f"theta{i + 1} has the other sign", replace(log, theta=log.theta * mirrored)
    orders = [
        tuple(j if k == i else i if k == j else k for k in joints)
        for i, j in combinations(joints, 2)
    ]
    if len(joints) <= MOST_REORDERED:
        orders = list(permutations(joints))[1:]
    for order in orders:
        names = ", ".join(f"theta{i + 1}" for i in order)
        yield (
            f"the columns of angles are, in this order, of joints: {names}",
            replace(log, theta=log.theta[:, np.argsort(order)]),
        )


def _delay(log: Log) -> float:
    """How long after its commands joint 1 turns, s, by which both are most alike; 0 if it hardly
    turns."""
    turned = np.concatenate([[0.0], np.cumsum(log.u[:-1, 1] * np.diff(log.t))])
    read = log.theta[:, 0]
    if min(np.ptp(turned), np.ptp(read)) < np.deg2rad(LEAST_SWING_DEG):
        return 0.0
    edge = min(LATEST_S, log.t[-1] / 4)
    inside = log.t[(log.t >= edge) & (log.t <= log.t[-1] - edge)]
    seen = np.interp(inside, log.t, read)
    delays = LATE_STEP_S * np.arange(-round(edge / LATE_STEP_S), round(edge / LATE_STEP_S) + 1)
    alike = [np.corrcoef(seen, np.interp(inside - late, log.t, turned))[0, 1] for late in delays]
    best = int(np.nanargmax(np.abs(alike)))
    return float(delays[best]) if abs(alike[best]) > LEAST_LIKENESS else 0.0
