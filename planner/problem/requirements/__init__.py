"""Conditions on a motion: `requirement` (the base classes), `motion_limits`, `places`,
`self_collision`, `ends`, `user_places` (limits and goals of user coordinates)."""
