"""Which collocation values are unknowns, and which follow from the others.

A collocation method is implicit, but where no coordinate's rate depends on that coordinate, not
even by way of others, its equations are solved one coordinate after the other: the manipulator's
θ₁ from the input, θ₂ from θ₁, and so on. Coordinates on a circle of dependencies are cut out of it:
their values at the collocation points stay unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from planner.ocp.augmented import Moved


@dataclass(frozen=True)
class Order:
    """In which order collocation values are computed.

    Attributes:
        sequence: All coordinates; each one's rate depends on earlier and on lifted ones only.
        lifted: Those whose collocation values are unknowns, increasing.
    """

    sequence: tuple[int, ...]
    lifted: tuple[int, ...]


def order(system: Moved) -> Order:
    """The order for a system, with few coordinates lifted."""
    needs = _dependencies(system)
    sequence: list[int] = []
    lifted: set[int] = set()
    while waiting := [i for i in range(system.size) if i not in sequence]:
        known = lifted | set(sequence)
        ready = [i for i in waiting if needs[i] <= known]
        sequence += ready
        if not ready:
            open_ends = [i for i in waiting if i not in lifted]
            itself = [i for i in open_ends if i in needs[i]]
            lifted.add((itself or open_ends)[0])
    return Order(tuple(sequence), tuple(sorted(lifted)))


def _dependencies(system: Moved) -> list[set[int]]:
    """For each coordinate, those that its rate depends on."""
    q, u = ca.SX.sym("q", system.size), ca.SX.sym("u", 2)
    rates = ca.vertcat(*system.rates_expr(q, u))
    rows, columns = ca.jacobian(rates, q).sparsity().get_triplet()
    out: list[set[int]] = [set() for _ in range(system.size)]
    for i, j in zip(rows, columns, strict=True):
        out[i].add(j)
    return out
