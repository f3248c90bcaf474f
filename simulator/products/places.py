"""Places on the sky of what stands at an offset on the detector."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.products.sequence import FrameSequence
from simulator.target.positions import detector_to_sky

__all__ = ["pointing_deg", "sky_places", "star_deg"]

FloatArray = NDArray[np.float64]


def star_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Right ascension and declination of the target; None if it has none."""
    star = None if sequence.scene is None else sequence.scene.cstar
    if star is None or star.ra_deg is None or star.dec_deg is None:
        return None
    return float(star.ra_deg), float(star.dec_deg)


def sky_places(
    sequence: FrameSequence, x_arcsec: ArrayLike, y_arcsec: ArrayLike
) -> tuple[FloatArray, FloatArray] | None:
    """Right ascension and declination at offsets from the target on the detector; None if it has no coordinates.

    Parameters
    ----------
    sequence : FrameSequence
    x_arcsec, y_arcsec : array_like
        Offsets along columns and rows.
    """
    from astropy import units as u
    from astropy.coordinates import offset_by

    star = star_deg(sequence)
    if star is None:
        return None
    separation, angle = detector_to_sky(x_arcsec, y_arcsec, roll_deg=sequence.roll_deg, parity=_parity(sequence))
    ra, dec = offset_by(star[0] * u.deg, star[1] * u.deg, angle * u.deg, separation * u.arcsec)
    return np.asarray(ra.to_value("deg")) % 360.0, np.asarray(dec.to_value("deg"))


def pointing_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Place on the sky of the centre of the mask; None if the target has no coordinates."""
    offset = [-float(sequence.header.get(key) or 0.0) for key in ("STAROFFX", "STAROFFY")]
    if not any(offset):
        return star_deg(sequence)
    places = sky_places(sequence, *offset)
    return None if places is None else (float(places[0]), float(places[1]))


def _parity(sequence: FrameSequence) -> int:
    """Orientation of the detector: that of the world coordinates where they are given."""
    names = ("CD1_1", "CD1_2", "CD2_1", "CD2_2")
    if not all(name in sequence.header for name in names):
        return sequence.instrument.detector.parity
    a, b, c, d = (float(sequence.header[name]) for name in names)
    return 1 if a * d > b * c else -1
