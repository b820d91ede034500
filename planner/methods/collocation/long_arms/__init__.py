"""Paths for arms where all first guesses fail: `ladder`, `bridges`, `exact_motion`."""
