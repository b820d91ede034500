"""The best path in the chart: a global optimum with its gap, or the proof that there is none.

Read the files in this order: `method`, `paths`, `band`, `global_optimum`, `programme`.
"""
