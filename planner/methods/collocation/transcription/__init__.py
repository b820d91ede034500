"""The transcription of a problem to a nonlinear programme.

Read the files in this order: `form` (and the objective), `augmented` (a motion with its response to
errors), `follower` (joints with lost motion), `interval`, `unknowns`, `bounds`, `transcription`
(with the derivatives).
"""
