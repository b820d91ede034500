"""The problem as a nonlinear programme.

In this order: `form`, `augmented` (a motion with its response to errors), `interval`,
`unknowns`, `objective`, `bounds`, `derivatives`, `transcription`.
"""
