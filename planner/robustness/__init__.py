"""How errors affect a plan.

Read in this order: `sensitivity` (to first order), `sensitivities` (of several plans),
`machine_sensitivity` (by replays), `budget` with `sobol` (how much error each effect causes),
`trade_off` with `trade_off_points` (what a lower sensitivity costs).
"""
