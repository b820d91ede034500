"""The command line inside the test process: the one place of the tests that knows its module."""

from planner.cli.app import main

__all__ = ["main"]
