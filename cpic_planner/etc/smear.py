"""Light that smears into an aperture while the frame is shifted into the store: there is no shutter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.model import EtcModel

__all__ = ["ApertureSmear", "aperture_smear", "companion_column"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ApertureSmear:
    """Electrons per frame that smear into an aperture, whatever the exposure: from the star, companions, the sky."""

    star_e: FloatArray
    companion_e: FloatArray
    even_e: FloatArray

    @property
    def total_e(self) -> FloatArray:
        """All of it."""
        return self.star_e + self.companion_e + self.even_e


def aperture_smear(
    model: EtcModel,
    band: str,
    x_arcsec: FloatArray,
    *,
    star_e_s: FloatArray,
    companion_column_e_s: FloatArray,
    sky_e_s: FloatArray,
) -> ApertureSmear:
    """Smear of one frame in apertures at x.

    Parameters
    ----------
    model : EtcModel
    band : str
    x_arcsec : ndarray
        Offset of the aperture from the star along the rows.
    star_e_s : ndarray
        Light of the star on the clear disc.
    companion_column_e_s : ndarray
        Light of companions in the columns under the aperture, for each of its pixels (`companion_column`).
    sky_e_s : ndarray
        Sky and stray light in the aperture.

    Notes
    -----
    Every pixel passes under the light of its column for ``line_shift_s`` a row: it collects ``line_shift_s`` times the
    light of all other rows, once a frame (`simulator.camera.visible`). Calibration takes the mean off; the noise stays.
    The planet, dust around the star and dark current are left out: they add less than 2e-3 s of their own light.
    """
    shift = model.camera(band).line_shift_s
    if shift == 0.0:
        nothing = np.zeros(())
        return ApertureSmear(nothing, nothing, nothing)
    metrics = model.metrics[band]
    active = model.instrument.detector_of(band).sections["active"][0]
    lit = active.stop - active.start - 2.0 * metrics.mask_half_width_arcsec / metrics.pixel_scale_arcsec
    return ApertureSmear(
        star_e=shift * star_e_s * metrics.column_aperture(x_arcsec),
        companion_e=shift * companion_column_e_s,
        even_e=shift * lit * sky_e_s,
    )


def companion_column(
    model: EtcModel, band: str, there: tuple[FloatArray, FloatArray], x_arcsec: FloatArray, wing: ArrayLike
) -> FloatArray:
    """Light of unit companions in the columns under apertures, for each of their pixels.

    Parameters
    ----------
    model : EtcModel
    band : str
    there : tuple of ndarray
        Places x and y of the companions.
    x_arcsec : ndarray
        Of the apertures; broadcasts.
    wing : array_like
        Light of the companions in the apertures.

    Returns
    -------
    ndarray
        Of a companion in the active rows the light of its column; of one beyond them that of its wings, as if all rows
        held as much as the aperture does.
    """
    metrics, detector = model.metrics[band], model.instrument.detector_of(band)
    active = detector.sections["active"][0]
    row = detector.star_row + there[1] / metrics.pixel_scale_arcsec
    seen = (row >= active.start) & (row < active.stop) & (np.abs(there[1]) >= metrics.mask_half_width_arcsec)
    column = metrics.source_column_aperture(x_arcsec - there[0])
    return np.where(seen, column, (active.stop - active.start) * np.asarray(wing, float))
