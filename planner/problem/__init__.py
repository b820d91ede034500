"""The task: a problem, its file, its requirements, and bounds that no plan can beat.

In this order: `requirements`, `tables` (the keys of the file), `conditions` (requirements from the
tables, contradictions), `problem`, `reach` (configurations at a goal that leaves joints free),
`feasibility` (least duration, window of travels), `free_space` (paths between obstacles),
`nonholonomy`.
"""
