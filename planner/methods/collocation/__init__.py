"""Optimal plans in the coordinates themselves: one pipeline, one file a stage.

In this order: `method`, `pipeline`, then its stages `candidates`, `path`, `timing`, `refine`;
`task` is the problem on a transcription, `between_nodes` what an iterate does where no row
looks, `refusals` how it says no.
"""
