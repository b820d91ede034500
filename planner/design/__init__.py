"""Designs of the mechanism against a set of tasks.

In this order: `geometry` (one mechanism, and whether it can be built), `design_file` (which ones
are asked for, for which tasks), `figures` (what they are judged by, the front, which one to take),
`result` (what was found), `study` (all of it, on the sweep engine).
"""
