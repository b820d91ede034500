"""What is steered: the triangular class and its members."""

from planner.systems.base import Coordinate, TriangularSystem
from planner.systems.manipulator import Gear, Manipulator

__all__ = ["Coordinate", "Gear", "Manipulator", "TriangularSystem"]
