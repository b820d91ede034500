"""Conditions on a motion: `requirement` (base classes), `motion_limits`, `places` (waypoints and
obstacles), `self_collision`, `ends` (start, goal, duration; user coordinates)."""
