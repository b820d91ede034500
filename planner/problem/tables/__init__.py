"""The tables of a problem file, validated.

Modules in reading order: `problem_file` (tables that all systems share); `arms`, `vehicles` and
`custom` (tables of one kind of system); `machine_effects`, `method_options`; `kinds` (the list of
all kinds of systems, and plugins).
"""
