"""Contrast limit against separation, measured on a residual.

Detection probability against false alarms, for one planet and one filter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, stream
from cpic_planner.etc import diagonal, threshold_array
from cpic_planner.validation.apertures import aperture_weights, check_positive, checked_image, sample_scatter
from cpic_planner.validation.detection import search
from cpic_planner.validation.injection import draw_place, fraction_error, inject, recovered
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.search_field import REPORTED_SIGMA
from cpic_planner.validation.speckle_maps import SpeckleMaps
from simulator.imaging import AnyPsf, Psf

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
    separations_arcsec: ArrayLike | None = None,
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
    check_positive("star_rate_e_s", star_rate_e_s, "e-/s")
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
    threshold = threshold_array(geometry.resolution_elements(places), sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = threshold * scatter / (throughput * star_rate_e_s * stack.integration_s)
    defined = np.isfinite(threshold) & np.isfinite(scatter) & (throughput > 0)
    return ContrastCurve(places, np.where(defined, limit, np.inf), scatter, threshold, throughput, sigma)


def _scatter(image: FloatArray, annulus: BoolArray, radius: float) -> float:
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


_SEARCH_SIGMA = 3.0


@dataclass(frozen=True, eq=False)
class RocCurve:
    """Receiver operating characteristic of the blind detector.

    Attributes
    ----------
    level : ndarray, shape (k,)
        Least `Candidate.significance` of a detection, ascending from 2.5.
    n_false : ndarray of int, shape (k,)
        Peaks at or above the level in the residuals without a planet.
    n_elements : float
        Resolution elements that were searched in them.
    n_detected : ndarray of int, shape (k,)
        Planets with a peak at or above the level within lambda/D.
    n_planets : int
        Planets injected, one a residual.
    """

    level: FloatArray
    n_false: IntArray
    n_elements: float
    n_detected: IntArray
    n_planets: int

    @property
    def false_alarm_rate(self) -> FloatArray:
        """False alarms per resolution element."""
        return self.n_false / self.n_elements

    @property
    def false_alarm_error(self) -> FloatArray:
        """Poisson standard deviation of that; of one count where there was none."""
        return np.sqrt(np.maximum(self.n_false, 1)) / self.n_elements

    @property
    def detection_probability(self) -> FloatArray:
        """Planets detected over planets injected."""
        return self.n_detected / self.n_planets

    @property
    def detection_error(self) -> FloatArray:
        """Binomial standard deviation, from the posterior under a uniform prior; never 0."""
        return fraction_error(self.n_detected, self.n_planets)


def roc_curve(
    stacks: Sequence[ReducedStack],
    psf: AnyPsf,
    maps: SpeckleMaps,
    *,
    star_rate_e_s: float,
    separation_arcsec: float,
    contrast: float,
    levels: ArrayLike | None = None,
    seed: int = 0,
) -> RocCurve:
    """Search each residual without and with a planet.

    Parameters
    ----------
    stacks : sequence of ReducedStack
        Planet-free residuals of independent visits, at least one. The same residual counts false alarms and, with the
        planet added, detections: the two counts share their noise, not their errors of interest.
    psf, star_rate_e_s
        As in `cpic_planner.validation.detection.search`.
    maps : SpeckleMaps
        With the filter to be judged.
    separation_arcsec, contrast : float
        Of the planet; its azimuth in the hole is drawn for every residual.
    levels : array_like, optional
        At least 2.5, ascending; 2.5 to 7 by default.
    seed : int
        Of azimuths and photons: the same planets for another filter.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    level = np.asarray(np.linspace(REPORTED_SIGMA, 7.0, 46) if levels is None else levels, float)
    if level.ndim != 1 or not level.size or not (level >= REPORTED_SIGMA).all() or not (np.diff(level) > 0).all():
        raise InputError("levels", levels, unit="sigma", allowed=f"ascending, at least {REPORTED_SIGMA:g}")
    if not len(stacks):
        raise InputError("stacks", 0, allowed="at least one residual")
    alarms: list[float] = []
    seen: list[float] = []
    elements = 0.0
    for visit, stack in enumerate(stacks):
        rng = stream(seed, "roc", visit)
        empty = search(stack, psf, maps, star_rate_e_s=star_rate_e_s, sigma=_SEARCH_SIGMA)
        elements += empty.region.n_elements
        alarms += [one.significance for one in empty.candidates]
        x, y = draw_place(stack, separation_arcsec, psf.geometry.pixel_scale_arcsec, rng)
        planet = inject(stack, psf, x, y, contrast * star_rate_e_s * stack.integration_s, rng)
        found = search(planet, psf, maps, star_rate_e_s=star_rate_e_s, sigma=_SEARCH_SIGMA)
        best = recovered(found, x, y, psf.geometry.lambda_d_arcsec)
        if best is not None:
            seen.append(best.significance)

    def reaching(peaks: list[float]) -> IntArray:
        return np.array([np.count_nonzero(np.array(peaks) >= one) for one in level], np.int64)

    return RocCurve(
        level=level,
        n_false=reaching(alarms),
        n_elements=elements,
        n_detected=reaching(seen),
        n_planets=len(stacks),
    )
