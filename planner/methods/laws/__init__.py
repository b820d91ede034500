"""Plans in closed form: the paper's polynomials, multirate inputs, sinusoids.

In this order: `law`, `polynomial`, `piecewise`, `legs`, `sinusoids`; `scores` and
`free_numbers` choose what is left open.
"""
