"""The public functions of the planner, by star names and plain numbers."""

from __future__ import annotations

from cpic_planner.api.etc import contrast_limit, exposure_time, optimise, signal_to_noise
from cpic_planner.api.ranking import explain_rank, rank_sensitivity, rank_targets
from cpic_planner.api.runs import confirm_scene, confirm_targets, make_plan, simulate_products
from cpic_planner.api.surveys import compare_strategies, star_visibility

__all__ = [
    "compare_strategies",
    "confirm_scene",
    "confirm_targets",
    "contrast_limit",
    "explain_rank",
    "exposure_time",
    "make_plan",
    "optimise",
    "rank_sensitivity",
    "rank_targets",
    "signal_to_noise",
    "simulate_products",
    "star_visibility",
]
