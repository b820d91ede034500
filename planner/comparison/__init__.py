"""Compare many methods on the same machines.

Read in this order: `compare` runs the methods; `rows` has the results of one method; `comparison`
has the results of all; `headline` recommends a plan; `differences` compares pairs of plans.
"""
