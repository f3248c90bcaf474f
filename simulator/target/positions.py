"""Sky offsets and detector offsets: the one place where parity and roll are applied."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from catalogs.errors import InputError
from simulator.quantities import check_finite, check_number

__all__ = ["detector_to_sky", "sky_to_detector"]


def sky_to_detector(
    separation_arcsec: ArrayLike, pa_deg: ArrayLike, *, roll_deg: float = 0.0, parity: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detector offset from the star of a source at a separation and position angle.

    ``x = parity rho sin(PA - roll)``, ``y = rho cos(PA - roll)``. With parity -1 (the paper's text) and
    roll 0, north is +y and east is -x; with +1 (the orientation of its figures) east is +x.

    Parameters
    ----------
    separation_arcsec : array_like
        Separation, at least 0.
    pa_deg : array_like
        Position angle, degrees east of north.
    roll_deg : float
        Rotation of the sky on the detector; it never rotates mask, hole or speckles.
    parity : {-1, +1}
        Orientation of the detector.

    Returns
    -------
    x_arcsec, y_arcsec : ndarray
        Offsets, broadcast shape.

    Raises
    ------
    InputError
        If a value is not finite, the separation negative or the parity another number.
    """
    rho = check_finite("separation_arcsec", separation_arcsec, "arcsec")
    if np.any(rho < 0.0):
        raise InputError("separation_arcsec", float(rho.min()), unit="arcsec", allowed="at least 0")
    angle = np.deg2rad(check_finite("pa_deg", pa_deg, "deg") - check_number("roll_deg", roll_deg, "deg"))
    # Adding zero turns the -0 of the star itself into 0.
    return _parity(parity) * rho * np.sin(angle) + 0.0, rho * np.cos(angle) + 0.0


def detector_to_sky(
    x_arcsec: ArrayLike, y_arcsec: ArrayLike, *, roll_deg: float = 0.0, parity: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return separation and position angle of a detector offset from the star.

    The inverse of `sky_to_detector`.

    Parameters
    ----------
    x_arcsec, y_arcsec : array_like
        Detector offsets from the star.
    roll_deg : float
        Rotation of the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.

    Returns
    -------
    separation_arcsec, pa_deg : ndarray
        Separation and position angle, 0 <= PA < 360; PA is the roll angle at the star itself.

    Raises
    ------
    InputError
        If a value is not finite or the parity another number than -1 and +1.
    """
    x, y = check_finite("x_arcsec", x_arcsec, "arcsec"), check_finite("y_arcsec", y_arcsec, "arcsec")
    roll = check_number("roll_deg", roll_deg, "deg")
    pa = np.mod(np.rad2deg(np.arctan2(_parity(parity) * x, y)) + roll, 360.0)
    # A tiny negative angle rounds to 360 itself.
    return np.hypot(x, y), np.where(pa == 360.0, 0.0, pa)


def _parity(parity: int) -> int:
    if parity not in (-1, 1):
        raise InputError("parity", parity, allowed="-1, +1")
    return parity
