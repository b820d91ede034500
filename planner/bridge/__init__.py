"""Feasible paths for the hard cases, where no first guess of a solver leads anywhere.

Long chains answer to their inputs through high-order brackets only, and a solver that starts from a
guess which does not obey the kinematics is lost. Here every iterate is a motion of the machine,
inside its limits, but for gaps, which are closed little by little: the one between a random motion
from the start and one to the goal (`bridge`), or the many small ones along a path that a shorter
arm can make (`lift`).

Sources: Sussmann, A continuation method for nonholonomic path-finding problems, CDC 1993; growing
from both ends: LaValle and Kuffner, Randomized kinodynamic planning, IJRR 20 (2001).
"""

from planner.bridge.bridge import Bridge, bridges
from planner.bridge.lift import lifted

__all__ = ["Bridge", "bridges", "lifted"]
