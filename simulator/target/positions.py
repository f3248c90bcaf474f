"""Sky offsets and detector offsets: the one place where parity and roll are applied."""

import numpy as np

from cpic_core import ArrayLike, InputError, check_finite, check_number


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
    pa, roll = check_finite("pa_deg", pa_deg, "deg"), check_number("roll_deg", roll_deg, "deg")
    with np.errstate(over="ignore"):
        angle = np.deg2rad(check_finite("pa_deg - roll_deg", pa - roll, "deg"))
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
    with np.errstate(over="ignore"):
        separation = check_finite("separation_arcsec", np.hypot(x, y), "arcsec")
    # A tiny negative angle rounds to 360 itself.
    return separation, np.where(pa == 360.0, 0.0, pa)


def wcs_keywords(
    pixel_scale_arcsec: float,
    star_pixel: tuple[float, float],
    star_deg: tuple[float | None, float | None],
    *,
    roll_deg: float = 0.0,
    parity: int = -1,
) -> dict[str, float | str]:
    """World coordinates of an image: the FITS keywords that say what `sky_to_detector` does.

    Parameters
    ----------
    pixel_scale_arcsec : float
        Pixel.
    star_pixel : tuple of float
        Column and row of the star, counted from 0.
    star_deg : tuple of float or None
        Right ascension and declination of the star. If unknown the axes are offsets from the star in degrees toward
        east and north (``CTYPE`` ``EAST`` and ``NORTH``).
    roll_deg : float
        Rotation of the sky on the detector.
    parity : {-1, +1}
        Orientation of the detector.
    """
    step = pixel_scale_arcsec / 3600.0
    angle = np.deg2rad(check_number("roll_deg", roll_deg, "deg"))
    sine, cosine, flip = float(np.sin(angle)), float(np.cos(angle)), _parity(parity)
    cards: dict[str, float | str] = {"CTYPE1": "EAST", "CTYPE2": "NORTH", "CUNIT1": "deg", "CUNIT2": "deg"}
    cards |= {"CRPIX1": star_pixel[0] + 1.0, "CRPIX2": star_pixel[1] + 1.0, "CRVAL1": 0.0, "CRVAL2": 0.0}
    ra_deg, dec_deg = star_deg
    if ra_deg is not None and dec_deg is not None:
        cards |= {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRVAL1": float(ra_deg), "CRVAL2": float(dec_deg)}
    cards |= {"CD1_1": flip * step * cosine, "CD1_2": step * sine}
    return cards | {"CD2_1": -flip * step * sine, "CD2_2": step * cosine}


def _parity(parity: int) -> int:
    if parity not in (-1, 1):
        raise InputError("parity", parity, allowed="-1, +1")
    return parity
