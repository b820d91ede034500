"""What is asked: a problem, its file, its requirements, and what no plan can beat.

In this order: `requirements`, `tables` (keys of the file), `conditions` (what they ask, and where
that contradicts itself), `problem`, `reach` (of a goal that leaves joints free), `feasibility`
(least duration, window of travels), `free_space` (ways between obstacles), `nonholonomy`.
"""
