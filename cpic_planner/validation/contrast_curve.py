"""Contrast limit against separation, measured on a residual."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from cpic_planner.etc.place import diagonal
from cpic_planner.etc.significance import threshold_array
from cpic_planner.validation.apertures import aperture_weights, checked_image, sample_scatter
from cpic_planner.validation.reduced import ReducedStack
from simulator.imaging.psf import Psf

__all__ = ["ANNULUS_LAMBDA_D", "ContrastCurve", "contrast_curve"]

FloatArray = npt.NDArray[np.float64]
ANNULUS_LAMBDA_D = 1.5
"""Half width of the annulus that holds the background apertures, as in the strategy of the ETC."""
N_SEPARATIONS = 25


@dataclass(frozen=True, eq=False)
class ContrastCurve:
    """Faintest planet at a given place that would be detected there.

    Attributes
    ----------
    separation_arcsec : ndarray, shape (s,)
        Separations, on a diagonal of the hole.
    contrast : ndarray, shape (s,)
        Planet-to-star flux ratio at the threshold; ``inf`` where the annulus has too few resolution elements or room
        for fewer than 3 apertures, or nothing of the planet passes the mask.
    sigma_e : ndarray, shape (s,)
        Scatter of aperture sums in the annulus, electrons; ``inf`` where there are fewer than 3.
    threshold : ndarray, shape (s,)
        In units of that scatter (`detection_threshold`): the position is given, not searched for.
    throughput : ndarray, shape (s,)
        Aperture energy over that on the clear disc, times what the subtraction leaves of it.
    sigma : float
        Gaussian significance with the false-alarm probability of the threshold.
    """

    separation_arcsec: FloatArray
    contrast: FloatArray
    sigma_e: FloatArray
    threshold: FloatArray
    throughput: FloatArray
    sigma: float


def contrast_curve(
    stack: ReducedStack,
    psf: Psf,
    *,
    star_rate_e_s: float,
    sigma: float = 5.0,
    separations_arcsec: npt.ArrayLike | None = None,
) -> ContrastCurve:
    """Measure the contrast limit of a residual.

    Parameters
    ----------
    stack : ReducedStack
        Without bright planets: their light counts as noise.
    psf : Psf
    star_rate_e_s : float
        Detected rate of the star on the clear pupil, above 0.
    sigma : float
        Above 0, at most 20.
    separations_arcsec : array_like, optional
        Above 0; 25 between the corners of the hole by default.

    Returns
    -------
    ContrastCurve

    Raises
    ------
    InputError
        If an argument is out of range.

    Notes
    -----
    ``threshold scatter / (throughput star_rate integration)``: empirical scatter of aperture-sized samples in the
    annulus of 1.5 lambda/D to either side, threshold of few samples (Mawet et al. 2014), the same question that
    `cpic_planner.contrast_limit` answers from the noise model.
    """
    image, geometry = checked_image(stack.image_e), psf.geometry
    if not (math.isfinite(star_rate_e_s) and star_rate_e_s > 0):
        raise InputError("star_rate_e_s", star_rate_e_s, unit="e-/s", allowed="finite and above 0")
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    if separations_arcsec is None:
        near, far = geometry.zone.inner_corner_arcsec, geometry.zone.outer_corner_arcsec
        separations_arcsec = np.linspace(near, far, N_SEPARATIONS + 2)[1:-1]
    places = np.atleast_1d(np.asarray(separations_arcsec, float))
    if not (np.isfinite(places) & (places > 0)).all():
        raise InputError("separations_arcsec", separations_arcsec, unit="arcsec", allowed="finite and above 0")
    scatter, throughput = np.full(places.shape, np.inf), np.zeros(places.shape)
    for index, place in enumerate(places):
        scatter[index] = _scatter(image, geometry.annulus(float(place), ANNULUS_LAMBDA_D) & stack.region, radius)
        x, y = (float(part) for part in diagonal(geometry.zone, place))
        throughput[index] = _throughput(stack, psf, x, y, radius)
    elements = geometry.resolution_elements(places)
    threshold = threshold_array(elements, sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = threshold * scatter / (throughput * star_rate_e_s * stack.integration_s)
    defined = np.isfinite(threshold) & np.isfinite(scatter) & (throughput > 0)
    return ContrastCurve(places, np.where(defined, limit, np.inf), scatter, threshold, throughput, sigma)


def _scatter(image: FloatArray, annulus: npt.NDArray[np.bool_], radius: float) -> float:
    if not annulus.any():
        return math.inf
    try:
        return sample_scatter(image, annulus, radius)[0]
    except InputError:  # no room for three apertures: the scatter is undefined there
        return math.inf


def _throughput(stack: ReducedStack, psf: Psf, x: float, y: float, radius: float) -> float:
    centre, pixel = len(stack.image_e) // 2, psf.geometry.pixel_scale_arcsec
    column, row = x / pixel + centre, y / pixel + centre
    if max(abs(column - centre), abs(row - centre)) + radius > centre:
        return 0.0
    weights = aperture_weights(stack.region.shape, column, row, radius)
    template = np.asarray(psf.at(x, y), float)
    core = float(np.sum(template * weights))
    if not core > 0 or not (stack.region & (weights > 0)).any():
        return 0.0
    return core * stack.rdi.throughput(template, weights)
