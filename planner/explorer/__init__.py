"""Sliders in a notebook, and a picture that follows them.

In this order: `explore`, `widget`, `worker`, `state`, `control`, `controls`, `screen`, `outcome`,
`picture`.
"""
