"""Sliders in a notebook, and a figure that follows them.

Read in this order: `explore`, `widget`, `state`, `control`, `controls`, `screen`, `outcome`,
`picture`.
"""
