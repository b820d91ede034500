"""Many methods on the same machines.

In this order: `compare` runs them, `rows` says what is known of each, `comparison` is the result;
`headline` says which plan to take; `differences` sets two plans against each other.
"""
