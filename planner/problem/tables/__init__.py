"""The tables of a problem file, checked.

In this order: `problem_file`, `arms`, `vehicles`, `custom`, `machine_effects`,
`method_options`; `kinds` has one entry a system, `plugins` is how other packages add theirs.
"""
