"""Motion planning for nonholonomic manipulators: n joints, two motors, friction disks.

>>> import planner
>>> problem = planner.load_problem("problems/paper.toml")
>>> plan = planner.solve(problem, "collocation")
>>> planner.verify(plan).ok
True
"""

from typing import TYPE_CHECKING

from planner.distribution import version
from planner.lazy import import_when_used

if TYPE_CHECKING:  # a new public name goes here, into the table below and into __all__
    from planner.budget import Budget, error_budget
    from planner.certificate.certify import certify
    from planner.chained import ChainedForm, chained_form
    from planner.check import Analysis, check
    from planner.claims import Certificate, Claim
    from planner.compare import Comparison, compare
    from planner.controllability import Controllability, controllability
    from planner.differences import MachineSensitivity, machine_sensitivity
    from planner.errors import (
        InfeasibleError,
        InputError,
        NoPlanError,
        NotConvergedError,
        PlannerError,
        SingularError,
        TimeLimitError,
        VerificationError,
        Violation,
    )
    from planner.explorer import explore
    from planner.export import Samples, export, load_samples
    from planner.feedback import Tracker
    from planner.indicators import Indicators, indicators
    from planner.loading import load_plan
    from planner.machine import Machine
    from planner.methods import METHODS
    from planner.pareto import TradeOff, trade_off
    from planner.plan import Plan
    from planner.problem import Limits, Problem, load_problem
    from planner.reachability import TravelWindow, travel_window
    from planner.replay import Replay, replay
    from planner.retime import retime
    from planner.sensitivity import Sensitivity, sensitivity
    from planner.solve import solve
    from planner.sweep import Sweep, load_sweep, run_sweep
    from planner.systems import (
        BallGear,
        Car,
        CustomSystem,
        Gear,
        Manipulator,
        Trailers,
        TriangularSystem,
        Unicycle,
    )
    from planner.verify import Check, verify

_HOMES = {
    "budget": "Budget error_budget",
    "certificate.certify": "certify",
    "chained": "ChainedForm chained_form",
    "check": "Analysis check",
    "claims": "Certificate Claim",
    "compare": "Comparison compare",
    "controllability": "Controllability controllability",
    "differences": "MachineSensitivity machine_sensitivity",
    "errors": "InfeasibleError InputError NoPlanError NotConvergedError "
    "PlannerError SingularError TimeLimitError VerificationError Violation",
    "explorer": "explore",
    "export": "Samples export load_samples",
    "feedback": "Tracker",
    "indicators": "Indicators indicators",
    "loading": "load_plan",
    "machine": "Machine",
    "methods": "METHODS",
    "pareto": "TradeOff trade_off",
    "plan": "Plan",
    "problem": "Limits Problem load_problem",
    "reachability": "TravelWindow travel_window",
    "replay": "Replay replay",
    "retime": "retime",
    "sensitivity": "Sensitivity sensitivity",
    "solve": "solve",
    "sweep": "Sweep load_sweep run_sweep",
    "systems": "BallGear Car CustomSystem Gear Manipulator Trailers TriangularSystem Unicycle",
    "verify": "Check verify",
}
import_when_used(__name__, _HOMES)

__version__ = version()

__all__ = [
    "METHODS",
    "Analysis",
    "BallGear",
    "Budget",
    "Car",
    "Certificate",
    "ChainedForm",
    "Check",
    "Claim",
    "Comparison",
    "Controllability",
    "CustomSystem",
    "Gear",
    "Indicators",
    "InfeasibleError",
    "InputError",
    "Limits",
    "Machine",
    "MachineSensitivity",
    "Manipulator",
    "NoPlanError",
    "NotConvergedError",
    "Plan",
    "PlannerError",
    "Problem",
    "Replay",
    "Samples",
    "Sensitivity",
    "SingularError",
    "Sweep",
    "TimeLimitError",
    "Tracker",
    "TradeOff",
    "Trailers",
    "TravelWindow",
    "TriangularSystem",
    "Unicycle",
    "VerificationError",
    "Violation",
    "certify",
    "chained_form",
    "check",
    "compare",
    "controllability",
    "error_budget",
    "explore",
    "export",
    "indicators",
    "load_plan",
    "load_problem",
    "load_samples",
    "load_sweep",
    "machine_sensitivity",
    "replay",
    "retime",
    "run_sweep",
    "sensitivity",
    "solve",
    "trade_off",
    "travel_window",
    "verify",
]
