"""Optimal plans in chained coordinates at constant v₁, where the dynamics are linear.

For n ≤ 3 joints the chart's domain is convex too, so a fixed travel gives a convex programme: a
global optimum of its class with a gap, or a certificate that the class holds no plan. Elsewhere
the same programme is solved in succession about the last path, and the result is a local optimum.

Reading order: `shape` (the class of v₂), `frame` (z as affine functions of its coefficients),
`band` (the convex domain), `between` (proof between the nodes), `quadratic` (the programme and its
certificate), `cuts` (cutting planes), `objectives`, `search` (free travel), then `requirements`,
`successive` and `seed` for what is not convex.
"""
