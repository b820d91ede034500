"""How far the links of a planar arm are from a disc, as expressions for the transcription."""

from __future__ import annotations

from typing import Any

import casadi as ca

from planner.systems.triangular_system import TriangularSystem


def link_count(system: TriangularSystem) -> int:
    """Number of links; zero for what is not an arm."""
    return len(getattr(system, "link_lengths", ()))


def clearances(system: Any, q: Any, disc: Any) -> list[Any]:
    """One expression a link, that of the distance from the disc to first order near contact.

    With a link from P in direction e, length l, and the centre C, the nearest point is at
    t = clip((C − P)·e, 0, l), and the squared distance |P − C|² + 2t (P − C)·e + t². What is
    returned, (distance² − radius²)/(2 radius), is smooth where the distance is zero and has the
    distance's own slope at contact.

    Args:
        system: An arm, with `link_lengths`.
        q: Coordinates, a CasADi vector (N); the angle of link i is θ₁ + … + θᵢ.
        disc: Centre and radius, a CasADi vector (3), metres.
    """
    offset = [-disc[0], -disc[1]]
    heading: Any = 0.0
    out = []
    for i, length in enumerate(system.link_lengths, 1):
        heading = heading + q[i]
        c, s = ca.cos(heading), ca.sin(heading)
        along = offset[0] * c + offset[1] * s
        t = ca.fmin(ca.fmax(-along, 0.0), length)
        square = offset[0] ** 2 + offset[1] ** 2 + 2 * t * along + t**2
        out.append((square - disc[2] ** 2) / (2 * disc[2]))
        offset = [offset[0] + length * c, offset[1] + length * s]
    return out
