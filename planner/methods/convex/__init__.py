"""The best path in the chart: a global optimum with its gap, or a proof that no path exists.

Read the files in this order: `method`, `paths`, `band`, `global_optimum`, `programme`.
"""
