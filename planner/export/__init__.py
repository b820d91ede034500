"""Plans as files and tables for other programs, and back."""

from planner.export.files import FORMATS, export
from planner.export.ros import joint_trajectory
from planner.export.samples import Samples, load_samples, sample

__all__ = ["FORMATS", "Samples", "export", "joint_trajectory", "load_samples", "sample"]
