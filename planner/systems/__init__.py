"""The systems that the planner steers: the triangular class, its members, and their chart.

In this order: `triangular_system`, `chained_form`, `manipulator`, `ball_gear`, `vehicles`, `coin`
(its user coordinates are not the triangular ones), `expressions`, `user_map` and `custom` (systems
given as text), `linearisation`, `controllability`.
"""
