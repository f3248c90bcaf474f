"""Exposure times, rankings and plans for CPI-C, the coronagraph of the 2 m CSST space telescope.

Everything public of ``simulator`` is also reachable from here. Names load on first use; importing the package
loads no heavy library.

Examples
--------
>>> import cpic_planner
>>> cpic_planner.lambert_phase(0.0)
1.0
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import simulator as _simulator
from cpic_planner.version import __version__

if TYPE_CHECKING:
    from catalogs.errors import InputError
    from catalogs.known_planets import load_known_planets
    from cpic_planner.api.etc import contrast_limit, exposure_time, optimise, signal_to_noise
    from cpic_planner.api.ranking import explain_rank, rank_sensitivity, rank_targets
    from cpic_planner.api.runs import confirm_scene, confirm_targets, make_plan, simulate_products
    from cpic_planner.api.surveys import compare_strategies, star_visibility
    from cpic_planner.population_config import load_population
    from cpic_planner.queries.planet import ReferencePlanet
    from cpic_planner.queries.strategy import Strategy
    from cpic_planner.survey.strategy_file import load_strategies
    from cpic_planner.targets import load_targets
    from simulator import (
        Calibration,
        ExternalPsf,
        Instrument,
        Knobs,
        NotOk,
        Observation,
        Outcome,
        Passbands,
        Planet,
        Psf,
        Reason,
        Scene,
        SceneStar,
        Status,
        calibrate,
        check_level0,
        lambert_phase,
        load_dm_surface,
        load_instrument,
        load_psf,
        load_scene,
        observe,
        planet_albedo,
        planet_contrast,
        save_psf,
        scenes_from_table,
        single_band_psf,
        spectrum_generator,
        star_photlam,
        stream,
        write_level0,
    )

_HOME = {
    "InputError": "catalogs.errors",
    "load_targets": "cpic_planner.targets",
    "exposure_time": "cpic_planner.api.etc",
    "signal_to_noise": "cpic_planner.api.etc",
    "contrast_limit": "cpic_planner.api.etc",
    "optimise": "cpic_planner.api.etc",
    "rank_targets": "cpic_planner.api.ranking",
    "confirm_targets": "cpic_planner.api.runs",
    "make_plan": "cpic_planner.api.runs",
    "simulate_products": "cpic_planner.api.runs",
    "confirm_scene": "cpic_planner.api.runs",
    "rank_sensitivity": "cpic_planner.api.ranking",
    "explain_rank": "cpic_planner.api.ranking",
    "Strategy": "cpic_planner.queries.strategy",
    "compare_strategies": "cpic_planner.api.surveys",
    "star_visibility": "cpic_planner.api.surveys",
    "load_known_planets": "catalogs.known_planets",
    "load_strategies": "cpic_planner.survey.strategy_file",
    "ReferencePlanet": "cpic_planner.queries.planet",
    "load_population": "cpic_planner.population_config",
}

__all__ = [
    "Calibration",
    "ExternalPsf",
    "InputError",
    "Instrument",
    "Knobs",
    "NotOk",
    "Observation",
    "Outcome",
    "Passbands",
    "Planet",
    "Psf",
    "Reason",
    "ReferencePlanet",
    "Scene",
    "SceneStar",
    "Status",
    "Strategy",
    "__version__",
    "calibrate",
    "check_level0",
    "compare_strategies",
    "confirm_scene",
    "confirm_targets",
    "contrast_limit",
    "explain_rank",
    "exposure_time",
    "lambert_phase",
    "load_dm_surface",
    "load_instrument",
    "load_known_planets",
    "load_population",
    "load_psf",
    "load_scene",
    "load_strategies",
    "load_targets",
    "make_plan",
    "observe",
    "optimise",
    "planet_albedo",
    "planet_contrast",
    "rank_sensitivity",
    "rank_targets",
    "save_psf",
    "scenes_from_table",
    "signal_to_noise",
    "simulate_products",
    "single_band_psf",
    "spectrum_generator",
    "star_photlam",
    "star_visibility",
    "stream",
    "write_level0",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
    elif name in _simulator.__all__:
        value = getattr(_simulator, name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
