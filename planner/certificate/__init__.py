"""Limits proven over whole intervals, not sampled.

Reading order: `series` (matrices), `model` (polynomials with proven remainders), `balls` (functions
enclosed at points and on ellipses), `evaluate` (expressions on balls), `cells`, `composed` (retimed
paths), `motion` (the true motion enclosed), `sources` (a plan's inputs), `least` (bounds from both
sides), `requirements`, `places`, `certify`.
"""

from planner.certificate.certify import certify

__all__ = ["certify"]
