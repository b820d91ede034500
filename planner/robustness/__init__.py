"""What errors do to a plan.

In this order: `sensitivity` (to first order), `sensitivities` (of several plans),
`machine_sensitivity` (by replays), `budget` with `sobol` (which effect costs what), `trade_off`
with `trade_off_axis` and `trade_off_points` (what less of it costs).
"""
