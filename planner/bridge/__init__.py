"""Feasible paths for the hard cases: random motions from both ends, joined by continuation.

Long chains answer to their inputs through high-order brackets only, and a solver that starts from a
guess which does not obey the kinematics is lost. Here every iterate is a motion of the machine,
inside its limits, but for one gap between a motion from the start and one to the goal; the gap is
closed little by little. Where that is too far, the way is made of several such legs.

Sources: Sussmann, A continuation method for nonholonomic path-finding problems, CDC 1993; growing
from both ends: LaValle and Kuffner, Randomized kinodynamic planning, IJRR 20 (2001).
"""

from planner.bridge.bridge import Bridge, bridges

__all__ = ["Bridge", "bridges"]
