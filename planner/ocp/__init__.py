"""What direct collocation is made of.

In reading order: `scheme`, `mesh`, `augmented`, `form`, `order` (which values are unknowns),
`layout`, `stage` (one interval as symbols: where it leads, costs, labelled rows), `chain` (its
derivatives), `interval` (its functions), `assembly` (the whole), `transcription`, `objective`,
`bounds`, `backends` (which solver, barrier and patience: one table), `compiled`,
`solver`, `curve`, `resimulation`, `task`, `look`. Then the stages of the search: `guess`,
`search` (paths), `timing`, `polish`, `ladder`, and `pipeline`, the loop that goes through them;
at last `best`. The method that uses them is `planner.methods.collocation`.
"""
