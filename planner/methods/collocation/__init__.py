"""Optimal plans in the coordinates themselves: one pipeline, one file a stage.

In this order: `method`, `pipeline`, then its stages: `candidates` (first guesses), `path` (the
shortest, then the motion asked for), `refine` (finer mesh, limits between nodes). `task` is the
problem on a transcription, `between_nodes` what an iterate does where no row looks, `refusals` how
it says no. Below: `transcription` and `solvers` make and solve the programme, `long_arms` is for
arms where no guess leads anywhere.
"""
