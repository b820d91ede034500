"""CasADi functions on NumPy arrays."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from planner.systems.base import Array


def evaluate(function: Any, q: Array) -> Array:
    """Call a CasADi function of one column on every point.

    Args:
        function: From a column of N to one dense column of M.
        q: Points, shape (…, N).

    Returns:
        Values, shape (…, M).
    """
    flat = q.reshape(-1, q.shape[-1])
    if flat.shape[0] == 0:
        return np.zeros((*q.shape[:-1], function.size1_out(0)))
    out = np.asarray(function(ca.DM(flat.T)))
    return out.T.reshape(*q.shape[:-1], function.size1_out(0))
