"""Many problems, many settings: described in one file, run in parallel, kept in one database."""

from typing import TYPE_CHECKING

from planner.lazy import import_when_used

if TYPE_CHECKING:
    from planner.sweep.case import RESULTS
    from planner.sweep.description import Sweep
    from planner.sweep.run import Outcome, run_sweep
    from planner.sweep.table import export, load_case_plan, load_sweep

_HOMES = {
    "case": "RESULTS",
    "description": "Sweep",
    "run": "Outcome run_sweep",
    "table": "export load_case_plan load_sweep",
}
import_when_used(__name__, _HOMES)

__all__ = [
    "RESULTS",
    "Outcome",
    "Sweep",
    "export",
    "load_case_plan",
    "load_sweep",
    "run_sweep",
]
