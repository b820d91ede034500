"""What a motion must keep.

In this order: `requirement` (what each kind answers), `limits`, `places`, `self_collision`, `ends`.
"""
