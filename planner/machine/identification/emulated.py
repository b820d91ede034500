"""Logs of an arm that there is not: what the encoders of an emulated machine would have told."""

from __future__ import annotations

import numpy as np

from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.machine import Machine, machine_for
from planner.machine.replay import replay
from planner.plan.log import Log
from planner.plan.plan import Plan, expect_plan
from planner.support.arrays import Array

NOISE_DEG = 0.03
"""Noise of a joint's encoder before it is rounded: a third of the prototype's resolution."""


def emulate_log(
    plan: Plan,
    machine: Machine | str | None = None,
    *,
    sample: int = 0,
    seed: int = 0,
    noise_deg: float = NOISE_DEG,
) -> Log:
    """What would be recorded of a plan on one emulated machine, to rehearse without an arm.

    Args:
        plan: An executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        sample: Number of the sample; its effects are those of `planner.replay`.
        seed: Random seed of the samples; of the noise, together with `sample`.
        noise_deg: Standard deviation of a reading's noise before it is rounded to the encoder's
            resolution, degrees.

    Returns:
        Commands and readings at each period of the controller, until half a second after the end.

    Raises:
        InputError: As `planner.replay`.
    """
    expect_plan(plan)
    used = machine_for(plan.problem.machine, machine)
    hold = used.effects.get("control_period_s")
    tick = hold.value[0] if hold else DEFAULT_TICK_S
    run = replay(plan, used, [sample], seed, record_s=tick)
    t: Array = tick * np.arange(int(np.floor(run.t[-1] / tick + 1e-9)) + 1, dtype=np.float64)
    rows = np.searchsorted(run.t, t - 1e-9)
    noise = np.random.default_rng([seed, sample]).normal(size=(len(t), run.q.shape[2] - 1))
    read = run.q[0, rows, 1:] + np.deg2rad(noise_deg) * noise
    return Log(
        t=t,
        u=np.where((t < plan.duration - 1e-9)[:, None], plan.trajectory.u(t), 0.0),
        theta=_rounded(read, np.broadcast_to(used.mean("encoder_resolution_deg"), read.shape[1])),
        source=f"{plan.method} on emulated machine {sample}",
    )


def _rounded(theta: Array, resolution_deg: Array) -> Array:
    """Angles (R, n) at the encoders' resolution (n,)."""
    step = np.deg2rad(np.where(resolution_deg > 0, resolution_deg, 1e-9))
    return np.asarray(np.round(theta / step) * step)
