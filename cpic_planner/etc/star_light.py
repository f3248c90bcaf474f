"""Light that belongs to a star, wherever in its dark hole is looked: its own, and that of the sky around it."""

import functools

import numpy as np

from cpic_core import FloatArray
from cpic_planner.etc.model import EtcModel
from cpic_planner.targets import Targets
from simulator.config import Instrument
from simulator.effects import sky_rates_e_s_arcsec2, stray_light_map
from simulator.imaging import PsfMetrics
from simulator.signal import sky_pixel_e_s


def light_of(model: EtcModel, targets: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    """Return the electrons per second of stars on the clear disc, and of their sky in an aperture, ``(n,)`` each.

    Those of a single star are kept: whoever asks about it asks again, about another place or time.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str

    Raises
    ------
    InputError
        As `aperture_sky_e_s`.
    """
    return _kept(_Same(model), _Same(targets), band) if len(targets) == 1 else _light(model, targets, band)


class _Same:
    """An object that counts as equal to itself alone."""

    def __init__(self, it: EtcModel | Targets) -> None:
        self.it = it

    def __hash__(self) -> int:
        return id(self.it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.it is self.it


@functools.lru_cache(maxsize=1024)
def _kept(model: _Same, star: _Same, band: str) -> tuple[FloatArray, FloatArray]:
    assert isinstance(model.it, EtcModel)
    assert isinstance(star.it, Targets)
    found = _light(model.it, star.it, band)
    for array in found:
        array.flags.writeable = False
    return found


def _light(model: EtcModel, targets: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    own = star_e_s(model, band, targets, targets.v_mag, targets.teff_k)
    return own, aperture_sky_e_s(model, targets, band)


def star_e_s(model: EtcModel, band: str, targets: Targets, v_mag: FloatArray, teff_k: FloatArray) -> FloatArray:
    """Return the light of stars on the clear disc, e-/s, with surface gravity and metallicity of the targets, ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    band : str
    targets : Targets
        ``n`` stars.
    v_mag, teff_k : ndarray, shape (n,)
        Of the stars, or of their companions.
    """
    area = model.instrument.telescope.area_cm2
    rate = model.passbands.star_rate_e_s(v_mag, teff_k, targets.log_g, targets.metallicity, area)
    return np.asarray(rate[:, model.passbands.names.index(band)])


def aperture_sky_e_s(model: EtcModel, targets: Targets, band: str) -> FloatArray:
    """Return the electrons per second of sky, earthshine and stray light in an aperture of the hole.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str

    Returns
    -------
    ndarray, shape (n_targets,)
        A map of stray light counts with its mean over the hole.

    Raises
    ------
    InputError
        If the sky is that of a date and a target has no place.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    start = targets.date_utc or instrument.mission.start_utc
    sky = sky_pixel_e_s(metrics, sky_rates_e_s_arcsec2(instrument, band, targets.ra_deg, targets.dec_deg, start))
    return np.asarray((sky + _stray_e_s_pixel(instrument, band, metrics)) * metrics.aperture_pixels)


def sky_in_core(
    model: EtcModel, band: str, sky_e_s: FloatArray, x_arcsec: FloatArray, y_arcsec: FloatArray
) -> FloatArray:
    """Return what an aperture at (x, y) gets of the light of `aperture_sky_e_s`.

    Parameters
    ----------
    model : EtcModel
    band : str
    sky_e_s : ndarray
        Broadcasts with the places.
    x_arcsec, y_arcsec : ndarray
    """
    metrics = model.metrics[band]
    share, pixels = metrics.sky_share(x_arcsec, y_arcsec), metrics.core_pixels(x_arcsec, y_arcsec)
    if isinstance(share, float) and isinstance(pixels, float):
        return sky_e_s
    stray = _stray_e_s_pixel(model.instrument, band, metrics) * metrics.aperture_pixels
    return np.asarray((stray + (sky_e_s - stray) * share) * (pixels / metrics.aperture_pixels))


def _stray_e_s_pixel(instrument: Instrument, band: str, metrics: PsfMetrics) -> float:
    """Return the mean stray light on the pixels of the hole that lie on the detector."""
    detector = instrument.detector_of(band)
    stray = stray_light_map(instrument, band, (detector.n_rows, detector.n_columns))
    if stray is None:
        return 0.0
    rows, columns = np.nonzero(metrics.hole)
    row = rows - metrics.hole.shape[0] // 2 + detector.star_row
    column = columns - metrics.hole.shape[1] // 2 + detector.star_column
    inside = (row >= 0) & (row < stray.shape[0]) & (column >= 0) & (column < stray.shape[1])
    return float(stray[row[inside], column[inside]].mean()) if inside.any() else 0.0
