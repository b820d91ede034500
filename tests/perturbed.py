"""Motions under errors of inputs, start and constants, by an integrator of its own."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

import planner


def draws(spread: Mapping[str, float], count: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Normal errors (count,) of each parameter."""
    rng = np.random.default_rng(seed)
    return {name: sigma * rng.normal(size=count) for name, sigma in spread.items()}


def motions(
    plan: planner.Plan, errors: Mapping[str, np.ndarray], t: np.ndarray | None = None
) -> np.ndarray:
    """True coordinates (S, m, N) at times t (m,) (the end when left out) of S perturbed machines.

    NumPy kinematics and DOP853, piece by piece of the plan's input.
    """
    system, count = plan.problem.system, len(next(iter(errors.values())))
    gain, bias = np.ones((count, 2)), np.zeros((count, 2))
    K = np.repeat(system.K[None], count, 0)
    q = np.repeat(plan.problem.start[None], count, 0)
    names = [c.name for c in system.coordinates]
    for name, values in errors.items():
        word, _, which = name.partition(" ")
        if word == "start":
            q[:, names.index(which)] += values
        elif word in ("gain", "bias"):
            (gain if word == "gain" else bias)[:, int(which[1:]) - 1] += values
        else:
            K[:, int(word[1:]) - 2] *= 1 + values
    wanted = np.array([plan.duration]) if t is None else t
    out = np.empty((count, len(wanted), system.size))
    for a, b in pairwise(plan.t):
        last = np.nextafter(b, a)

        def rates(time: float, flat: np.ndarray, last: float = last) -> np.ndarray:
            states = flat.reshape(count, -1)
            moved = system.rates(states, plan.u(min(time, last)) * gain + bias)
            moved[:, 2:] *= K / system.K
            return moved.ravel()

        inside = (wanted >= a) & ((wanted < b) | (b == plan.t[-1]))
        at = np.unique(np.append(wanted[inside], b))
        found = solve_ivp(rates, (a, b), q.ravel(), "DOP853", at, rtol=1e-8, atol=1e-10)
        states = found.y.T.reshape(len(at), count, -1)
        out[:, inside] = states[np.searchsorted(at, wanted[inside])].swapaxes(0, 1)
        q = states[-1]
    return out
