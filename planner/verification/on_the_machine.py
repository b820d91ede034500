"""The motion by which a compensated plan is judged: that of the nominal machine, found anew.

Of every other plan the motion is the integral of its input. The inputs of a compensated plan allow
for lost motion and lag, so that by the kinematics alone they lead elsewhere.
"""

from __future__ import annotations

import numpy as np

from planner.machine.feedforward.aim import predicted
from planner.machine.machine import Machine
from planner.plan.plan import Plan
from planner.plan.quadrature import POINTS, Cells, Motion
from planner.support.arrays import Array


def motion_on_machine(plan: Plan) -> tuple[Motion, Array]:
    """What the nominal machine makes of a compensated plan, and where it rests at last, (N,).

    The plan's own q(t) is taken for the motion; its gap says how far it is from what was found
    anew.
    """
    assert plan.compensation is not None
    found = predicted(plan, Machine.from_table(plan.compensation.machine))
    gaps = np.max(np.abs(found.q - plan.q(plan.t)), axis=-1)
    worst = int(np.argmax(gaps))
    cells = Cells.of(plan.t)
    q, u = plan.trajectory.inside(cells.piece, cells.fractions(POINTS))
    motion = Motion(cells, q, u, 0.0, (float(gaps[worst]), float(plan.t[worst])))
    return motion, found.end
