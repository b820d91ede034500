"""What every method returns, and what can be read of it.

In this order: `curves` (piecewise polynomials), `trajectory` (curves in time), `retimed` and
`fastest_timing` (another clock on the same path), `clock` (the plan's time while a machine runs
it), `quadrature`, `measures` (effort, peaks, the chart's domain), `claims` (what is proven),
`plan`, `plan_file`, `samples` (as arrays and tables), `recorded` (what an arm did).
"""
