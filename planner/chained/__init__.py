"""The chart of Theorem 1: transformation, feedback, inverse and margins."""

from planner.chained.transform import ChainedForm, chained_form

__all__ = ["ChainedForm", "chained_form"]
