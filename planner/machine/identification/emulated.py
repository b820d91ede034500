"""Logs of emulated arms: the readings that the encoders of an emulated machine would give."""

from __future__ import annotations

import numpy as np

from planner.machine.feedback.course import DEFAULT_TICK_S
from planner.machine.feedback.homing import HomingRule
from planner.machine.machine import Machine, machine_for
from planner.machine.replay import replay
from planner.plan.plan import Plan, expect_plan
from planner.plan.recorded.log import Log
from planner.support.arrays import Array


def emulate_log(
    plan: Plan,
    machine: Machine | str | None = None,
    *,
    sample: int = 0,
    seed: int = 0,
    noise_deg: float | None = None,
) -> Log:
    """Emulate the log of a plan on one machine, to practise identification without an arm.

    The encoders end a homing motion, as `planner.HomingRule` does.

    Args:
        plan: An executable plan.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        sample: Number of the sample; its effects are the same as in `planner.replay`.
        seed: Random seed of the samples and, together with `sample`, of the noise.
        noise_deg: Noise of the readings, degrees, in place of the machine's `encoder_noise_deg`.

    Returns:
        Commands and readings at each period of the controller, until half a second after the end.

    Raises:
        InputError: See `planner.replay`.
    """
    expect_plan(plan)
    used = machine_for(plan.problem.machine, machine)
    if noise_deg is not None:
        used = used.with_(encoder_noise_deg=noise_deg)
    hold = used.effects.get("control_period_s")
    tick = hold.value[0] if hold else DEFAULT_TICK_S
    is_homing = "until" in plan.notes
    run = replay(plan, used, [sample], seed, HomingRule() if is_homing else False, record_s=tick)
    t: Array = tick * np.arange(int(np.floor(run.t[-1] / tick + 1e-9)) + 1, dtype=np.float64)
    rows = np.searchsorted(run.t, t - 1e-9)
    read = run.measured[0, rows]
    u = np.where((t < plan.duration - 1e-9)[:, None], plan.trajectory.u(t), 0.0)
    if is_homing:
        rule = HomingRule().start(plan, used, run.numbers)
        u = np.array([rule(time, q[:, None])[0, :, 0] for time, q in zip(t, read, strict=True)])
    return Log(t=t, u=u, theta=read[:, 1:], source=f"{plan.method} on emulated machine {sample}")
