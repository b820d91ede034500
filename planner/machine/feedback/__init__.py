"""The tracker. Read `tracker` first, then `means` (of the machine), `course`, `reference`,
`run_up`, `estimate`, `programme`. `homing` is another controller."""
