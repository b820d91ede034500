"""Which effect of the machine costs a plan how much of its error."""

from planner.budget.budget import Budget, Cost, error_budget
from planner.budget.sobol import Index, refuse_without_salib

__all__ = ["Budget", "Cost", "Index", "error_budget", "refuse_without_salib"]
