"""The emulated machine, the tracker, commands that allow for the machine, replays.

In this order: `machine` (which effects, drawn how), then along the signal: `commands`, `servos`,
`friction` (contacts), `disk_chain` (backlash, shafts), `bodies` and `march` (with inertia);
`stepwise` and `compiled` step through them in NumPy and in C; `simulate`, `closed_loop` with
`feedback` (the tracker), `limits` (what machines break), and `replay`, which is what others call.
`feedforward` shapes commands for a machine; `friction` has the law of the contacts, and what a plan
asks of them; `identification` finds a machine from recorded runs.
"""
