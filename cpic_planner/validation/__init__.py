"""Validation: reduction of images and photometry of planets, as blind as an observer's."""

from __future__ import annotations

from cpic_planner.etc.significance import detection_threshold, threshold_array
from cpic_planner.validation.albedo_fit import AlbedoFit, fit_albedo
from cpic_planner.validation.albedo_model import AlbedoModel, planet_albedo_model
from cpic_planner.validation.apertures import aperture_sum, aperture_weights
from cpic_planner.validation.astrometry import Astrometry, SkyPosition, band_average, fit_position
from cpic_planner.validation.detection import BlindSearch, Candidate
from cpic_planner.validation.frames import CalibratedFrames, calibrated_frames
from cpic_planner.validation.libraries import LibraryPlan, library_plan, scale_library
from cpic_planner.validation.photometry import Contrast, Photometry, aperture_photometry, contrast
from cpic_planner.validation.rdi import RdiResult, rdi_subtract
from cpic_planner.validation.reduced import ReducedStack, reduce_stack
from cpic_planner.validation.rejection import combine, filled, reject_cosmic_rays
from cpic_planner.validation.roll import RollResult, roll_photometry, roll_subtract
from cpic_planner.validation.speckle_maps import SpeckleMaps
from cpic_planner.validation.star_flux import (
    StarFlux,
    observe_off_mask,
    star_flux_of_field_star,
    star_flux_off_mask,
)

__all__ = [
    "AlbedoFit",
    "AlbedoModel",
    "Astrometry",
    "BlindSearch",
    "CalibratedFrames",
    "Candidate",
    "Contrast",
    "LibraryPlan",
    "Photometry",
    "RdiResult",
    "ReducedStack",
    "RollResult",
    "SkyPosition",
    "SpeckleMaps",
    "StarFlux",
    "aperture_photometry",
    "aperture_sum",
    "aperture_weights",
    "band_average",
    "calibrated_frames",
    "combine",
    "contrast",
    "detection_threshold",
    "filled",
    "fit_albedo",
    "fit_position",
    "library_plan",
    "observe_off_mask",
    "planet_albedo_model",
    "rdi_subtract",
    "reduce_stack",
    "reject_cosmic_rays",
    "roll_photometry",
    "roll_subtract",
    "scale_library",
    "star_flux_of_field_star",
    "star_flux_off_mask",
    "threshold_array",
]
