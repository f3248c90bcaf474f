"""Light of the sky in the aperture, as the images have it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel
from cpic_planner.targets import Targets
from simulator.config import Instrument
from simulator.effects.sky import sky_rate_e_s_arcsec2
from simulator.effects.stray_light import stray_light_map

__all__ = ["aperture_sky_e_s"]

FloatArray = NDArray[np.float64]


def aperture_sky_e_s(model: EtcModel, targets: Targets, band: str) -> FloatArray:
    """Electrons per second of sky, earthshine and stray light in an aperture of the hole.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str

    Returns
    -------
    ndarray, shape (n_targets,) or (1,)
        One value for all targets where the sky is the same everywhere. A map of stray light counts with its mean over
        the hole.

    Raises
    ------
    InputError
        If the sky depends on the target's place and a target has none.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    aperture_arcsec2 = np.pi * metrics.aperture_radius_arcsec**2
    if instrument.sky.model == "uniform":
        rates = np.array([sky_rate_e_s_arcsec2(instrument, band).rate_e_s_arcsec2])
    else:
        rates = np.array(
            [
                sky_rate_e_s_arcsec2(
                    instrument, band, ra_deg=float(ra), dec_deg=float(dec), start_utc=instrument.mission.start_utc
                ).rate_e_s_arcsec2
                for ra, dec in zip(targets.ra_deg, targets.dec_deg, strict=True)
            ]
        )
    sky = rates * aperture_arcsec2 * metrics.apodizer_energy
    return np.asarray(sky + _stray_e_s_pixel(instrument, band, metrics.hole) * metrics.aperture_pixels)


def _stray_e_s_pixel(instrument: Instrument, band: str, hole: NDArray[np.bool_]) -> float:
    detector = instrument.detector_of(band)
    stray = stray_light_map(instrument, band, (detector.n_rows, detector.n_columns))
    if stray is None:
        return 0.0
    rows, columns = np.nonzero(hole)
    row = rows - hole.shape[0] // 2 + detector.star_row
    column = columns - hole.shape[1] // 2 + detector.star_column
    inside = (row >= 0) & (row < stray.shape[0]) & (column >= 0) & (column < stray.shape[1])
    return float(stray[row[inside], column[inside]].mean()) if inside.any() else 0.0
