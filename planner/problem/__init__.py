"""What is asked: a problem, its file, its requirements, and what no plan can beat.

In this order: `requirements`, `tables` (the file's keys), `asked` (what they ask, and where that
contradicts itself), `problem`, `reach` (of a goal that leaves joints free), `feasibility` (least
duration, window of travels), `nonholonomy`.
"""
