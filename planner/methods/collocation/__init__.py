"""Optimal plans in joint coordinates: one pipeline, with one file for each stage.

Read the files in this order: `pipeline` (the search), `best` (the candidates and their refinement),
`method` (the plan of the best candidate), then the stages: `guesses` (first guesses), `path`
(shortest paths and their timing), `route_paths` (selects the paths to time). `task` is the problem
on a transcription, solved by one of `solvers`; `between_nodes` checks an iterate between the nodes;
`refusals` words the refusals. `machine_end` makes plans that end at the goal on the nominal machine
too. The folder `transcription` makes the nonlinear programme; `discs`
finds motions among obstacles, `long_arms` paths for arms where all guesses fail.
"""
