"""The methods that make plans.

In this order: `registry` (which there are, how one comes in), `foreign` (those of other packages),
`keeping` (what each promises to keep), `ranking` (by what a search chooses among its motions),
`spec` (a method with options as text), `refusal` (how they say no, and which changes would help),
`judgement` (a plan verified, or refused), `stay` (nothing to do), `laws` (closed form), `convex`,
`collocation`, `desensitised`; `motions` (that lead to no goal: excitation and homing).
"""
