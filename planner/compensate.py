"""Compensated plans: inputs that correct the systematic errors of a machine in advance.

Backlash, shaft torsion, creep and lag are similar on all machines of a kind, so most of their
effect can be compensated without sensors. See `planner.machine.feedforward`.
"""

from __future__ import annotations

from typing import Any

from planner.machine.machine import Machine
from planner.plan.plan import Plan, refuse_inexecutable
from planner.problem.problem import Problem
from planner.problem.tables.problem_file import CompensationTable
from planner.solve import compensate_plan, solve
from planner.support.user_tables import parse


def compensate(
    plan: Plan | Problem,
    machine: Machine | str | None = None,
    *,
    method: str = "collocation",
    **options: Any,
) -> Plan:
    """Change a plan's inputs so that the nominal machine follows its motion and ends at the goal.

    The nominal machine has all systematic effects and no random spread. It is simulated in its own
    fidelity (quasi-static or dynamic). No input exceeds the plan's limits.

    Args:
        plan: A plan of an arm with friction disks (`system.kind = "manipulator"`), or a problem,
            which is planned first. Of a compensated plan, the original plan is compensated again.
        machine: The machine, or the name of a preset. By default the problem's `[machine]` table.
        method: The method that plans a problem.
        **options: Override the problem's `[compensation]` table, key by key: `aim`, `preparation`,
            `take_up`, `correction`, `back_off`, `lag`, `gearheads`.

    Returns:
        A verified plan. Its inputs are the motor commands. They begin with a preparatory motion,
        `lead_s` seconds before the original plan starts, pause it where its drive turns back, and
        end `tail_s` seconds after it; `clock` maps their time to that of the plan. Its q(t) is the
        motion predicted on the nominal machine at the ends of the ticks, and straight between them.
        The predicted motion is verified: goal (to 0.05 degrees), limits, waypoints and obstacles at
        all times. `compensates` is the original plan, verified too; replays measure errors against
        it, with its clock held. Where the nominal machine is predicted to leave the path by no less
        than with the plan as it is, an `InputWarning` gives both figures.

    Raises:
        InputError: If the plan is not executable, the system is not a manipulator, or an option is
            wrong.
        NoPlanError: If it cannot be compensated; the message says why.
    """
    if isinstance(plan, Problem):
        plain = plan.changed({"compensation.on": False}) if plan.compensation.on else plan
        plan = solve(plain, method)
    refuse_inexecutable(plan)
    plan = plan.compensates or plan
    given = plan.problem.compensation.model_dump(exclude_unset=True)
    table = parse(CompensationTable, {**given, **options, "on": True}, "options of compensate")
    return compensate_plan(plan, machine, table)[0]
