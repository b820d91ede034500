"""What a motion must keep: `requirement` (the limits), `places` (waypoints and obstacles).

They are judged in `planner.verification`, and planned for in each method.
"""
