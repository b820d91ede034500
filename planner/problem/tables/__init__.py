"""The tables of a problem file, checked.

In this order: `problem_file` (what all share), the systems in `arms`, `vehicles`, `custom`;
`machine_effects`, `method_options`; `kinds` has one entry per system and calls what other packages
bring.
"""
