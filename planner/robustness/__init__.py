"""What errors do to a plan.

In this order: `sensitivity`, `machine_sensitivity`, `budget` with `sobol`, `trade_off`.
"""
