"""Many problems, many settings: described in one file, run in parallel, kept in one database.

In this order: `sweep_file`, `description`, `case` (one run, its columns and its key),
`run`, `pools` (where cases run), `store`, `results`; `design` compares designs of the mechanism.
"""
