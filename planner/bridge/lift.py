"""A path of an arm from a path of the arm without its first joint.

With joint 1 at rest at θ₁ the drive moves all joints after the second, and φ, cosθ₁ times as fast
as it does in the shorter arm, and θ₂ cos³θ₁ k₂ times as fast as u₁. So driving at two angles of
joint 1 in turn moves the shorter arm by any drive and any turn of its own first joint, whatever
their ratio: along any path of the shorter arm, as closely as the stretches are short.

Sources: the reduction of one stage at a time is that of Lafferriere and Sussmann, A differential
geometric approach to motion planning (Nonholonomic Motion Planning, Kluwer 1993).
"""

from __future__ import annotations

import numpy as np

from planner.bridge.closing import Chain, Ends, Index
from planner.bridge.piece import ends as ends_of
from planner.systems.base import Array
from planner.systems.manipulator import Manipulator

SWING = np.deg2rad(60.0)
"""The other angle of joint 1, beside zero: near it the sum of drives and turns is least."""

LONGEST, HALVINGS = 0.8, 8
"""Longest stretch, turn and drive added, rad, and times that it may be halved."""

STILL = 1e-9
"""Turns and drives, rad, that are left out."""


def lifted(system: Manipulator, path: Chain, ends: Ends, gap: float) -> Chain:
    """The path of joints 2 … n, made by all of them; with gaps.

    Args:
        system: The arm, n ≥ 3.
        path: Of `system.shorter()`.
        ends: Of the arm.
        gap: Largest gap, rad, that is left, and four times what limits may be broken by; where
            either is larger, stretches are cut in half.
    """
    known = np.append(0.0, np.cumsum(np.sum(np.abs(path.u), axis=1)))
    edges = np.linspace(0.0, known[-1], 1 + max(1, int(np.ceil(known[-1] / LONGEST))))
    for _ in range(HALVINGS):
        chain, stretch = _along(system, path, known, ends, edges)
        missed = np.max(np.abs(chain.gap), axis=1)
        over = np.max(np.abs(chain.q[1:] - chain.gap) - ends.limit, axis=1)
        wide = np.zeros(len(edges) - 1, dtype=bool)
        np.logical_or.at(wide, stretch, np.maximum(missed, 4 * over) > gap)
        if not np.any(wide):
            break
        edges = np.sort(np.concatenate([edges, (edges[:-1] + edges[1:])[wide] / 2]))
    return chain


def _along(
    system: Manipulator, path: Chain, known: Array, ends: Ends, edges: Array
) -> tuple[Chain, Index]:
    """The chain for stretches between these lengths of path, and the stretch of each piece.

    `known` are the lengths at the path's own nodes.
    """
    places, moves = _stretches(system.shorter(), path, known, edges)
    u, before = _drives(system, moves, ends)
    q = np.insert(places, 1, before, axis=1)
    last = np.insert(places[-1], 1, ends.goal[1])
    return _pieces(system, q, u, last)


def _stretches(short: Manipulator, path: Chain, known: Array, edges: Array) -> tuple[Array, Array]:
    """Places between the stretches, (S+1, n), drive and turn in each, (S, 2)."""
    sums = np.vstack([np.zeros(2), np.cumsum(path.u, axis=0)])
    at = np.stack([np.interp(edges, known, column) for column in sums.T], axis=-1)
    piece = np.clip(np.searchsorted(known, edges[:-1], side="right") - 1, 0, len(path.u) - 1)
    places = ends_of(short, path.q[piece], at[:-1] - sums[piece])
    return np.vstack([places, path.q[-1]]), np.diff(at, axis=0)


def _drives(system: Manipulator, moves: Array, ends: Ends) -> tuple[Array, Array]:
    """Turn, drive, turn and drive in each stretch, shape (S+1, 4, 2), and θ₁ before each.

    The last entry is the turn to the goal.
    """
    angle, out = ends.start[1], np.zeros((len(moves) + 1, 4, 2))
    before = np.empty(len(moves) + 1)
    rate = system.k_g * system.K[0]
    other = min(SWING, 0.9 * ends.limit[1]) * (np.copysign(1.0, angle))
    for k, (drive, turn) in enumerate(moves):
        before[k] = angle
        for part, (at, driven) in enumerate(_two(drive, turn / rate, angle, other)):
            out[k, 2 * part, 1], out[k, 2 * part + 1, 0] = at - angle, driven
            angle = at
    before[-1], out[-1, 0, 1] = angle, ends.goal[1] - angle
    return out, before


def _two(drive: float, turn: float, angle: float, other: float) -> list[tuple[float, float]]:
    """Angles of joint 1 and drives at them, the nearer angle first.

    Σ xₖ cosαₖ = drive and Σ xₖ cos³αₖ = turn; one angle does where the ratio allows.
    """
    least = np.cos(other) ** 2
    if least * drive**2 <= turn * drive <= drive**2 and drive:
        share = np.sqrt(turn / drive)
        return [(float(np.copysign(np.arccos(share), other)), drive / share)]
    far = (drive - turn) / (np.cos(other) * (1 - least))
    both = [(0.0, drive - far * np.cos(other)), (other, far)]
    return both if abs(angle) < abs(other) / 2 else both[::-1]


def _pieces(system: Manipulator, q: Array, u: Array, last: Array) -> tuple[Chain, Index]:
    """One piece for each turn and drive; what lies between it and the next place is a gap."""
    before = [q]
    for part in range(u.shape[1] - 1):
        before.append(ends_of(system, before[-1], u[:, part]))
    kept = np.max(np.abs(u), axis=2) > STILL
    at, moved = np.stack(before, axis=1)[kept], u[kept]
    nodes = np.vstack([at, last])
    stretch = np.minimum(np.nonzero(kept)[0], len(u) - 2)
    return Chain(nodes, moved, nodes[1:] - ends_of(system, at, moved)), stretch
