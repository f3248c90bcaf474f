"""Validation: reduction of images and photometry of planets, as blind as an observer's."""

from __future__ import annotations

from cpic_planner.validation.apertures import aperture_sum, aperture_weights
from cpic_planner.validation.photometry import Contrast, Photometry, aperture_photometry, contrast
from cpic_planner.validation.rdi import RdiResult, rdi_subtract
from cpic_planner.validation.significance import detection_threshold, threshold_array

__all__ = [
    "Contrast",
    "Photometry",
    "RdiResult",
    "aperture_photometry",
    "aperture_sum",
    "aperture_weights",
    "contrast",
    "detection_threshold",
    "rdi_subtract",
    "threshold_array",
]
