"""Motion planning for nonholonomic manipulators: n joints, two motors, friction disks.

>>> import planner
>>> problem = planner.load_problem("problems/paper.toml")
>>> plan = planner.solve(problem, "collocation")
>>> planner.verify(plan).ok
True
"""

from planner.compare import Comparison, compare
from planner.errors import (
    InfeasibleError,
    InputError,
    NoPlanError,
    NotConvergedError,
    PlannerError,
    SingularError,
    VerificationError,
    Violation,
)
from planner.methods import METHODS
from planner.plan import Plan, load_plan
from planner.problem import Limits, Problem, load_problem
from planner.reachability import TravelWindow, travel_window
from planner.retime import retime
from planner.solve import solve
from planner.sweep import Sweep, load_sweep, run_sweep
from planner.systems import Gear, Manipulator, TriangularSystem
from planner.verify import Check, verify

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "Check",
    "Comparison",
    "Gear",
    "InfeasibleError",
    "InputError",
    "Limits",
    "Manipulator",
    "NoPlanError",
    "NotConvergedError",
    "Plan",
    "PlannerError",
    "Problem",
    "SingularError",
    "Sweep",
    "TravelWindow",
    "TriangularSystem",
    "VerificationError",
    "Violation",
    "compare",
    "load_plan",
    "load_problem",
    "load_sweep",
    "retime",
    "run_sweep",
    "solve",
    "travel_window",
    "verify",
]
