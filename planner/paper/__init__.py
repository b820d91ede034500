"""The paper's figures and numbers, and the prototype fitted to its statements.

Read in this order: `reproduce`, `cases`, `numbers`, `detours`; `calibrate`, `fit`. What the paper
states, its misprints and the texts of both pages stand in `statements.toml`, `reproduce.toml` and
`calibrate.md`.
"""
