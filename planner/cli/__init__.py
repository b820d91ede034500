"""The command `planner`: `app` starts it, each other file holds the commands of one subject.

Commands: `start` (new, methods, systems, schema), `plan`, `check`, `compare` (compare, budget),
`sensitivity`, `sweep` (sweep, design), `bench` (motion, log, identify), `files` (export, animate,
report), `paper`. All use `arguments` (options) and `output` (printing).
"""
