"""First guesses: an easy plan's inputs, with excursions that let the first input turn back.

The response has local optima by the number of reversals of the path coordinate. The guess obeys the
kinematics, because the response along it must be that of a motion: inputs are chosen, states and
response follow by integration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.methods.collocation.task import Task, driven
from planner.methods.collocation.transcription.unknowns import Iterate
from planner.plan.trajectory import Trajectory
from planner.support.arrays import Array

Excursion = Callable[[Array], Array]
AMPLITUDE = (0.6, 0.5)
"""Of the excursions of q₁ and q₂, in their units (rad)."""

SLOWEST_DRIVE = 0.05
"""Least drive by which an excursion of q₁ is turned into u₁."""

UNHURRIED = 3.0
"""A free duration is guessed so many times longer than that of the easy plan, a fast one."""


@dataclass(frozen=True)
class Seed:
    """A named pair of excursions over s in [0, 1] from an easy plan's q₁ and q₂."""

    name: str
    path: Excursion
    driven: Excursion


def seeds(reversal: bool) -> list[Seed]:
    """Seeds in the order in which they are tried; without reversal only q₂ makes excursions."""

    def zero(s: Array) -> Array:
        return np.zeros_like(s)

    def wave(size: float, count: int) -> Excursion:
        return lambda s: size * np.sin(count * np.pi * s)

    out = [Seed("least effort", zero, zero)]
    shapes = [("out and back", 1), ("twice", 2), ("thrice", 3)]
    for name, count in shapes:
        for a, b in ((1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)):
            if not reversal and a < 0:
                continue
            sign = _sign(b) if not reversal else f"{_sign(a)}{_sign(b)}"
            path = wave(a * AMPLITUDE[0], count) if reversal else zero
            out.append(Seed(f"{name} {sign}", path, wave(b * AMPLITUDE[1], count)))
    order = [0, *range(1, len(out), 4), *range(2, len(out), 4)] if reversal else range(len(out))
    first = [out[k] for k in order]
    return [*first, *(seed for seed in out if seed not in first)]


def guess(job: Task, easy: Trajectory, seed: Seed) -> Iterate:
    """The unknowns along a seed, for a task with or without a fixed duration."""
    duration = job.problem.duration or UNHURRIED * easy.duration
    s = job.made.form.input_places(job.mesh)
    u = easy.u(s * easy.duration) * easy.duration
    fine = np.linspace(0.0, 1.0, 2001)
    swing = np.stack(
        [np.interp(s, fine, np.gradient(part(fine), fine)) for part in (seed.path, seed.driven)],
        axis=-1,
    )
    drive = easy.system.drive(easy.q(s * easy.duration))
    swing[:, 0] /= np.where(np.abs(drive) < SLOWEST_DRIVE, SLOWEST_DRIVE, drive)
    limit = job.problem.limits.input
    return driven(job, duration, np.clip((u + swing) / duration, -limit, limit))


def _sign(value: float) -> str:
    return "+" if value > 0 else "-"
