from cpic_planner.ranking.completeness import (
    KNOWN_ONLY as KNOWN_ONLY,
    AskedStars as AskedStars,
    KnownChoice as KnownChoice,
    asked_stars as asked_stars,
    counted_planets as counted_planets,
    faintest_contrast as faintest_contrast,
    ring_of as ring_of,
)
from cpic_planner.ranking.explain import explain_star as explain_star
from cpic_planner.ranking.known_answer import known_scene as known_scene
from cpic_planner.ranking.optimiser import (
    OptimalSetting as OptimalSetting,
    best_in_band as best_in_band,
    detection_statuses as detection_statuses,
    limits_of as limits_of,
    no_frame_status as no_frame_status,
    optimise as optimise,
)
from cpic_planner.ranking.order import (
    MOST_OWN as MOST_OWN,
    rank_targets as rank_targets,
    selected as selected,
    timed_model as timed_model,
    with_own as with_own,
)
from cpic_planner.ranking.sensitivity import rank_under as rank_under
