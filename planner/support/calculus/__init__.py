"""Functions of one variable, one subject per file.

`bernstein` (piecewise polynomials), `chebyshev` (polynomials by values at points, and series),
`extremes` (minima and zeros, also between samples), `inverse` (solves f(x) = y), `runge_kutta`.
"""
