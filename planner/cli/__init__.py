"""The command `planner`: `app` starts it, each other file holds the commands of one subject.

Commands: `start` (new, methods, systems, schema), `plan` (plan, check), `compare` (compare,
budget), `sensitivity`, `sweep`, `files` (export, animate, report), `paper`. What they share:
`arguments` (options), `output` (what is printed). What `planner new` writes: heads/KIND.toml.
"""
