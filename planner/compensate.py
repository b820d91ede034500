"""Plans that know the hardware: inputs that allow for the systematic errors of a machine.

Backlash, shaft torsion, creep and lag are much the same on every machine of a kind, so most of what
they do to a plan can be taken off without any sensor. See `planner.machine.feedforward` for how.
"""

from __future__ import annotations

from typing import Any

from planner.machine.machine import Machine
from planner.plan.plan import Plan, refuse_inexecutable
from planner.problem.problem import Problem
from planner.problem.tables.compensation import CompensationTable
from planner.solve import compensated, solve
from planner.support.user_tables import parse


def compensate(
    plan: Plan | Problem,
    machine: Machine | str | None = None,
    *,
    method: str = "collocation",
    **options: Any,
) -> Plan:
    """Change a plan's inputs so that the nominal machine makes its motion and ends at its goal.

    The nominal machine has every spread off and every systematic effect on. It is asked in
    whichever fidelity it has. No input exceeds the plan's limits.

    Args:
        plan: A plan of an arm with friction disks (`system.kind = "manipulator"`), or a problem of
            one, for which a plan is made first. A compensated plan is compensated anew.
        machine: The machine, or the name of a preset; the problem's `[machine]` table when left
            out.
        method: By which a problem is planned.
        **options: Override the problem's `[compensation]` table, key by key: `aim`, `preparation`,
            `back_off`, `lag`, `gearheads`.

    Returns:
        A verified plan. Its inputs are what the motors are commanded, from the beginning of the
        preparatory motion, `lead_s` seconds before the plan starts, to `tail_s` seconds after it.
        Its q(t) is the motion predicted on the nominal machine, by which it is verified: goal (to
        0.05 degrees), limits and places at all times. `compensates` is the plan it was made from,
        and what replays measure errors against.

    Raises:
        InputError: If the plan is not executable, the system is another, or an option is wrong.
        NoPlanError: If it cannot be compensated; the message says why.
    """
    if isinstance(plan, Problem):
        plain = plan.changed({"compensation.on": False}) if plan.compensation.on else plan
        plan = solve(plain, method)
    refuse_inexecutable(plan)
    plan = plan.compensates or plan
    own = plan.problem.compensation.model_dump(exclude_unset=True)
    table = parse(CompensationTable, {**own, **options, "on": True}, "options of compensate")
    return compensated(plan, machine, table)[0]
