"""Problem files to start from: what must be said, what may be, and what it means."""

from planner.starter.text import problem_text

__all__ = ["problem_text"]
