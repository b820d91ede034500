"""The task: a problem, its file, its requirements, and bounds that hold for every plan.

Modules in reading order: `requirements` (conditions on a motion), `tables` (the keys of a problem
file), `conditions` (builds requirements from the tables and finds contradictions), `problem`,
`reach` (joint angles at a goal that leaves joints free), `feasibility` (least duration, possible
travels), `free_space` (paths between obstacles), `nonholonomy` (controllability), `settings` (what
a problem changes in its file).
"""
