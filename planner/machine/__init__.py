"""The emulated machine, the tracker, commands that allow for the machine, replays.

Read the files in this order: `machine` (the effects and how they are drawn), then along the signal
`commands`, `servos`, `friction` (contacts), `disk_chain` (backlash, shafts), `bodies` and `march`
(with inertia). `stepwise` and `compiled` simulate them in NumPy and in C. Then `simulate`,
`closed_loop` with `feedback` (the tracker), `limits` (limits that machines break), and `replay`,
which other packages call. `feedforward` shapes commands for a machine; `friction` has the law of
the contacts and the torques that a plan needs of them; `identification` fits a machine to recorded
runs.
"""
