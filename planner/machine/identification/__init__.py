"""A machine from recorded runs.

In this order: `parameters` (what is looked for, and which machine they make), `model` (a log's
commands on many machines at once), `fit` (least squares, and how sure it is), `diagnosis` (which
mistake in a run explains that it is not of this arm), `identify` (which others call), `emulated`
(logs of an arm that there is not).
"""
