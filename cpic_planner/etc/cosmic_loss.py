"""What cosmic rays cost: frames in which a track touches the photometric aperture."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.camera.checks import checked_array
from simulator.camera.track_loss import aperture_loss_per_s, mean_projection_um

__all__ = ["aperture_loss_per_s", "clean_fraction", "frames_per_clean", "mean_projection_um"]

FloatArray = NDArray[np.float64]

# Beyond this exponent no frame is clean, exp(-600) = 3e-261 of them; sums of what it multiplies stay finite.
_ALL_VOID = 600.0


def clean_fraction(loss_per_s: ArrayLike, exposure_s: ArrayLike) -> FloatArray:
    """Fraction of frames whose aperture no track touches, ``exp(-loss_per_s exposure_s)``.

    Parameters
    ----------
    loss_per_s : array_like
        `aperture_loss_per_s`, at least 0.
    exposure_s : array_like
        Exposure of a frame, at least 0.

    Returns
    -------
    ndarray
        0 to 1; arguments broadcast.

    Raises
    ------
    InputError
        If an argument is negative or not finite.
    """
    loss = checked_array("loss_per_s", loss_per_s, low=0.0, unit="1/s")
    exposure = checked_array("exposure_s", exposure_s, low=0.0, unit="s")
    with np.errstate(over="ignore"):  # an infinite number of tracks leaves no frame
        return np.asarray(np.exp(-loss * exposure))


def frames_per_clean(loss_per_s: ArrayLike, exposure_s: ArrayLike) -> FloatArray:
    """Frames to take for one that no track touches, ``exp(loss_per_s exposure_s)``, at most 4e260; no checks."""
    return np.asarray(np.exp(np.minimum(np.asarray(loss_per_s, float) * exposure_s, _ALL_VOID)))
