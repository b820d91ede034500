"""Sliders in a notebook, and a picture that follows them.

In this order: `explore`, `widget`, `state`, `control`, `controls`, `screen`, `outcome`, `picture`.
"""
