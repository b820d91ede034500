"""The linear-quadratic regulator along the course: the tracker's law where no limit binds.

The state is ξ = (δq, w, ε): deviation from the course, the correction of the period before, and the
rates' relative errors, which stay as they are. The cost of a correction v over periods k … K−1 is

    Σ (δqᵀ Q δq + vᵀ R v) τ + (v − w)ᵀ S (v − w)  +  δq_Kᵀ G δq_K

(H. Kwakernaak, R. Sivan, *Linear Optimal Control Systems*, 1972, section 6.4). Errors of the path
coordinate cost nothing where it is the disk's angle: nobody sees it, and play shifts it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.feedback.reference import Reference
from planner.systems.base import Array


@dataclass(frozen=True, eq=False)
class Weights:
    """The cost.

    Attributes:
        path: Diagonal of Q for each period's start, (K, N).
        goal: Diagonal of G, (N,).
        size: Diagonal of R for each period, (K, 2).
        step: Diagonal of S, (2,).
    """

    path: Array
    goal: Array
    size: Array
    step: Array


@dataclass(frozen=True, eq=False)
class Regulator:
    """The optimal law without limits, v = −gain ξ, and what deviating from it costs.

    Attributes:
        F: ξₖ₊₁ = Fₖ ξₖ + Gₖ v, (K, n, n) with n = N + 2 + N − 2.
        G: The same, (K, n, 2).
        gain: (K, 2, n).
        root: (K, 2, 2): correcting by −gain ξ + root c costs |c|² more than the optimum.
    """

    F: Array
    G: Array
    gain: Array
    root: Array


def regulator(ref: Reference, weights: Weights) -> Regulator:
    """Solve the Riccati recursion backwards."""
    count, size = ref.A.shape[:2]
    F, G = _augmented(ref)
    n = F.shape[-1]
    move = slice(size, size + 2)
    S = np.diag(weights.step)
    cost = np.zeros((n, n))
    cost[range(size), range(size)] = weights.goal
    gain, root = np.empty((count, 2, n)), np.empty((count, 2, 2))
    for k in range(count - 1, -1, -1):
        R = np.diag(weights.size[k]) * ref.timing.period
        curvature = R + S + G[k].T @ cost @ G[k]
        cross = G[k].T @ cost @ F[k]
        cross[:, move] -= S
        gain[k] = np.linalg.solve(curvature, cross)
        root[k] = np.linalg.inv(np.linalg.cholesky(curvature)).T
        cost = F[k].T @ cost @ F[k] - cross.T @ gain[k]
        cost[range(size), range(size)] += weights.path[k] * ref.timing.period
        cost[move, move] += S
        cost = (cost + cost.T) / 2
    return Regulator(F, G, gain, root)


def _augmented(ref: Reference) -> tuple[Array, Array]:
    count, size = ref.A.shape[:2]
    n = size + 2 + ref.E.shape[-1]
    F = np.zeros((count, n, n))
    F[:, :size, :size] = ref.A
    F[:, :size, size : size + 2] = ref.before
    F[:, :size, size + 2 :] = ref.E
    F[:, range(size + 2, n), range(size + 2, n)] = 1.0
    G = np.zeros((count, n, 2))
    G[:, :size] = ref.B
    G[:, [size, size + 1], [0, 1]] = 1.0
    return F, G
