"""The path that is best of a class in the chart, proven; or the proof that the class has none.

Paths are geometry: dz₂/dz₁ constant (or continuous and linear) on equal pieces of the travel. For
n ≤ 3 joints the chart's domain is convex in them, so a given travel makes a convex programme: a
global optimum with a gap, or a certificate that there is no such path. For longer chains and other
systems the same programme without the domain is a relaxation, whose optimum is global where it
happens to stay inside.

Reading order: `frame` (z as affine functions of the coefficients), `band` (the convex domain, and
the proof between the nodes), `programme` (the optimum and its certificate over linear rows), `cuts`
(cutting planes at one travel), `search` (free travel).
"""
