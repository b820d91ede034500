"""The emulated machine, the tracker, replays.

In this order: `machine`, `commands`, `servos`, `disk_chain`, `bodies`, `march`, `stepwise`,
`simulate`, `feedback`, `replay`.
"""
