"""The tables of a problem file, validated.

In this order: `problem_file` (what all share), the systems in `arms`, `vehicles`, `custom`;
`machine_effects`, `method_options`; `kinds` has one entry per system and loads plugins.
"""
