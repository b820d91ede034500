"""Limits proven over whole intervals, not sampled.

Reading order: `series` (polynomials), `model` (polynomials with proven remainders), `functions`,
`evaluate` (expressions on models), `cells`, `composed` (retimed paths), `sources` (a plan's
inputs), `motion` (the true motion enclosed), `least` (bounds from both sides), `requirements`,
`places`, `certify`.
"""

from planner.certificate.certify import certify

__all__ = ["certify"]
