"""Reduce one observation to a stack: level and pick-up of its frames taken off, residual, and what was used.

The bias drifts from frame to frame, and a sine of known period and unknown phase is picked up during readout. Both are
fitted behind the upright bar of the cross mask: no light of star or planet gets there, nor does charge that transfers
leave behind along a column, so that the fit cannot touch a source.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, numeric_context
from cpic_planner.etc import CountingLaw, counting_variance
from cpic_planner.registry import REDUCTIONS
from cpic_planner.validation.apertures import check_mask, frame_counts
from cpic_planner.validation.noise_law import PixelLaw
from cpic_planner.validation.rdi import RdiResult, rdi_subtract
from simulator.camera import FrameNoise, MaskBit
from simulator.config import AnyDetector
from simulator.detectors import wave_angles
from simulator.observing import Observation

# Columns next to light collect what serial transfers leave behind, up to three pixels further on.
_TRAIL_PIXELS = 4
_LEAST_PIXELS = 100
# Clean pixels cut off at random would bias the level: the chance keeps that below 1e-4 of the mean.
_FALSE_ALARM = 1e-7


@dataclass(frozen=True, eq=False)
class FrameLevel:
    """Linear fit of the level of a frame.

    Attributes
    ----------
    pixels : ndarray of int
        Flat indices of the pixels that it is fitted to.
    places : ndarray of int, shape (2, pixels)
        Their rows and columns.
    mean_adu : ndarray
        Mean of their dark current and clock-induced charge.
    limit_adu : ndarray
        How far above the median a pixel without a cosmic ray can be; those beyond and their neighbours are left out.
    shapes : ndarray, shape (k, pixels)
        Shapes fitted: a constant, and the two phases of the wave.
    wave : ndarray, shape (k, y, x)
        The same on all pixels.
    """

    pixels: NDArray[np.intp]
    places: NDArray[np.intp]
    mean_adu: FloatArray
    limit_adu: FloatArray
    shapes: FloatArray
    wave: FloatArray

    def of(self, image_adu: FloatArray, usable: BoolArray) -> FloatArray | None:
        """Return the level of a frame, (y, x), bias taken off before; None where too few pixels are usable.

        Parameters
        ----------
        image_adu : ndarray
            Frame, ADU, (y, x).
        usable : ndarray of bool
            Pixels that count, (y, x).
        """
        seen = image_adu.reshape(-1)[self.pixels] - self.mean_adu
        kept = usable.reshape(-1)[self.pixels]
        if np.count_nonzero(kept) < _LEAST_PIXELS:
            return None
        struck = kept & (seen > np.median(seen[kept]) + self.limit_adu)
        for place in np.flatnonzero(struck):
            row, column = np.abs(self.places - self.places[:, place, None])
            kept &= (row > 1) | (column > 1)
        shapes = self.shapes[:, kept]
        amplitude = np.linalg.solve(shapes @ shapes.T, shapes @ seen[kept])
        return np.asarray(np.tensordot(amplitude, self.wave, axes=1))


def dark_bar(observation: Observation) -> BoolArray:
    """Return the pixels behind the upright bar of the cross mask, a margin inside its edges; (y, x)."""
    area, geometry = observation.area, observation.psf.geometry
    half, pixel = geometry.mask_half_width_arcsec, geometry.pixel_scale_arcsec
    inside = (area.columns > -half + _TRAIL_PIXELS * pixel) & (area.columns < half - pixel)
    bar = np.zeros(observation.shape, dtype=np.bool_)
    rows = slice(None) if observation.first_pixel else observation.instrument.detector.sections["active"][0]
    bar[rows, inside] = True
    return bar


def frame_level(
    observation: Observation, level_pixels: ArrayLike | None, *, flaws: NDArray[np.uint8], mean_e: FloatArray
) -> FrameLevel | None:
    """Return the fit of the level for frames of an observation.

    Parameters
    ----------
    observation : Observation
    level_pixels : array_like of bool or None
        Pixels to fit; those of `dark_bar` if None.
    flaws : ndarray of uint8
        `MaskBit` of the pixels: flawed ones are left out.
    mean_e : ndarray
        Dark current and clock-induced charge of a frame, at the register input.

    Returns
    -------
    FrameLevel or None
        None where the camera has neither drift nor pick-up.

    Raises
    ------
    InputError
        For fewer than 100 pixels, or an array that is no mask of them.
    """
    detector, gain = observation.instrument.detector, observation.em_gain
    structure, switches = detector.bias_structure, detector.switches
    drifts = switches.bias_drift and structure.drift_adu > 0
    waves = switches.interference and structure.interference_adu > 0
    if not drifts and not waves:
        return None
    chosen = dark_bar(observation) if level_pixels is None else level_pixels
    pixels = np.flatnonzero(check_mask("level_pixels", chosen, observation.shape, empty=True) & (flaws == MaskBit.GOOD))
    if pixels.size < _LEAST_PIXELS:
        allowed = f"at least {_LEAST_PIXELS} pixels"
        hint = "name pixels without light, or switch off bias_drift and interference"
        raise InputError("level_pixels", pixels.size, unit="px", allowed=allowed, hint=hint)
    along_rows, along_columns = wave_angles(detector, observation.shape, *(observation.first_pixel or (0, 0)))
    angle = along_rows[:, None] + along_columns
    shapes = [np.ones(observation.shape)] + ([np.sin(angle), np.cos(angle)] if waves else [])
    wave = np.stack(shapes)
    mean = mean_e.reshape(-1)[pixels]
    rest_e2 = FrameNoise.of(detector, gain, observation.exposure_s).rest_e2
    sigma = math.hypot(math.hypot(detector.read_noise_e, detector.gain_e_adu) / gain, math.sqrt(rest_e2))
    limit = PixelLaw(gain, detector.register_stages, sigma, _FALSE_ALARM).limit_of_mean(mean) - mean
    to_adu = gain / detector.gain_e_adu
    return FrameLevel(
        pixels=pixels,
        places=np.stack(np.divmod(pixels, observation.shape[1])),
        mean_adu=mean * to_adu,
        limit_adu=limit * to_adu + 2.0 * structure.interference_adu,
        shapes=wave.reshape(len(wave), -1)[:, pixels],
        wave=wave,
    )


# The light that sets the white noise is smooth on the scale of the optics; the noise of its own measurement is not.
SMOOTHING_PIXELS = 1.5


class Inputs(NamedTuple):
    """The inputs from which a stack was reduced.

    Attributes
    ----------
    science_e : ndarray, shape (n, n)
        Mean science frame.
    library_e : ndarray, shape (m, n, n)
        Reference images per frame, scaled to the brightness of the science star.
    frames : float
        Number of science frames.
    other_star : bool
        Whether the references show another star, whose sky leaves an even level.
    """

    science_e: FloatArray
    library_e: FloatArray
    frames: float
    other_star: bool


@dataclass(frozen=True, eq=False)
class ReducedStack:
    """The result of the reduction of one observation; images are star-centred stamps (y, x).

    Attributes
    ----------
    image_e : ndarray, shape (n, n)
        Residual in electrons at the register input, summed over the science frames; 0 outside ``region``.
    region : ndarray of bool, shape (n, n)
        Pixels that took part.
    white_variance_e2 : ndarray, shape (n, n)
        Variance of ``image_e`` from photons with their excess noise, dark current, smear, clock-induced charge, read
        noise and rounding, of science and reference frames; speckles are not in it. 0 outside ``region``.
    halo_e : ndarray, shape (n, n)
        Light of the reference frames scaled to the summed science frames, smoothed, without dark current and
        clock-induced charge; 0 outside ``region``.
    rdi : RdiResult
        The projection, and with it the forward model of a planet.
    integration_s : float
        Sum of the science exposures.
    factor2 : float
        Variance over mean of the electrons that are counted.
    inputs : Inputs or None
        What it was reduced from; None where that is not kept, and it cannot be reduced otherwise.
    """

    image_e: FloatArray
    region: BoolArray
    white_variance_e2: FloatArray
    halo_e: FloatArray
    rdi: RdiResult
    integration_s: float
    factor2: float
    inputs: Inputs | None = field(default=None, repr=False)

    def within(self, region: BoolArray, n_modes: int) -> "ReducedStack":
        """Reduce the same images over part of their pixels, with modes of those alone.

        Parameters
        ----------
        region : ndarray of bool, shape (n, n)
        n_modes : int
            Modes that are projected out after the mean, at least 0.

        Notes
        -----
        The projection is linear: the mean science frame tells the sum of the residuals.
        """
        assert self.inputs is not None  # as `reduce_stack` makes it
        inside, made, centering = region & self.region, self.inputs, self.rdi.centering
        cut = rdi_subtract(made.science_e[None], made.library_e, n_modes, region=inside, centering=centering)
        return replace(
            self,
            image_e=_summed(cut, np.array([made.frames]), made.other_star),
            region=cut.region,
            white_variance_e2=np.where(inside, self.white_variance_e2, 0.0),
            halo_e=np.where(inside, self.halo_e, 0.0),
            rdi=cut,
        )


def _summed(cut: RdiResult, frames: FloatArray, other_star: bool) -> FloatArray:
    """Return the sum of residuals of images of so many frames; another star's sky, an even level, is taken off."""
    image = np.tensordot(frames, cut.residuals, axes=1)
    if other_star:
        image[cut.region] -= image[cut.region].mean()
    return np.asarray(image)


@numeric_context()
def reduce_stack(
    science_e: ArrayLike,
    reference_e: ArrayLike,
    *,
    region: BoolArray,
    n_modes: int,
    exposure_s: float,
    em_gain: float,
    detector: AnyDetector,
    science_frames: ArrayLike = 1,
    reference_frames: ArrayLike = 1,
    reference_scale: float = 1.0,
    noise_free_reference: bool = False,
    smear_e: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0),
    counting: CountingLaw | None = None,
    centering: str = "temporal",
) -> ReducedStack:
    """Subtract what the references make together and their leading modes, and sum.

    Parameters
    ----------
    science_e, reference_e : array_like, shapes (k, n, n) and (m, n, n)
        Frames, or sums of frames, in electrons at the register input; dark current and clock-induced charge included.
    region : ndarray of bool, shape (n, n)
        The dark hole without unusable pixels.
    n_modes : int
        Modes that are projected out after the mean.
    exposure_s, em_gain : float
        Of one frame.
    detector : Detector or InfraredDetector
        Noise of its frames.
    science_frames, reference_frames : array_like
        Number of frames in each image, one number for all or one each.
    reference_scale : float
        Brightness of the science star over that of the reference star, above 0.
    noise_free_reference : bool
        Whether the reference images are expectations, without noise of their own.
    smear_e : tuple of array_like
        Mean electrons that smeared into every pixel of a science and of a reference frame. They were taken off; their
        noise stays.
    counting : CountingLaw, optional
        Of counts of photons from which the electrons were worked out.
    centering : str
        As in `rdi_subtract`.

    Raises
    ------
    InputError
        If shapes, counts or the scale do not fit.

    Notes
    -----
    Images are divided by their number of frames before the projection and the residuals summed with it. The variance
    uses the light of the reference frames, smoothed over 1.5 px, for both: the science frames hold the planet. The sky
    of a reference star is scaled with its light, which leaves an even level: the mean of the region is taken off (a
    median would not do: counts of few electrons are skewed).
    """
    science, reference = np.asarray(science_e, float), np.asarray(reference_e, float)
    for key, images in (("science_e", science), ("reference_e", reference)):
        if images.ndim != 3:
            raise InputError(key, images.shape, unit="px", allowed="images (k, y, x)")
    science_n = frame_counts("science_frames", science_frames, len(science))
    reference_n = frame_counts("reference_frames", reference_frames, len(reference))
    if not reference_scale > 0:
        raise InputError("reference_scale", reference_scale, allowed="above 0")
    noise = FrameNoise.of(detector, em_gain, exposure_s)
    dark_e = noise.pedestal_e

    def frame_variance_e2(charge_e: FloatArray) -> FloatArray:
        return noise.charge_variance_e2(charge_e) if counting is None else counting_variance(charge_e, counting)

    library = (reference / reference_n[:, None, None] - dark_e) * reference_scale + dark_e
    cut = rdi_subtract(science / science_n[:, None, None], library, n_modes, region=region, centering=centering)
    total, library_total = float(science_n.sum()), float(reference_n.sum())
    light = smoothed((library * reference_n[:, None, None]).sum(axis=0) / library_total - dark_e, region)
    seen = np.maximum(light, 0.0)
    inside = seen + dark_e + smear_e[0]
    variance = total * frame_variance_e2(inside)
    if not noise_free_reference:
        # Held in a frame of the reference: its light before it was scaled, and the rest as it is.
        held = seen / reference_scale + dark_e + smear_e[1]
        added = REDUCTIONS[centering].reference_variance(len(reference), n_modes)
        variance += added * (total**2 / library_total * reference_scale**2 * frame_variance_e2(held))
    other_star, factor2 = reference_scale != 1.0, noise.factor2
    if counting is not None:
        about = np.median(inside[region]) * np.array([1.0, 1.01])
        factor2 = float(np.diff(counting_variance(about, counting))[0] / np.diff(about)[0])
    return ReducedStack(
        image_e=_summed(cut, science_n, other_star),
        region=cut.region,
        white_variance_e2=np.where(region, variance, 0.0),
        halo_e=np.where(region, total * light, 0.0),
        rdi=cut,
        integration_s=total * exposure_s,
        factor2=factor2,
        inputs=Inputs(science.sum(axis=0) / total, library, total, other_star),
    )


def pedestal_e(detector: AnyDetector, exposure_s: float) -> float:
    """Return the mean electrons of dark current and clock-induced charge in a pixel of one frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    exposure_s : float
        Of the frame.
    """
    return FrameNoise.of(detector, 1.0, exposure_s).pedestal_e


def smoothed(image: FloatArray, region: BoolArray, width_pixels: float = SMOOTHING_PIXELS) -> FloatArray:
    """Return the Gaussian mean over the pixels of a region alone, 0 outside.

    Parameters
    ----------
    image : ndarray, shape (y, x)
    region : ndarray of bool, shape (y, x)
    width_pixels : float
        Standard deviation of the Gaussian, above 0.
    """
    from scipy.ndimage import gaussian_filter

    inside = np.where(region, image, 0.0)
    weight = gaussian_filter(region.astype(float), width_pixels)
    smooth = gaussian_filter(inside, width_pixels) / np.where(region, weight, 1.0)
    return np.where(region, smooth, 0.0)
