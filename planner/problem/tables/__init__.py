"""The tables of a problem file, checked.

In this order: `problem_file` (what all share), `limits`, the systems in `arms`, `vehicles`,
`custom`; `machine_effects`, `compensation`, `method_options`; `kinds` has one entry per system,
`plugins` calls what other packages bring.
"""
