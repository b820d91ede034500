"""The tables of a problem file, checked.

In this order: `problem_file`, `limits`, `arms`, `vehicles`, `custom`, `machine_effects`,
`method_options`, `kinds`.
"""
