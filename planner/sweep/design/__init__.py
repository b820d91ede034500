"""Designs of the mechanism against a set of tasks.

In this order: `geometry` (one mechanism, and whether it can be built), `figures` (what compares
them: table, Pareto front, recommendation), `design_file` (mechanisms and tasks of a study),
`result` (table, picture, folder), `study` (the whole study, a sweep).
"""
