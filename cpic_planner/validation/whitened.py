"""Photometry with a filter whitened by the covariance that the optical model foresees, its error from other places."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cpic_core import BoolArray, FloatArray
from cpic_planner.validation.apertures import aperture_weights, outside_discs, sample_places
from cpic_planner.validation.photometry import EXCLUSION_RADII, Photometry, aperture_photometry, ratio
from cpic_planner.validation.realise import VisitPair
from cpic_planner.validation.reduced import ReducedStack
from simulator.config import Instrument
from simulator.imaging import BandGeometry
from simulator.signal import REGION_LAMBDA_D, Whitening, placed, speckle_covariance, unit_parts, with_noise

_MOST_PROBES = 200  # places that tell the scatter: several an aperture


@dataclass(frozen=True, eq=False)
class SpeckleModel:
    """Residual speckles of a programme as the optical model foresees them; made by `of`.

    Attributes
    ----------
    instrument : Instrument
        Whose static field, mirror and drift are taken for granted.
    band : str
    linear_nm2, square_nm4 : float
        What the wavefronts of the programme leave of both parts; see `simulator.signal.unit_parts`.
    star_e : float
        Electrons of the star on the clear disc in the summed stack.
    """

    instrument: Instrument
    band: str
    linear_nm2: float
    square_nm4: float
    star_e: float

    @classmethod
    def of(cls, visits: VisitPair, star_rate_e_s: float, instrument: Instrument | None = None) -> Self:
        """Return the model of a programme.

        Parameters
        ----------
        visits : VisitPair
        star_rate_e_s : float
            Rate of the star on the clear disc.
        instrument : Instrument, optional
            The instrument that is taken for granted; that of the images by default.
        """
        model, plan, one = instrument or visits.instrument, visits.plan, visits.science
        visit_s = (one.exposure_s + one.readout_s) * one.n_frames
        gap_s = visits.task.gap_s if plan.visits > 1 else math.inf
        length = visits.strategy.reference_library.reference_length(
            np.asarray(float(plan.visits)), np.asarray(float(plan.reference_visits))
        )
        parts = unit_parts(model.drift, reference_ratio=visits.strategy.reference_ratio, timing=visits.task.timing)
        left = (
            float(part.law(plan.visits, plan.reference_visits, gap_s, reference_length=length).variance(visit_s))
            for part in parts
        )
        # Noise-free references are expectations of the science visits: they have their wavefronts.
        linear, square = (0.0, 0.0) if plan.noise_free else left
        star_e = star_rate_e_s * one.exposure_s * one.n_frames * plan.visits
        return cls(model, visits.task.band, linear, square, star_e)

    def covariance_e2(self, separation_arcsec: float, region: BoolArray, geometry: BandGeometry) -> FloatArray:
        """Return the covariance of the speckles in the pixels of a region, electrons squared, shape (p, p).

        Parameters
        ----------
        separation_arcsec : float
        region : ndarray of bool, shape (n, n)
            Part of the hole within 2.4 lambda/D of the separation.
        geometry : BandGeometry
        """
        every = speckle_covariance(self.instrument, self.band, separation_arcsec, self.linear_nm2, self.square_nm4)
        part = region[geometry.annulus(separation_arcsec, REGION_LAMBDA_D)]
        return np.asarray(self.star_e**2 * every[np.ix_(part, part)])


class WhitenedFilter:
    """Generalised least squares for a source at one place, over the pixels of the annulus around it.

    Parameters
    ----------
    stack : ReducedStack
        Of one roll; its pixels, white noise and modes count, not its image.
    template : ndarray, shape (n, n)
        Image of a unit source at the place.
    place_pixel : tuple of float
        The place (x, y); pixel centres are at integers.
    geometry : BandGeometry
    model : SpeckleModel
        The residual speckles.
    background_region : ndarray of bool, shape (n, n)
        Where the scatter is measured, without other sources; a disc around the place is taken out here.
    neighbours : tuple of ndarray, shape (n, n)
        Images of other sources.

    Raises
    ------
    InputError
        If the background region holds fewer than 3 apertures side by side.

    Notes
    -----
    A level, the modes that were subtracted and the neighbours are fitted with the source. A filter belongs to its
    place: the scatter is that of the same estimate at the places of apertures in the background region, each with its
    own filter and the source at its place fitted too, over the error that the covariance foresees there. Its rms times
    the error foreseen at the place is the error: the shape of the covariance is believed, not its size.
    """

    def __init__(
        self,
        stack: ReducedStack,
        template: FloatArray,
        place_pixel: tuple[float, float],
        *,
        geometry: BandGeometry,
        model: SpeckleModel,
        background_region: BoolArray,
        neighbours: tuple[FloatArray, ...] = (),
    ) -> None:
        radius, middle = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
        x_pixel, y_pixel = place_pixel
        separation = math.hypot(x_pixel - middle, y_pixel - middle) * geometry.pixel_scale_arcsec
        region = stack.region & geometry.annulus(separation, REGION_LAMBDA_D)
        noise = with_noise(model.covariance_e2(separation, region, geometry), stack.white_variance_e2[region])
        modes = np.zeros((len(stack.rdi.modes), *region.shape))
        modes[:, stack.rdi.region] = stack.rdi.modes
        beside = np.array([image[region] for image in (np.ones(region.shape), *modes, *neighbours)])
        self._whitening = Whitening(noise, beside)
        self._region, self._background, self._place, self._radius = region, background_region, place_pixel, radius
        self._left = stack.rdi.project(template)
        source = template[region]
        self._source = self._whitening.of(source)
        self._power = float(self._source @ self._source)
        probes, self._apertures = _probes(template, place_pixel, region, background_region & region, radius)
        others = self._whitening.of(probes)
        others -= np.outer(others @ self._source / self._power, self._source)
        self._others = others / np.sqrt((others**2).sum(axis=1, keepdims=True))
        self._core = float(np.sum(aperture_weights(template.shape, x_pixel, y_pixel, radius) * template))
        # Variance of the strength by the source's own electrons, one a unit of its strength.
        self._own = float(np.sum(self._whitening.weights(source) ** 2 * np.maximum(source, 0.0)))

    @property
    def sigma_e(self) -> float:
        """Standard deviation of the light in the aperture that the covariance foresees, electrons."""
        return self._core / math.sqrt(self._power)

    def photometry(self, stack: ReducedStack) -> Photometry:
        """Return the flux of the source.

        Parameters
        ----------
        stack : ReducedStack
            Of the same pixels, white noise and modes.

        Returns
        -------
        Photometry
            ``raw_flux`` and errors are those of the light in the photometric aperture, with a ``throughput`` of 1: the
            source is fitted with what the subtraction leaves of it. ``background_per_pixel``, ``flux_paper_error``,
            ``snr_paper`` and the areas are those of an aperture.
        """
        plain = aperture_photometry(
            stack.image_e,
            *self._place,
            self._radius,
            background_region=self._background,
            factor2=stack.factor2,
            left=self._left,
        )
        image = self._whitening.of(stack.image_e[self._region])
        strength = float(self._source @ image) / self._power
        scatter = float(np.sqrt(np.mean((self._others @ image) ** 2)))
        raw, sigma = self._core * strength, scatter * self.sigma_e
        own = stack.factor2 * self._own * max(strength, 0.0)
        error = math.sqrt(sigma**2 + self._core**2 * own)
        return replace(
            plain,
            flux=raw,
            error=error,
            snr=ratio(raw, error),
            significance=ratio(raw, sigma),
            raw_flux=raw,
            sigma_background=sigma,
            n_background_apertures=self._apertures,
            error_rel_uncertainty=1.0 / math.sqrt(2.0 * (self._apertures - 1)),
            throughput=1.0,
        )


def _probes(
    template: FloatArray, place: tuple[float, float], region: BoolArray, background: BoolArray, radius: float
) -> tuple[FloatArray, int]:
    """Return the source moved by whole pixels to where apertures lie in the background, and how many fit."""
    row, column, half = round(place[1]), round(place[0]), math.ceil(radius + 0.5)
    side = 2 * half + 1
    kernel = aperture_weights((side, side), half + place[0] - column, half + place[1] - row, radius)
    away = outside_discs(background, [place], EXCLUSION_RADII * radius)
    rows, columns, _, n_apertures = sample_places(away, radius, kernel)
    some = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROBES).astype(int))
    reach = len(template)  # any move on the stamp
    stamp = np.pad(template, reach)[row : row + 2 * reach + 1, column : column + 2 * reach + 1]
    moved = (placed(template.shape, stamp, *there)[region] for there in zip(rows[some], columns[some], strict=True))
    return np.array(list(moved)), n_apertures
