"""What is steered: the triangular class and its members."""

from planner.systems.ballgear import BallGear
from planner.systems.base import Coordinate, TriangularSystem
from planner.systems.car import Car
from planner.systems.custom import CustomSystem
from planner.systems.manipulator import Gear, Manipulator
from planner.systems.trailers import Trailers
from planner.systems.unicycle import Unicycle

__all__ = [
    "BallGear",
    "Car",
    "Coordinate",
    "CustomSystem",
    "Gear",
    "Manipulator",
    "Trailers",
    "TriangularSystem",
    "Unicycle",
]
