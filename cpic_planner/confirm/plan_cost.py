"""Estimate what a plan costs, without ranking the sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_planner.confirm.stars import images_cost, plan_tasks, refuse_unimaged
from cpic_planner.etc import build_model
from cpic_planner.jobs import Cost
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import PlanQuestion
from cpic_planner.ranking import asked_stars, rank_targets, timed_model
from cpic_planner.targets import CatalogSource, as_catalogue
from cpic_planner.validation.task import ConfirmTask

_RANK_S, _REPORT_S = 2.8e-3, 8.0  # of a star in a band, other assumptions included
_NEAR, _ROUGH, _STAND_INS = 40, 200, 4


def plan_cost(tasks: Sequence[ConfirmTask], n_targets: int, n_ranked: int, n_bands: int) -> Cost:
    """Return the cost of images, and of ranking the stars, under other assumptions too, and of the report."""
    cost = images_cost(tasks, n_targets=n_targets)
    return replace(cost, start_s=cost.start_s + _RANK_S * n_ranked * n_bands + _REPORT_S)


def expected_cost(config: PlanQuestion, catalog: CatalogSource) -> Cost:
    """Return the cost of the targets that a rough ranking of the nearest stars has first, some standing for others."""
    refuse_unimaged(config.instrument, config.bands)
    model, time_s = timed_model(build_model(config.instrument, config.bands, config.strategy), config)
    stars = asked_stars(config, as_catalogue(catalog)).answered
    n_targets = min(config.top, len(stars))
    near = stars.select(np.argsort(stars.distance_pc, kind="stable")[: _NEAR + 3 * n_targets])
    rough = PopulationChoice(config.population, _ROUGH)
    ranked = rank_targets(model, near, time_s=time_s, planet=config.planet, population=rough).targets[:n_targets]
    rows = ranked[:: max(-(-len(ranked) // _STAND_INS), 1)]
    alone = [near.select(near.name == row.name) for row in rows]
    settings: dict[str, Any] = config.image_settings
    tasks, _ = plan_tasks(model, alone, rows, time_s=time_s, planet=config.planet, **settings)
    own = [[task for task in tasks if task.name == row.name] for row in rows]
    every = [task for i in range(n_targets) for task in own[i * len(own) // n_targets]]
    return plan_cost(every, n_targets, len(stars), len(model.bands))
