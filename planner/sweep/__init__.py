"""Many problems, many settings: described in one file, run in parallel, kept in one database."""

from planner.sweep.case import RESULTS
from planner.sweep.description import Sweep
from planner.sweep.run import Outcome, run_sweep
from planner.sweep.table import export, load_case_plan, load_sweep

__all__ = [
    "RESULTS",
    "Outcome",
    "Sweep",
    "export",
    "load_case_plan",
    "load_sweep",
    "run_sweep",
]
