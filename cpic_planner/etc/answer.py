"""One typed answer of the exposure-time calculator: the row that results hold."""

from cpic_planner.models.answers import EtcAnswer, Question

__all__ = ["EtcAnswer", "Question"]
