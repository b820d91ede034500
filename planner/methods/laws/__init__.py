"""Plans in closed form: the paper's polynomials, multirate inputs, sinusoids.

Read the files in this order: `law`, `polynomial`, `piecewise`, `legs`, `sinusoids`; `scores` and
`free_numbers` choose the free numbers.
"""
