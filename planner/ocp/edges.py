"""Closeness to the edge of the chart's domain, as a term of the objective."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from planner.systems.base import TriangularSystem

NEAR = 0.05
"""Margin (sin squared of an angle, for the manipulator) at which closeness has fallen to 1/e."""


def edge_cost(system: TriangularSystem, weight: Any, q: Any) -> Any:
    """weight × Σ exp(−|margin|/NEAR) over the chart's margins at q: a smooth least margin.

    It grows towards an edge from either side, so that it needs no branch and is defined where a
    motion leaves the chart, too.
    """
    margins = system.chart_margins_expr(q, np.ones(system.size))
    return weight * sum(ca.exp(-ca.fabs(margin) / NEAR) for margin in margins)
