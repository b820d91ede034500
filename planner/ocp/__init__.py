"""What direct collocation is made of.

In reading order: `scheme`, `form`, `mesh`, `layout`, `stage` (costs and labelled constraints of one
interval), `assembly` (the whole, with derivatives), `transcription`, `objective`, `bounds`,
`guess`, `solver`, `curve`, `resimulation`, `task`, `search`, `timing`, `polish`, `violations`,
`refusal`. The method that uses them is `planner.methods.collocation`.
"""
