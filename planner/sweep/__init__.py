"""Sweeps: many variants of a problem, described in one file, run in parallel, saved in a database.

Read in this order: `sweep_file`, `description`, `case` (one run, its columns and its key), `run`,
`pools` and `cluster` (where cases run), `store`, `clients`, `results`; `design` compares designs of
the mechanism.
"""
