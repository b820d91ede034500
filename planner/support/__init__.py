"""What has nothing to do with robots.

Read first: `arrays`, `package`. The rest when something asks for it: `files`, `tables` and
`user_tables` (what users wrote, checked and shown), `deadline`, `progress`, `interrupts` (while a
search runs), `calculus`, `statistics`, `casadi`, `compiled_calls`, `solver_calls`.
"""
