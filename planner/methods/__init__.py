"""The methods that make plans.

In this order: `registry`, `refusal`, `laws`, `convex`, `collocation`, `desensitised`, `advice`.
"""
