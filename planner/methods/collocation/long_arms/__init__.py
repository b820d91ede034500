"""Paths for arms where no guess leads anywhere: `ladder`, `bridges`, `exact_motion`."""
