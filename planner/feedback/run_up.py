"""Taking up play before the start."""

from __future__ import annotations

from planner.feedback.course import RunUp
from planner.machine import Machine
from planner.plan import Plan
from planner.schema.feedback import FeedbackTable


def run_up(plan: Plan, machine: Machine, options: FeedbackTable) -> RunUp | None:
    """The run-up of a plan."""
    return None
