"""What a motion must keep: `requirement` (what each kind answers), `limits`, `places`.

The judge in `planner.verification` asks limits by their class; methods plan for them by name.
"""
