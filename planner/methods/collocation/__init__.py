"""Optimal plans in the coordinates themselves: one pipeline, one file a stage.

In this order: `method`, `pipeline` (what it has found so far is `best`), then its stages:
`candidates` (first guesses), `path` (the shortest, then the motion asked for; among discs by
`thin_discs`), `route_paths` (which of them are timed), `refine` (finer mesh, limits between nodes).
`task` is the problem on a transcription, solved by one of `solvers`, `between_nodes` what an
iterate does where no row looks, `refusals` how it says no. Below: `transcription` makes the
programme, `long_arms` is for arms where no guess leads anywhere.
"""
