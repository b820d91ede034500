"""Commands that allow for the machine: `shaping`, and then `aim`.

The counterpart of `planner.machine.feedback` without sensors. Nothing here plans: what goes in is a
plan and a machine, what comes out are commands, and the motion that they make; `aim` is told how to
plan.
"""
