"""General-purpose code that knows nothing about robots.

Read `arrays` and `package` first. Read the rest when you need it: `files`, `tables` and
`user_tables` (check and print what users wrote), `deadline`, `progress` and `interrupts` (used
while a search runs), `calculus`, `statistics`, `casadi`, `compiled_calls`, `solver_calls`.
"""
