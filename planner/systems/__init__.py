"""What is steered: the triangular class, its members, their chart, what can be said of them.

In this order: `triangular_system`, `chained_form`, `manipulator`, `ball_gear`, `vehicles`,
`coin` (triangular in other coordinates than its user's), `expressions`, `user_map`
and `custom` (systems given as text), `linearisation`, `controllability`.
"""
