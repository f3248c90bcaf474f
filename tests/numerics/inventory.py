"""What each public name is to these tests: measured here, tested elsewhere, or no number at all."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import forms_camera
import forms_light
import forms_planner
import forms_target
import forms_validation
from oracle import ClosedForm

ROOT = Path(__file__).resolve().parents[2]
ROOTS = ("simulator", "cpic_planner")
ROOMS = {
    "catalogs": (
        "Band Catalogue InputError KnownPlanetTable StarMatch StarTable band_from_file load_albedo load_bands "
        "load_johnson_v load_known_planets load_reference_spectrum load_stars load_stellar_grid load_zodi_table "
        "open_catalogue resolve_star"
    ),
    "simulator.camera": (
        "CalibrationSet Effect Exposure Frame GainCap InfraredCamera MaskBit VisibleCamera aperture_noise_pixels "
        "binding_limit em_gain_of em_voltage_of excess_noise_factor2 expected_adu_map expose_frame gain_cap "
        "gain_variance load_calibration_set multiply pixel_saturated pixel_variance_e2 stack_electrons stackable "
        "stage_probability to_electrons write_calibration_set"
    ),
    "cpic_planner.validation": (
        "AlbedoFit AlbedoModel Astrometry BlindSearch CalibratedFrames Candidate LibraryPlan Photometry "
        "RdiResult ReducedStack RollResult SpeckleMaps StarFlux aperture_photometry "
        "aperture_weights calibrated_frames combine detection_threshold filled fit_albedo "
        "fit_position library_plan observe_off_mask planet_albedo_model rdi_subtract reduce_stack reject_cosmic_rays "
        "roll_photometry roll_subtract star_flux_off_mask threshold_array"
    ),
}
"""What users may call beside the names of the roots; the other names of a room are for other rooms."""
FORMS: list[ClosedForm] = [
    *forms_target.FORMS,
    *forms_camera.FORMS,
    *forms_planner.FORMS,
    *forms_light.FORMS,
    *forms_validation.FORMS,
]

ELSEWHERE = {
    "exposure_time": "tests/numerics/test_round_trips.py",
    "signal_to_noise": "tests/numerics/test_round_trips.py",
    "contrast_limit": "tests/numerics/test_round_trips.py",
    "observe": "tests/numerics/test_composers.py",
    "write_level0": "tests/numerics/test_composers.py",
    "check_level0": "tests/numerics/test_composers.py",
    "calibrate": "tests/numerics/test_composers.py",
    "multiply": "tests/simulator/detectors/test_gain.py",
    "expose_frame": "tests/numerics/test_properties.py",
    "binding_limit": "tests/numerics/test_properties.py",
    "stack_electrons": "tests/simulator/camera/test_visible.py",
    "stackable": "tests/simulator/camera/test_visible.py",
    "threshold_array": "tests/numerics/test_properties.py",
    "time_for_rates": "tests/cpic_planner/etc/test_from_rates.py",
    "snr_for_rates": "tests/cpic_planner/etc/test_from_rates.py",
    "VisibleCamera": "tests/simulator/camera/test_visible.py",
    "InfraredCamera": "tests/simulator/camera/test_infrared.py",
    "optimise": "tests/cpic_planner/ranking/test_optimiser.py",
    "rank_targets": "tests/cpic_planner/ranking/test_order.py",
    "rank_sensitivity": "tests/cpic_planner/api/test_answers.py",
    "explain_rank": "tests/cpic_planner/api/test_answers.py",
    "compare_ranks": "tests/cpic_planner/ranking/test_compare.py",
    "make_plan": "tests/cpic_planner/confirm/test_plan.py",
    "compare_strategies": "tests/cpic_planner/api/test_runs.py",
    "contrast_curve": "tests/cpic_planner/confirm/test_curve.py",
    "roc_curve": "tests/cpic_planner/confirm/test_roc.py",
    "star_visibility": "tests/cpic_planner/api/test_runs.py",
    "confirm_scene": "tests/cpic_planner/confirm/test_scene.py",
    "confirm_targets": "tests/cpic_planner/api/test_runs.py",
    "simulate_products": "tests/numerics/test_composers.py",
    "single_band_psf": "tests/simulator/imaging/test_psf.py",
    "aperture_photometry": "tests/cpic_planner/validation/test_photometry.py",
    "fit_albedo": "tests/cpic_planner/validation/test_albedo_fit.py",
    "fit_position": "tests/cpic_planner/validation/test_astrometry.py",
    "calibrated_frames": "tests/cpic_planner/validation/test_frames.py",
    "rdi_subtract": "tests/cpic_planner/validation/test_rdi.py",
    "reduce_stack": "tests/cpic_planner/validation/test_reduced.py",
    "reject_cosmic_rays": "tests/cpic_planner/validation/test_rejection.py",
    "roll_subtract": "tests/cpic_planner/validation/test_roll.py",
    "roll_photometry": "tests/cpic_planner/validation/test_roll.py",
    "star_flux_off_mask": "tests/cpic_planner/validation/test_star_flux.py",
    "observe_off_mask": "tests/cpic_planner/validation/test_star_flux.py",
    "planet_albedo_model": "tests/cpic_planner/validation/test_albedo_model.py",
}
"""Names whose numbers come from tables, searches, random draws or chains of steps, with the test that has their oracle
and tolerance."""

NO_NUMBER = {
    "a type that holds what was computed or configured": [
        "AlbedoFit",
        "Astrometry",
        "Band",
        "BlindSearch",
        "Calibration",
        "CalibratedFrames",
        "CalibrationSet",
        "Candidate",
        "Catalogue",
        "Effect",
        "Exposure",
        "ExternalPsf",
        "Frame",
        "GainCap",
        "Instrument",
        "KnownPlanetTable",
        "Knobs",
        "LibraryPlan",
        "MaskBit",
        "Observation",
        "Outcome",
        "Outcomes",
        "Photometry",
        "Planet",
        "Psf",
        "RateConvention",
        "RdiResult",
        "Reason",
        "ReducedStack",
        "ReferencePlanet",
        "RollResult",
        "Scene",
        "SceneStar",
        "SpeckleMaps",
        "StarFlux",
        "StarMatch",
        "StarTable",
        "Status",
        "Strategy",
    ],
    "an error": ["InputError", "NotOk"],
    "reads, writes or names what is there": [
        "CONVENTIONS",
        "__version__",
        "band_from_file",
        "library_plan",
        "load_albedo",
        "load_bands",
        "load_calibration_set",
        "load_dm_surface",
        "load_instrument",
        "load_johnson_v",
        "load_population",
        "load_psf",
        "load_reference_spectrum",
        "load_scene",
        "load_stars",
        "load_stellar_grid",
        "load_known_planets",
        "load_strategies",
        "load_targets",
        "load_zodi_table",
        "open_catalogue",
        "resolve_star",
        "save_psf",
        "write_coronagraph_table",
        "scenes_from_table",
        "write_calibration_set",
    ],
    "a source of random numbers": ["stream"],
}


def public_names() -> Iterator[tuple[str, str, Any]]:
    """Package, name and object of everything that the packages export."""
    for package in (*ROOTS, *ROOMS):
        module = importlib.import_module(package)
        for name in ROOMS[package].split() if package in ROOMS else module.__all__:
            yield package, name, getattr(module, name)


def measured() -> list[Any]:
    """Objects that the closed forms measure: functions, and classes whose methods are measured."""
    found = []
    for form in FORMS:
        parts, owner = form.name.split(",")[0].split("."), None
        for i, part in enumerate(parts):
            if owner is not None and hasattr(owner, part):
                owner = getattr(owner, part)
            else:
                owner = importlib.import_module(".".join(parts[: i + 1]))
            if callable(owner):
                found.append(owner)
    return found


def standing(name: str, item: Any) -> str:
    """What a public name is here: ``measured``, a test, or why it has no number; empty if nothing is known."""
    if any(item is one for one in measured()):
        return "measured"
    if name in ELSEWHERE:
        return ELSEWHERE[name]
    return next((reason for reason, names in NO_NUMBER.items() if name in names), "")
