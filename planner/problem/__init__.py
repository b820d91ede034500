"""What is asked: a problem, its file, its requirements, and what no plan can beat.

In this order: `requirements`, `tables` (the file's keys), `problem` (and what contradicts itself),
`feasibility` (least duration, window of travels), `nonholonomy`.
"""
