"""Commands that allow for the machine: `legs`, `shaping`, `prediction`, `variants`, `correction`,
`follow`, `advice`.

It is the counterpart of `planner.machine.feedback` without sensors. It does not plan: from a plan
and a machine it computes commands and the motion that they produce.
"""
