"""The plan that every method returns, and everything that is computed from it.

In this order: `curves` (piecewise polynomials), `trajectory` (curves in time), `retimed` and
`fastest_timing` (the same path with another timing), `clock` (a plan's time while a machine runs
it), `quadrature`, `measures` (effort, peaks, the chart's domain), `claims` (what is proven),
`plan`, `spec` (labels of plans), `plan_file`, `samples` (arrays and tables), `recorded` (recorded
runs of an arm).
"""
