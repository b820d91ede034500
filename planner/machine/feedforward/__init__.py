"""Commands that allow for the machine: `legs`, `shaping`, `prediction`, `variants`, `correction`,
`follow`, `advice`.

The counterpart of `planner.machine.feedback` without sensors. Nothing here plans: what goes in is a
plan and a machine, what comes out are commands, and the motion that they make.
"""
