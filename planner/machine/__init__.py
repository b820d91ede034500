"""The emulated machine: what real motors, contacts, gears and encoders make of a plan."""

from planner.machine.draw import Draws, draw
from planner.machine.machine import Machine, Quantity
from planner.machine.simulate import Recording, simulate

__all__ = ["Draws", "Machine", "Quantity", "Recording", "draw", "simulate"]
