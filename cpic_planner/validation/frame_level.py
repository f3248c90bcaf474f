"""Level and electrical pick-up of single frames, measured on pixels that no light reaches.

The bias drifts from frame to frame, and a sine of known period and unknown phase is picked up during readout. Both are
fitted behind the upright bar of the cross mask: no light of star or planet gets there, nor does charge that transfers
leave behind along a column, so that the fit cannot touch a source.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from cpic_planner.validation.clean_law import limit_of_mean
from simulator.camera.frame import MaskBit
from simulator.camera.noise import FrameNoise
from simulator.detectors.readout import wave_angles
from simulator.observation import Observation

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

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

    pixels: npt.NDArray[np.intp]
    places: npt.NDArray[np.intp]
    mean_adu: FloatArray
    limit_adu: FloatArray
    shapes: FloatArray
    wave: FloatArray

    def of(self, image_adu: FloatArray, usable: BoolArray) -> FloatArray | None:
        """Level of a frame, (y, x), bias taken off before; None where too few pixels are usable.

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
    """Pixels behind the upright bar of the cross mask, a margin inside its edges; (y, x)."""
    area, geometry = observation.area, observation.psf.geometry
    half, pixel = geometry.mask_half_width_arcsec, geometry.pixel_scale_arcsec
    inside = (area.columns > -half + _TRAIL_PIXELS * pixel) & (area.columns < half - pixel)
    bar = np.zeros(observation.shape, dtype=np.bool_)
    rows = slice(None) if observation.first_pixel else observation.instrument.detector.sections["active"][0]
    bar[rows, inside] = True
    return bar


def frame_level(
    observation: Observation, level_pixels: npt.ArrayLike | None, *, flaws: npt.NDArray[np.uint8], mean_e: FloatArray
) -> FrameLevel | None:
    """Fit of the level for frames of an observation.

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
    chosen = dark_bar(observation) if level_pixels is None else np.asarray(level_pixels)
    if chosen.dtype != np.bool_ or chosen.shape != observation.shape:
        raise InputError(
            "level_pixels",
            f"{chosen.dtype} array of shape {chosen.shape}",
            allowed=f"booleans of shape {observation.shape}",
        )
    pixels = np.flatnonzero(chosen & (flaws == MaskBit.GOOD))
    if pixels.size < _LEAST_PIXELS:
        raise InputError(
            "level_pixels",
            pixels.size,
            unit="px",
            allowed=f"at least {_LEAST_PIXELS} pixels",
            hint="name pixels without light, or switch off bias_drift and interference",
        )
    along_rows, along_columns = wave_angles(detector, observation.shape, *(observation.first_pixel or (0, 0)))
    angle = along_rows[:, None] + along_columns
    shapes = [np.ones(observation.shape)] + ([np.sin(angle), np.cos(angle)] if waves else [])
    wave = np.stack(shapes)
    mean = mean_e.reshape(-1)[pixels]
    rest_e2 = FrameNoise.of(detector, gain, observation.exposure_s).rest_e2
    sigma = math.hypot(math.hypot(detector.read_noise_e, detector.gain_e_adu) / gain, math.sqrt(rest_e2))
    limit = (
        limit_of_mean(mean, em_gain=gain, stages=detector.register_stages, sigma_e=sigma, false_alarm=_FALSE_ALARM)
        - mean
    )
    to_adu = gain / detector.gain_e_adu
    return FrameLevel(
        pixels=pixels,
        places=np.stack(np.divmod(pixels, observation.shape[1])),
        mean_adu=mean * to_adu,
        limit_adu=limit * to_adu + 2.0 * structure.interference_adu,
        shapes=wave.reshape(len(wave), -1)[:, pixels],
        wave=wave,
    )
