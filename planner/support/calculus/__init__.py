"""Functions of one variable, one subject a file.

`bernstein` (piecewise polynomials), `chebyshev` (the same by their values at points, and series),
`extremes` (least values and zeros, between samples too), `inverse` (where f(x) = y), `runge_kutta`.
"""
