"""Many problems, many settings: described in one file, run in parallel, kept in one database.

In this order: `sweep_file`, `description`, `points`, `case`, `run`, `pools`, `worker`, `store`,
`results`.
"""
