"""Identify a machine from recorded runs.

Read the files in this order: `parameters` (the fitted parameters and the machine they describe),
`model` (simulates a log's commands on many machines at once), `fit` (least squares with
uncertainty), `diagnosis` (finds the mistake in a run that does not fit the arm), `identify` (which
other packages call), `band` (where a run leaves the band of the machines), `emulated` (logs of
emulated arms).
"""
