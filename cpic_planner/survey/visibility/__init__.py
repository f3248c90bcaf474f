"""Visibility: when a star can be seen from the orbit of the telescope, and at which roll."""

from cpic_planner.survey.visibility.calendar import BLOCKS, Visibility, slew_s, visibility
from cpic_planner.survey.visibility.config import VisibilityConfig, VisibilitySource, load_visibility, visibility_names

__all__ = [
    "BLOCKS",
    "Visibility",
    "VisibilityConfig",
    "VisibilitySource",
    "load_visibility",
    "slew_s",
    "visibility",
    "visibility_names",
]
