"""Mean count rates in the photometric aperture, per target, position and planet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.companion_wings import wings_variance
from cpic_planner.etc.exozodi import aperture_exozodi
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.sky import aperture_sky_e_s
from cpic_planner.etc.smear import aperture_smear, companion_column
from cpic_planner.etc.speckles import SpeckleLaw, speckle_law
from cpic_planner.targets import Targets
from simulator.camera.noise import aperture_noise_pixels
from simulator.target.positions import sky_to_detector

__all__ = ["ApertureRates", "aperture_rates", "companion_saturates"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ApertureRates:
    """Rates inside one aperture of radius 0.7 lambda/D; all arrays broadcast against each other.

    Attributes
    ----------
    planet_e_s, halo_e_s, companion_e_s, sky_e_s, exozodi_e_s, dark_e_s : ndarray
        Detected electrons per second in the aperture: planet, residual star light behind the coronagraph, wings of
        bound companions, sky, dust around the star, dark current.
    speckle : SpeckleLaw
        Spatial variance of aperture sums of the star light that RDI leaves, (e-/s)^2, against the length of the visit;
        it does not average down.
    wings_e2_s2 : ndarray
        The same of the light of companions whose wings lie elsewhere in the references; it is the same for all visits.
    peak_hole_e_s, peak_planet_e_s : ndarray
        Hottest pixel inside the hole, planet included: it must not saturate pixel, register or converter; and the
        planet's part of it.
    peak_frame_e_s : ndarray
        Hottest pixel of the central star anywhere.
    peak_columns_e_s : ndarray
        Hottest pixel of the central star in the columns that cross the hole: it must not bloom into it.
    tail_e_s : ndarray
        Light of the central star beside the hole that must fit the register, lest charge trails into the hole.
    aperture_pixels : float
        Pixels in the aperture.
    noise_fraction : float
        Sum of squared pixel weights over the area of the aperture: pixels that the circle cuts count with their
        weight squared in the variance of a sum.
    source_noise_fraction : float
        The same weighted by the planet's own light.
    background_apertures : ndarray
        Aperture areas in the annulus of the hole that measures the background.
    rdi_throughput : float
        Fraction of planet light that the projection leaves.
    loss_per_s : float
        Rate of particles whose tracks touch the aperture and void it in that frame.
    reference_light_e_s, reference_halo_e_s : ndarray
        What the light and dark charge of a reference frame add to the variance, once scaled to the science frames; and
        the part of its star in that.
    reference_scale : ndarray
        The same for its clock-induced charge and read noise: the square of that scale.
    smear_e, reference_smear_e : ndarray
        Electrons that smear into the aperture in every frame, whatever its exposure; and what those of a reference
        frame add to the variance, once scaled.
    variance_factor : float
        1, or 1/2 where both halves of the frames show the planet (two rolls).
    """

    planet_e_s: FloatArray
    halo_e_s: FloatArray
    companion_e_s: FloatArray
    sky_e_s: FloatArray
    exozodi_e_s: FloatArray
    dark_e_s: FloatArray
    speckle: SpeckleLaw
    wings_e2_s2: FloatArray
    peak_hole_e_s: FloatArray
    peak_planet_e_s: FloatArray
    peak_frame_e_s: FloatArray
    peak_columns_e_s: FloatArray
    tail_e_s: FloatArray
    aperture_pixels: float
    noise_fraction: float
    source_noise_fraction: float
    background_apertures: FloatArray
    rdi_throughput: float
    loss_per_s: float
    reference_light_e_s: FloatArray
    reference_halo_e_s: FloatArray
    reference_scale: FloatArray
    smear_e: FloatArray
    reference_smear_e: FloatArray
    variance_factor: float

    @property
    def background_e_s(self) -> FloatArray:
        """All light and dark charge under the planet."""
        return self.halo_e_s + self.companion_e_s + self.sky_e_s + self.exozodi_e_s + self.dark_e_s

    @property
    def residual(self) -> SpeckleLaw:
        """Everything that the subtraction leaves and that does not average."""
        return self.speckle._replace(k0=self.speckle.k0 + self.wings_e2_s2)


def aperture_rates(
    model: EtcModel,
    targets: Targets,
    band: str,
    x_arcsec: ArrayLike,
    y_arcsec: ArrayLike,
    contrast: ArrayLike,
) -> ApertureRates:
    """Rates for every target at the given positions.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    x_arcsec, y_arcsec : array_like
        Positions on the detector relative to the star, broadcastable to ``(n, ...)`` (conventions of the instrument).
    contrast : array_like
        Planet-to-star ratio of detected rates, same shape rule.

    Returns
    -------
    ApertureRates
        Arrays that broadcast to ``(n, ...)``.

    Notes
    -----
    ``rate = F_phot * area * t_opt * QE * core(x, y)``: ``core`` holds apodizer, mask and aperture loss, so that
    every loss is counted once. A companion leaves the light of its PSF wings, smoothed over
    0.15 arcsec, at roll angle 0.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    column = model.passbands.names.index(band)
    star = model.passbands.star_rate_e_s(
        targets.v_mag, targets.teff_k, targets.log_g, targets.metallicity, instrument.telescope.area_cm2
    )[:, column]
    x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
    ratio = np.asarray(contrast, float)
    star = star.reshape(star.shape + (1,) * max(0, x.ndim - 1, ratio.ndim - 1))
    planet_total = star * ratio
    strategy, camera = model.strategy, model.camera(band)
    shape = np.broadcast_shapes(star.shape, x.shape)
    sky = aperture_sky_e_s(model, targets, band)
    sky = sky.reshape(sky.shape + (1,) * (len(shape) - 1))
    companion, companion_columns, wings = _companions(model, targets, band, x, y)
    halo = star * metrics.halo_aperture(x, y)
    exozodi = star * aperture_exozodi(model, band, x, y)
    dark = np.full((1,) * len(shape), camera.dark_e_s * metrics.aperture_pixels)
    law = speckle_law(metrics, instrument.drift, np.hypot(x, y), strategy.annulus_lambda_d, strategy.reference_ratio)
    reference = model.library_noise(band, star)
    smear = aperture_smear(model, band, x, star_e_s=star, companion_column_e_s=companion_columns, sky_e_s=sky)
    region_pixels = float(np.count_nonzero(metrics.hole))
    return ApertureRates(
        planet_e_s=planet_total * metrics.core_throughput(x, y),
        halo_e_s=halo,
        companion_e_s=companion,
        sky_e_s=sky,
        exozodi_e_s=exozodi,
        dark_e_s=dark,
        speckle=law.scaled(star**2 * reference.speckle),
        wings_e2_s2=wings,
        peak_hole_e_s=star * reference.peak * metrics.peak_on_axis_hole
        + planet_total * metrics.peak_off_axis
        + companion / metrics.aperture_pixels,
        peak_planet_e_s=planet_total * metrics.peak_off_axis,
        peak_frame_e_s=star * reference.peak * metrics.peak_on_axis_frame,
        peak_columns_e_s=star * reference.peak * metrics.peak_on_axis_columns,
        tail_e_s=star * reference.peak * metrics.register_tail,
        aperture_pixels=metrics.aperture_pixels,
        noise_fraction=float(aperture_noise_pixels(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec))
        / metrics.aperture_pixels,
        source_noise_fraction=metrics.source_noise_fraction,
        background_apertures=np.maximum(_annulus_apertures(model, band, np.hypot(x, y)), 1.0),
        rdi_throughput=1.0 - strategy.n_modes / region_pixels,
        loss_per_s=model.loss_per_s(band),
        reference_light_e_s=reference.light(halo + exozodi, companion, sky + dark),
        reference_halo_e_s=reference.halo * halo,
        reference_scale=reference.scale,
        smear_e=smear.total_e,
        reference_smear_e=reference.light(smear.star_e, smear.companion_e, smear.even_e),
        variance_factor=reference.variance_factor,
    )


def companion_saturates(model: EtcModel, targets: Targets, band: str, exposure_s: ArrayLike) -> NDArray[np.bool_]:
    """Whether a companion that falls on the frame overflows its pixels in one exposure; shape ``(n,)``.

    Its blooming column and register tail are not followed; the flag says that they exist.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    detector = instrument.detector_of(band)
    known = np.isfinite(targets.companion_v_mag) & np.isfinite(targets.companion_separation_arcsec)
    over = np.zeros(len(targets), bool)
    if targets.companions == "off" or not known.any():
        return over
    near = targets.select(known)
    rate = model.passbands.star_rate_e_s(
        near.companion_v_mag, near.companion_teff_k, near.log_g, near.metallicity, instrument.telescope.area_cm2
    )[:, model.passbands.names.index(band)]
    x, y = sky_to_detector(near.companion_separation_arcsec, near.companion_pa_deg, parity=instrument.detector.parity)
    column, row = (part / metrics.pixel_scale_arcsec for part in (x, y))
    on_frame = (detector.star_column + column >= 0) & (detector.star_column + column < detector.n_columns)
    on_frame &= (detector.star_row + row >= 0) & (detector.star_row + row < detector.n_rows)
    peak = rate * metrics.peak_off_axis * np.broadcast_to(np.asarray(exposure_s, float), known.shape)[known]
    over[known] = on_frame & (peak > detector.full_well_e)
    return over


def _annulus_apertures(model: EtcModel, band: str, separation_arcsec: FloatArray) -> FloatArray:
    """Area of the background annulus inside the quadrants, in apertures."""
    metrics = model.metrics[band]
    width = 2.0 * model.strategy.annulus_lambda_d * metrics.lambda_d_arcsec
    length = 2.0 * np.pi * separation_arcsec * metrics.azimuth_fraction(separation_arcsec)
    return length * width / (np.pi * metrics.aperture_radius_arcsec**2)


def _companions(
    model: EtcModel, targets: Targets, band: str, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Light of a bound companion's wings in an aperture at (x, y), roll 0, and in its columns; what references leave.

    Shapes ``(n, ...)``; electrons per second, the last squared.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    upright = (-1,) + (1,) * max(0, x.ndim - 1)
    shape = np.broadcast_shapes((len(targets), *upright[1:]), x.shape)
    rate, columns, left = np.zeros((3, *shape))
    known = np.isfinite(targets.companion_v_mag) & np.isfinite(targets.companion_separation_arcsec)
    if targets.companions == "off" or not known.any():
        return rate, columns, left
    near = targets.select(known)
    star = model.passbands.star_rate_e_s(
        near.companion_v_mag, near.companion_teff_k, near.log_g, near.metallicity, instrument.telescope.area_cm2
    )[:, model.passbands.names.index(band)].reshape(upright)
    parity = instrument.detector.parity
    places = sky_to_detector(near.companion_separation_arcsec, near.companion_pa_deg, parity=parity)
    there = places[0].reshape(upright), places[1].reshape(upright)
    here = [np.broadcast_to(part, shape)[known] for part in (x, y)]
    wing = metrics.wing_at(here[0] - there[0], here[1] - there[1]) * metrics.aperture_pixels
    rate[known] = star * wing
    columns[known] = star * companion_column(model, band, there, here[0], wing)
    left[known] = star**2 * wings_variance(model, band, near, np.hypot(*here))
    return rate, columns, left
