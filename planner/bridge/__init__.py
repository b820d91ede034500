"""Paths that obey the kinematics, where no first guess of a solver leads to one.

Long chains answer to their inputs through high-order brackets only. Here every iterate is a motion
of the machine, inside its limits, but for gaps, which are closed little by little: the many small
ones along a path that a shorter arm can make (`lift`).

Source: Sussmann, A continuation method for nonholonomic path-finding problems, CDC 1993.
"""

from planner.bridge.lift import lifted

__all__ = ["lifted"]
