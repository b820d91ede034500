"""The systems that the planner steers: triangular systems and their transformation.

Modules in reading order: `triangular_system` (base classes), `chained_form` (the transformation of
Theorem 1), the systems in `manipulator`, `ball_gear`, `vehicles` and `coin`; `expressions`,
`user_map` and `custom` (systems given as text); `linearisation` and `controllability` (analyses).
"""
