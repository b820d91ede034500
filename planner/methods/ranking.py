"""Measures, other than the objective, by which a search may rank its motions.

Methods do not know the emulated machine, so `planner.solve` registers here how to rate plans on it.
"""

from __future__ import annotations

from collections.abc import Callable

from planner.plan.plan import Plan

MEASURES: dict[str, Callable[[Plan], float]] = {}
"""Functions from a plan to a measure to minimise, by the value of the option `criterion`."""
