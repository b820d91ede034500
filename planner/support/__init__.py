"""What has nothing to do with robots: arrays, files, text, time, progress, statistics, calls of
solvers.

Read first: `arrays`, `package`, `deadline`, `progress`; the rest when something asks for it.
"""
