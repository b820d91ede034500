"""Designs of the mechanism against a set of tasks.

In this order: `geometry` (one mechanism, and whether it can be built), `design_file` (mechanisms
and tasks of a study), `figures` (criteria, Pareto front, recommendation), `result` (table, picture,
folder), `study` (the whole study, on the sweep engine).
"""
