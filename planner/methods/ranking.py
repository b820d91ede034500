"""By what else than its objective a path may be chosen: measures that `planner.solve` hands in.

Methods know no machine; who does says here what a plan is worth on it.
"""

from __future__ import annotations

from collections.abc import Callable

from planner.plan.plan import Plan

MEASURES: dict[str, Callable[[Plan], float]] = {}
"""From the word of the option `criterion` to what is to be least."""
