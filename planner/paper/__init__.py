"""The paper's figures and numbers, and the prototype fitted to what it says.

In this order: `reproduce`, `cases`, `numbers`; `calibrate`, `statements`, `fit`.
"""
