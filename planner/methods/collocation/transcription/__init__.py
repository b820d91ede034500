"""The problem as a nonlinear programme.

In this order: `form` (and the objective), `augmented` (a motion with its response to errors),
`interval`, `unknowns`, `bounds`, `derivatives`, `transcription`.
"""
