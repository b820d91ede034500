"""Logs of emulated arms: the readings that the encoders of an emulated machine would give."""

from __future__ import annotations

import numpy as np

from planner.machine.closed_loop import encoder_readings
from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.machine import Machine, machine_for
from planner.machine.replay import replay
from planner.plan.plan import Plan, expect_plan
from planner.plan.recorded.log import Log
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
    """Emulate the log of a plan on one machine, to practise identification without an arm.

    Args:
        plan: An executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        sample: Number of the sample; its effects are the same as in `planner.replay`.
        seed: Random seed of the samples and, together with `sample`, of the noise.
        noise_deg: Standard deviation of a reading's noise before it is rounded to the encoder's
            resolution, degrees.

    Returns:
        Commands and readings at each period of the controller, until half a second after the end.

    Raises:
        InputError: See `planner.replay`.
    """
    expect_plan(plan)
    used = machine_for(plan.problem.machine, machine)
    hold = used.effects.get("control_period_s")
    tick = hold.value[0] if hold else DEFAULT_TICK_S
    run = replay(plan, used, [sample], seed, record_s=tick)
    t: Array = tick * np.arange(int(np.floor(run.t[-1] / tick + 1e-9)) + 1, dtype=np.float64)
    rows = np.searchsorted(run.t, t - 1e-9)
    noise = np.random.default_rng([seed, sample]).normal(size=(len(t), run.q.shape[2] - 1))
    q = run.q[0, rows]
    q[:, 1:] += np.deg2rad(noise_deg) * noise
    read = encoder_readings(plan.problem.system, run.draws, q.T[:, :, None])
    return Log(
        t=t,
        u=np.where((t < plan.duration - 1e-9)[:, None], plan.trajectory.u(t), 0.0),
        theta=read[1:, :, 0].T,
        source=f"{plan.method} on emulated machine {sample}",
    )
