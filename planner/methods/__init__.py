"""The methods that make plans.

Read the files in this order: `registry` (the list of methods, how to add one, and a method with
options as text), `keeping` (the requirements that each method guarantees), `refusal` (refusals, and
changes that would help), `judgement` (verifies a method's plan or refuses it), `laws` (closed
form), `convex`, `collocation`, `desensitised`; `motions` (motions without a goal: excitation,
homing and seating).
"""
