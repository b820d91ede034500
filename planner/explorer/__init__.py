"""The explorer: sliders in a notebook, and figures of the plan that follow them.

Read in this order: `explore`, `widget`, `state`, `control`, `controls`, `screen` and its
picture, `outcome`.
"""
