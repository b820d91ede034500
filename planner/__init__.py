"""Motion planning for nonholonomic manipulators: n joints, two motors, friction disks.

>>> import planner
>>> problem = planner.load_problem("problems/paper.toml")
>>> plan = planner.solve(problem, "collocation")
>>> planner.verify(plan).ok
True
"""

from typing import TYPE_CHECKING

from planner.support.package import import_when_used, version

if TYPE_CHECKING:  # a new public name goes here, into the table below and into __all__
    from planner.check import Analysis, check
    from planner.comparison.compare import compare
    from planner.comparison.comparison import Comparison
    from planner.compensate import compensate
    from planner.errors import (
        InfeasibleError,
        InputError,
        InputWarning,
        MethodError,
        NoPlanError,
        NotConvergedError,
        PlannerError,
        SingularError,
        TimeLimitError,
        VerificationError,
        Violation,
    )
    from planner.explorer.explore import explore
    from planner.machine.feedback.tracker import Tracker
    from planner.machine.machine import Machine
    from planner.machine.replay import Replay, replay
    from planner.methods.registry import METHODS, register_method
    from planner.plan.claims import Certificate, Claim
    from planner.plan.plan import Plan
    from planner.plan.samples import Samples, load_samples
    from planner.problem.asked import Limits
    from planner.problem.feasibility import TravelWindow, travel_window
    from planner.problem.problem import Problem, load_problem
    from planner.problem.tables.kinds import register_requirement, register_system
    from planner.report.export import export
    from planner.retime import retime
    from planner.robustness.budget import Budget, error_budget
    from planner.robustness.machine_sensitivity import MachineSensitivity, machine_sensitivity
    from planner.robustness.sensitivity import Indicators, Sensitivity, indicators, sensitivity
    from planner.robustness.trade_off import TradeOff, trade_off
    from planner.solve import solve
    from planner.sweep.description import Sweep
    from planner.sweep.design.geometry import Design
    from planner.sweep.design.result import DesignStudy
    from planner.sweep.design.study import design_study
    from planner.sweep.results import load_sweep
    from planner.sweep.run import run_sweep
    from planner.systems.ball_gear import BallGear
    from planner.systems.chained_form import ChainedForm, chained_form
    from planner.systems.controllability import Controllability, controllability
    from planner.systems.custom import CustomSystem
    from planner.systems.manipulator import Gear, Manipulator
    from planner.systems.triangular_system import TriangularSystem
    from planner.systems.vehicles import Car, Trailers, Unicycle
    from planner.verification.certify import certify
    from planner.verification.load_plan import load_plan
    from planner.verification.verify import Check, verify

_HOMES = {
    "check": "Analysis check",
    "comparison.compare": "compare",
    "comparison.comparison": "Comparison",
    "compensate": "compensate",
    "sweep.design.geometry": "Design",
    "sweep.design.result": "DesignStudy",
    "sweep.design.study": "design_study",
    "errors": "InfeasibleError InputError InputWarning MethodError NoPlanError NotConvergedError "
    "PlannerError SingularError TimeLimitError VerificationError "
    "Violation",
    "explorer.explore": "explore",
    "machine.feedback.tracker": "Tracker",
    "machine.machine": "Machine",
    "machine.replay": "Replay replay",
    "methods.registry": "METHODS register_method",
    "plan.claims": "Certificate Claim",
    "plan.plan": "Plan",
    "plan.samples": "Samples load_samples",
    "problem.feasibility": "TravelWindow travel_window",
    "problem.asked": "Limits",
    "problem.problem": "Problem load_problem",
    "problem.tables.kinds": "register_requirement register_system",
    "report.export": "export",
    "retime": "retime",
    "robustness.budget": "Budget error_budget",
    "robustness.machine_sensitivity": "MachineSensitivity machine_sensitivity",
    "robustness.sensitivity": "Indicators Sensitivity indicators sensitivity",
    "robustness.trade_off": "TradeOff trade_off",
    "solve": "solve",
    "sweep.description": "Sweep",
    "sweep.results": "load_sweep",
    "sweep.run": "run_sweep",
    "systems.ball_gear": "BallGear",
    "systems.chained_form": "ChainedForm chained_form",
    "systems.controllability": "Controllability controllability",
    "systems.custom": "CustomSystem",
    "systems.manipulator": "Gear Manipulator",
    "systems.triangular_system": "TriangularSystem",
    "systems.vehicles": "Car Trailers Unicycle",
    "verification.certify": "certify",
    "verification.load_plan": "load_plan",
    "verification.verify": "Check verify",
}
import_when_used(__name__, _HOMES, faces=("report",))

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
    "Design",
    "DesignStudy",
    "Gear",
    "Indicators",
    "InfeasibleError",
    "InputError",
    "InputWarning",
    "Limits",
    "Machine",
    "MachineSensitivity",
    "Manipulator",
    "MethodError",
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
    "compensate",
    "controllability",
    "design_study",
    "error_budget",
    "explore",
    "export",
    "indicators",
    "load_plan",
    "load_problem",
    "load_samples",
    "load_sweep",
    "machine_sensitivity",
    "register_method",
    "register_requirement",
    "register_system",
    "replay",
    "retime",
    "run_sweep",
    "sensitivity",
    "solve",
    "trade_off",
    "travel_window",
    "verify",
]
