"""Compare designs of the mechanism on a set of tasks.

Read in this order: `geometry` (one mechanism, and whether it can be built), `figures` (the figures
that compare designs, Pareto front, recommendation), `design_file` (mechanisms and tasks of a
study), `result` (runs the study as a sweep; table, picture, folder).
"""
