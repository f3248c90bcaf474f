"""Dark current against temperature."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simulator.camera.checks import checked_array
from simulator.config.detector import Detector

__all__ = ["dark_law_e_s", "dark_rate_e_s"]

FloatArray = npt.NDArray[np.float64]


def dark_law_e_s(temperature_k: npt.ArrayLike, dark_293k_e_s: npt.ArrayLike) -> FloatArray:
    """Thermal dark current of a pixel in inverted mode.

    Parameters
    ----------
    temperature_k : array_like
        Temperature of the detector, 120 to 320 K.
    dark_293k_e_s : array_like
        Dark current at 293 K, at least 0 e-/s per pixel; broadcasts.

    Returns
    -------
    ndarray
        ``dark_293k 1.14e6 T^3 exp(-9080 / T)`` in e-/s per pixel (e2v CCD201-20 data sheet; 0.3 % below
        ``dark_293k_e_s`` at 293 K, within 20 % of the curve of the sheet from 233 K to 293 K). Below 230 K the law is
        extrapolated.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    temperature = checked_array("temperature_k", temperature_k, low=120.0, high=320.0, unit="K")
    level = checked_array("dark_293k_e_s", dark_293k_e_s, low=0.0, unit="e-/s")
    return np.asarray(level * 1.14e6 * temperature**3 * np.exp(-9080.0 / temperature))


def dark_rate_e_s(detector: Detector) -> float:
    """Mean dark current of a pixel, e-/s: what cooling does not remove, and the law at the detector's temperature."""
    return detector.dark_e_s + float(dark_law_e_s(detector.temperature_k, detector.dark_293k_e_s))
