"""What direct collocation is made of.

In reading order: `scheme`, `mesh`, `form`, `order` (which collocation values are unknowns),
`layout`, `stage` (one interval as symbols: where it leads, costs, labelled rows), `chain` (its
derivatives), `interval` (its functions), `assembly` (the whole), `transcription`, `objective`,
`bounds`, `guess`, `backends` (IPOPT, Fatrop), `newton`, `compiled`, `solver`, `curve`,
`resimulation`, `task`, `look`, `search`, `timing`, `polish`, `violations`, `refusal`. The
method that uses them is `planner.methods.collocation`.
"""
