"""First guesses: an easy plan's inputs, with excursions that let the first input turn back.

The response has local optima by the number of reversals of the path coordinate. The guess obeys the
kinematics, because the response along it must be that of a motion: inputs are chosen, states and
response follow by integration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from planner.desensitise.augmented import Augmented
from planner.desensitise.task import Task
from planner.systems.base import Array
from planner.trajectory import Trajectory

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


def guess(task: Task, easy: Trajectory, seed: Seed) -> Array:
    """The unknowns along a seed, for a task with or without a fixed duration."""
    duration = task.problem.duration or UNHURRIED * easy.duration
    linear = task.program.shape.form.input == "linear"
    edges = task.mesh.edges
    s = edges if linear else edges[:-1] + task.mesh.widths / 2
    u = easy.u(s * easy.duration) * easy.duration
    fine = np.linspace(0.0, 1.0, 2001)
    swing = np.stack(
        [np.interp(s, fine, np.gradient(part(fine), fine)) for part in (seed.path, seed.driven)],
        axis=-1,
    )
    drive = easy.system.drive(easy.q(s * easy.duration))
    swing[:, 0] /= np.where(np.abs(drive) < SLOWEST_DRIVE, SLOWEST_DRIVE, drive)
    limit = task.problem.limits.input
    return packed(task, np.clip((u + swing) / duration, -limit, limit), duration)


def packed(task: Task, inputs: Array, duration: float) -> Array:
    """Unknowns from inputs (K or K+1, 2): states and response by integration."""
    p, mesh = task.program, task.mesh
    tau = np.concatenate([[0.0], p.shape.form.scheme.points])
    linear = len(inputs) > len(mesh.widths)
    right = inputs[1:] if linear else inputs
    left = inputs[:-1] if linear else inputs
    places = np.stack([tau[:-1], (tau[:-1] + tau[1:]) / 2, tau[1:]])
    u = left[:, None, None] + places.T[None, :, :, None] * (right - left)[:, None, None]
    flat = u.reshape(-1, 3, 2)
    times = mesh.at(tau[:-1]).ravel() * duration
    lengths = (mesh.widths[:, None] * np.diff(tau)).ravel() * duration
    first = np.asarray(p.made.initial(task.sigma), dtype=float).ravel()
    start = np.concatenate([task.problem.start, first])
    count = len(flat)
    run = _runner(p.made, count)
    shared = [np.repeat(v[:, None], count, 1) for v in (task.sigma, task.problem.start)]
    arguments = [flat[:, j].T for j in range(3)]
    found = np.asarray(run(start, *arguments, times[None], lengths[None], *shared)).T
    x = np.empty(p.size)
    x[0], x[p.inputs] = duration, inputs
    x[p.points] = found.reshape(p.points.shape)
    x[p.states[0]] = start
    return x


@lru_cache(maxsize=32)
def _runner(made: Augmented, count: int) -> Any:
    return _step(made).mapaccum("guess", count)


@lru_cache(maxsize=32)
def _step(made: Augmented) -> Any:
    """One step of the classical Runge–Kutta method of order 4 of motion and response."""
    x, t, h = ca.SX.sym("x", made.size), ca.SX.sym("t"), ca.SX.sym("h")
    sigma, q0 = ca.SX.sym("sigma", len(made.names)), ca.SX.sym("q0", made.system.size)
    u = [ca.SX.sym(name, 2) for name in ("first", "middle", "last")]
    a = made.rates(x, u[0], t, sigma, q0)
    b = made.rates(x + h / 2 * a, u[1], t + h / 2, sigma, q0)
    c = made.rates(x + h / 2 * b, u[1], t + h / 2, sigma, q0)
    d = made.rates(x + h * c, u[2], t + h, sigma, q0)
    out = x + h / 6 * (a + 2 * b + 2 * c + d)
    return ca.Function("step", [x, *u, t, h, sigma, q0], [out])


def _sign(value: float) -> str:
    return "+" if value > 0 else "-"
