"""The paper's figures and numbers, and the prototype fitted to its statements.

Read in this order: `reproduce`, `cases`, `numbers`; `calibrate`, `fit`.
"""
