"""One-call forms of the visible camera: a noiseless map, a noisy frame, and back to electrons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from simulator.camera.frame import Frame
from simulator.camera.visible import VisibleCamera
from simulator.config.detector import Detector
from simulator.quantities import checked_array, checked_scalar
from simulator.rng import PathPart

FloatArray = npt.NDArray[np.float64]
_MOST_ADU = 1e100


def expected_adu_map(rate_e_s_map: npt.ArrayLike, exposure_s: float, em_gain: float, detector: Detector) -> FloatArray:
    """Mean ADU of every pixel, without noise and without rounding.

    Parameters
    ----------
    rate_e_s_map : array_like
        Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape around the star.
    exposure_s : float
        Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
    em_gain : float
        Actual gain of the register, 1 to ``detector.em_gain_max``.
    detector : Detector
        The camera.

    Returns
    -------
    ndarray
        As `simulator.camera.VisibleCamera.expected_adu`. With every effect off ``rate t g / K + bias``.

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or negative (naming the pixel), or another argument out of range.
    """
    camera = VisibleCamera(detector)
    return camera.expected_adu(camera.prepare(rate_e_s_map, exposure_s, em_gain))


def expose_frame(
    rate_map_e_s: npt.ArrayLike,
    exposure_s: float,
    em_gain: float,
    detector: Detector,
    *,
    seed: int,
    path: Sequence[PathPart],
) -> Frame:
    """One noisy frame, without cosmic rays.

    Parameters
    ----------
    rate_map_e_s : array_like
        Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape around the star.
    exposure_s, em_gain, detector
        As `expected_adu_map`.
    seed : int
        Seed of the run.
    path : sequence of str or int
        Names of target, role, band, realisation, frame. Each effect draws from a stream of its own.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), or
        another argument out of range.
    """
    camera = VisibleCamera(detector)
    return camera.expose(camera.prepare(rate_map_e_s, exposure_s, em_gain), seed=seed, path=path)


def to_electrons(adu: npt.ArrayLike, detector: Detector, em_gain: float) -> FloatArray:
    """Electrons at the register input: ``(adu - bias) gain_e_adu / em_gain``; dark and clock charge included.

    Raises
    ------
    InputError
        If ``em_gain`` is out of range, or a number is not finite.
    """
    gain = checked_scalar("em_gain", em_gain, low=1.0, high=detector.em_gain_max)
    level = checked_array("adu", adu, low=-_MOST_ADU, high=_MOST_ADU, unit="ADU", allowed="finite")
    return (level - detector.bias_adu) * (detector.gain_e_adu / gain)
