"""The star's rate on the clear pupil, to which contrasts refer, from short exposures of the star moved off the mask.

This is one of the two ways of Zhu et al. 2025; the other, a star of known magnitude in the field, is in the report on
their Table 1.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Outcome, Reason, Record, Status, check_positive, require
from cpic_planner.validation.frames import (
    MOST_LOST,
    CalibratedFrames,
    calibrated_frames,
    combine,
    rejected_in,
    transferred,
)
from cpic_planner.validation.photometry import aperture_weights
from cpic_planner.validation.registration import moved
from simulator.config import AnyDetector, Instrument, Scene, load_instrument, load_scene
from simulator.imaging import AnyPsf, single_band_psf
from simulator.observing import Observation, observe
from simulator.signal import pixel_saturated
from simulator.target import scene_sources

# Along a diagonal the mask takes nothing from the aperture beyond 0.35 arcsec in any visible band, which is so many
# lambda/D from its arms in the reddest; along an axis the star stays behind an arm of the cross.
_OFF_MASK_ARCSEC, _OFF_MASK_LAMBDA_D = 0.353553, 2.26
N_FRAMES = 50
_FILL = 0.7
_LONGEST_S = 10.0
_MARGIN_SIGMA = 5.0
_RING_LAMBDA_D = (5.0, 8.0)


class StarFlux(Record):
    """Detected rate of the star on the clear pupil.

    Attributes
    ----------
    rate_e_s : float
        Electrons per second of the whole star without mask, apodizer or aperture.
    error_e_s : float
        Its 1-sigma error.
    method : {"off_mask", "known"}
        How it was measured; ``known`` for that of the scene.
    """

    rate_e_s: float
    error_e_s: float
    method: Literal["off_mask", "known"]

    @classmethod
    def known(cls, rate_e_s: float) -> "StarFlux":
        """Return a rate that is known without a measurement, as the scene's own."""
        return cls(rate_e_s, 0.0, "known")


def off_mask_arcsec(instrument: Instrument, band: str) -> tuple[float, float]:
    """Return the place of a star off the mask, x and y on the detector.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    half = instrument.channel_of(band).optics.mask_half_width_arcsec
    offset = max(_OFF_MASK_ARCSEC, half + _OFF_MASK_LAMBDA_D * instrument.lambda_d_arcsec(band))
    return offset, offset


def off_mask_exposure_s(
    rate_e_s: float, peak: float, detector: AnyDetector, *, em_gain: float = 1.0, fill: float = _FILL
) -> Outcome[float]:
    """Return the longest exposure at which a star off the mask fills its brightest pixel to a fraction of every limit.

    Parameters
    ----------
    rate_e_s : float
        Expected rate of the star on the clear pupil, above 0.
    peak : float
        Fraction of it in the brightest pixel, above 0.
    detector : Detector or InfraredDetector
        Gives full wells, converter, and the range of exposures.
    em_gain : float, optional
        Gain of the register, 1 to 1e4.
    fill : float, optional
        Fraction of the nearest limit to aim at, five sigma of noise included; above 0 and at most 1.

    Returns
    -------
    Outcome of float
        Seconds, at most 10. Where that is less than the shortest exposure, the shortest one with the flag
        ``above_fill`` as long as it does not saturate; ``saturated`` with the limit that binds if it does.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    check_positive("rate_e_s", rate_e_s, "e-/s")
    check_positive("peak", peak)
    require("fill", fill, 0 < fill <= 1, "", "above 0 and at most 1")
    require("em_gain", em_gain, math.isfinite(em_gain) and 1 <= em_gain <= 1e4, "", "1 to 1e4")
    hottest = rate_e_s * peak
    shortest = detector.exposure_min_s
    least = pixel_saturated(hottest * shortest, em_gain, detector, _MARGIN_SIGMA)
    if least.status is not Status.OK:
        text = f"even the shortest exposure, {shortest:g} s, saturates off the mask: {least.message}"
        return Outcome.refuse(Status.SATURATED, least.reason, text, unit="s")
    converter_e = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu
    converter_e -= _MARGIN_SIGMA * detector.read_noise_e
    limit = min(detector.full_well_e, detector.register_full_well_e / em_gain, converter_e / em_gain)
    # p + n sqrt(2 p) = fill * limit, a quadratic in sqrt(p)
    root = _MARGIN_SIGMA * math.sqrt(0.5)
    brightest = (math.sqrt(root**2 + fill * limit) - root) ** 2
    exposure = min(brightest / hottest, _LONGEST_S, detector.exposure_max_s)
    if exposure < shortest:
        return Outcome.ok(shortest, unit="s", flags=("above_fill",))
    return Outcome.ok(exposure, unit="s")


def is_far(psf: AnyPsf, offset_arcsec: tuple[float, float]) -> bool:
    """Return whether a star off the mask is beyond the stamp of the point-spread function about the mask.

    Parameters
    ----------
    psf : Psf or TablePsf
    offset_arcsec : tuple of float
        Place of the star relative to the centre of the mask, x and y on the detector.
    """
    half = (len(psf.off_axis) // 2) * psf.geometry.pixel_scale_arcsec
    return max(map(abs, offset_arcsec)) > half - psf.geometry.aperture_radius_arcsec


def observe_off_mask(
    scene: Scene | Mapping[str, Any] | str | Path,
    band: str,
    *,
    instrument: Instrument | Mapping[str, Any] | str | None = None,
    exposure_s: float | None = None,
    n_frames: int = N_FRAMES,
    em_gain: float = 1.0,
    offset_arcsec: tuple[float, float] | None = None,
    **settings: Any,
) -> Outcome[Observation]:
    """Set up the calibration series: the star of a scene beside the mask.

    Parameters
    ----------
    scene, instrument
        As `simulator.observe`; planets are left out.
    band : str
        A band of the instrument.
    exposure_s : float, optional
        Exposure of a frame; by default what `off_mask_exposure_s` finds for the rate that the scene predicts.
    n_frames, em_gain : optional
        Frames of the series, and gain.
    offset_arcsec : tuple of float, optional
        Place of the star relative to the centre of the mask, x and y on the detector; `off_mask_arcsec` by default.
    **settings
        Others of `simulator.observe`: ``seed``, ``realisation``, ``fidelity``, ``window`` ...

    Returns
    -------
    Outcome of Observation
        ``saturated`` where even the shortest exposure is too long.
    """
    scene = load_scene(scene).without_planets()
    config = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    offset = offset_arcsec or off_mask_arcsec(config, band)
    if exposure_s is None:
        optics = single_band_psf(band, fidelity=settings.get("fidelity", "standard"), instrument=config)
        rate = scene_sources(scene, config, band)[0].rate_e_s
        peak = float((optics.off_axis if is_far(optics, offset) else optics.at(*offset)).max())
        answer = off_mask_exposure_s(rate, peak, config.detector_of(band), em_gain=em_gain)
        if answer.value is None:
            return Outcome.refuse(answer.status, answer.reason, answer.message)
        exposure_s = answer.value
    # One wavefront: its drift changes the rate by 1e-5, far below the error of the counts.
    usual: dict[str, Any] = {"kind": "CALS", "role": "calibration", "window": "hole", "max_epochs": 1}
    seen = observe(
        scene,
        band=band,
        instrument=config,
        exposure_s=exposure_s,
        n_frames=n_frames,
        em_gain=em_gain,
        star_offset_arcsec=offset,
        **(usual | settings),
    )
    return Outcome.ok(seen)


def star_flux_off_mask(observation: Observation, frames: CalibratedFrames | None = None) -> Outcome[StarFlux]:
    """Return the rate of the star from a series of frames beside the mask.

    Parameters
    ----------
    observation : Observation
        With the star off the mask (`observe_off_mask`).
    frames : CalibratedFrames, optional
        Its frames, where they are not to be drawn: those of files. Of a star that `is_far`, stamps of the size of the
        point-spread function, the star's pixel in the middle.

    Returns
    -------
    Outcome of StarFlux
        ``saturated`` where the star's own light cuts pixels of the aperture off.

    Raises
    ------
    InputError
        If the star stands behind the mask, or its stamp leaves the frames.

    Notes
    -----
    Frames are calibrated and cosmic rays taken out. The aperture of the instrument is laid on the commanded place of
    the star, less a ring of 5 to 8 lambda/D as background; the same sum over the point-spread function at that place
    (far from the mask, over that without a mask), after the transfers of the camera, is the core throughput. So neither
    the star's own wings in the ring, nor pixels without a usable frame, nor the place within a pixel bias the rate. The
    error is that of the counts in these pixels (`CalibratedFrames.variance_e2`); that of the model of the point-spread
    function is not in it. Left alone: the wavefront's drift, and the curve of the pixels before the transfers, each
    1e-5 of the rate.
    """
    offset = observation.star_offset_arcsec
    refused = InputError(
        "star_offset_arcsec",
        offset,
        unit="arcsec",
        allowed="a place off the mask",
        hint="along a diagonal, beyond 0.35 arcsec",
    )
    far, middle = is_far(observation.psf, offset), len(observation.psf.off_axis) // 2
    if far and min(map(abs, offset)) < min(off_mask_arcsec(observation.instrument, observation.band)):
        raise refused
    drawn, frames = frames is None, frames or calibrated_frames(observation)
    summed = combine(frames.electrons, frames.usable & ~rejected_in(frames).rejected)
    first_row, first_column = observation.first_pixel or (0, 0)
    if far:
        x, y = (part / observation.psf.geometry.pixel_scale_arcsec for part in offset)
        template = moved(observation.psf.off_axis, x - round(x), y - round(y))
        row, column = observation.area.centre
        start = row + round(y) - middle, column + round(x) - middle
        rows, columns = (slice(first, first + len(template)) for first in (start if drawn else (0, 0)))
        part = slice(0, len(template)), slice(0, len(template))
        if min(rows.start, columns.start) < 0 or summed.covered[rows, columns].shape != template.shape:
            allowed = f"a place with {len(template)} x {len(template)} pixels of the frames around it"
            raise InputError("star_offset_arcsec", offset, unit="arcsec", allowed=allowed)
    else:
        template = observation.psf.at(*offset)
        rows, columns, part = observation.area.stamp(len(template))
        start = rows.start, columns.start
    response, alive = frames.response[rows, columns], np.any(frames.electrons[:, rows, columns], axis=0)
    corner = (first_row + start[0], first_column + start[1])
    template = transferred(template[part] * response * alive, frames.detector, corner) / response
    seen = summed.covered[rows, columns]
    aperture, weights = _weights(observation, template.shape, start, seen)
    lost = frames.n_lost[rows, columns][aperture > 0]
    if lost.max() > MOST_LOST * frames.n_frames:
        cut = f"{np.count_nonzero(lost)} pixels of the aperture are cut off in up to {lost.max()}"
        text = f"{cut} of {frames.n_frames} frames; shorten the exposure"
        return Outcome.refuse(Status.SATURATED, _limit(observation, template), text, unit="e-/s")
    core = float(np.sum(weights * template))
    if not core > 0.01 * _open_core(observation.psf):
        raise refused
    light = np.where(summed.covered, summed.image_e, 0.0)
    variance = frames.n_frames * frames.variance_e2(light / frames.n_frames) * summed.variance_factor
    flux = float(np.sum(weights * light[rows, columns]))
    error = math.sqrt(float(np.sum(weights[seen] ** 2 * variance[rows, columns][seen])))
    scale = core * (frames.n_frames * frames.exposure_s)
    return Outcome.ok(StarFlux(flux / scale, error / scale, "off_mask"), unit="e-/s")


def _weights(
    observation: Observation, shape: tuple[int, int], corner: tuple[int, int], seen: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the aperture, and aperture less its background, on the stamp; 0 where no frame is usable."""
    geometry, area = observation.psf.geometry, observation.area
    pixel = geometry.pixel_scale_arcsec
    x = area.centre[1] - corner[1] + observation.star_offset_arcsec[0] / pixel
    y = area.centre[0] - corner[0] + observation.star_offset_arcsec[1] / pixel
    aperture = aperture_weights(shape, x, y, geometry.aperture_radius_arcsec / pixel)
    rows, columns = np.indices(shape)
    distance = np.hypot(columns - x, rows - y) * pixel / geometry.lambda_d_arcsec
    ring = seen & (distance >= _RING_LAMBDA_D[0]) & (distance <= _RING_LAMBDA_D[1])
    used = np.where(seen, aperture, 0.0)
    return aperture, used - ring * (used.sum() / max(np.count_nonzero(ring), 1))


def _open_core(psf: AnyPsf) -> float:
    """Return the core throughput of a source centred on a pixel, without the mask."""
    geometry, middle = psf.geometry, len(psf.off_axis) // 2
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    return float(np.sum(psf.off_axis * aperture_weights(psf.off_axis.shape, middle, middle, radius)))


def _limit(observation: Observation, template: FloatArray) -> Reason:
    """Return the limit that the brightest pixel exceeds furthest."""
    peak = observation.truth.sources[0].rate_e_s * float(template.max()) * observation.exposure_s
    answer = pixel_saturated(peak, observation.em_gain, observation.channel.detector, _MARGIN_SIGMA)
    return Reason.PIXEL_FULL_WELL if answer.status is Status.OK else answer.reason
