"""Detection thresholds, under the name that validation knows them by; see `cpic_planner.etc.significance`."""

from cpic_planner.etc.significance import MIN_ELEMENTS, detection_threshold, threshold_array

__all__ = ["MIN_ELEMENTS", "detection_threshold", "threshold_array"]
