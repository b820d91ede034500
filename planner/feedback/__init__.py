"""Closing the loop: a receding-horizon tracker with OSQP."""

from planner.feedback.tracker import Tracker

__all__ = ["Tracker"]
