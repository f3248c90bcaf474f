"""Light that belongs to a star, wherever in its dark hole is looked: its own, its neighbours', and the sky's around it.

The stars of a scene are those of its images: `simulator.target.scene_sources` gives their light to both.
"""

import functools
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.etc.model import EtcModel
from cpic_planner.targets import Targets
from simulator.config import Instrument, Scene
from simulator.effects import sky_rates_e_s_arcsec2, stray_light_map
from simulator.imaging import PsfMetrics
from simulator.signal import sky_pixel_e_s

if TYPE_CHECKING:
    from simulator.target import Source

_T = TypeVar("_T")


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


class _Same(Generic[_T]):
    """An object that counts as equal to itself alone."""

    def __init__(self, it: _T) -> None:
        self.it = it

    def __hash__(self) -> int:
        return id(self.it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.it is self.it


@functools.lru_cache(maxsize=1024)
def _kept(model: _Same[EtcModel], star: _Same[Targets], band: str) -> tuple[FloatArray, FloatArray]:
    found = _light(model.it, star.it, band)
    for array in found:
        array.flags.writeable = False
    return found


def _light(model: EtcModel, targets: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    if targets.scene is None:
        own = star_e_s(model, band, targets, targets.v_mag, targets.teff_k)
    else:
        own = np.full(len(targets), _scene_stars(_Same(model), _Same(targets.scene), band)[0].rate_e_s)
    return own, aperture_sky_e_s(model, targets, band)


@functools.lru_cache(maxsize=64)
def _scene_stars(model: _Same[EtcModel], scene: _Same[Scene], band: str) -> "tuple[Source, ...]":
    """Return the stars that images of a scene show, the central one first."""
    from simulator.target import scene_sources

    return scene_sources(scene.it.without_planets(), model.it.instrument, band)


class Neighbours(NamedTuple):
    """Stars beside the targets whose light and place are known, ``(k,)`` each.

    Attributes
    ----------
    row : ndarray of int
        Number of the target beside which the star stands.
    separation_arcsec, pa_deg : ndarray
        Its place at the targets' roll; the angle is nan where it is not known.
    rate_e_s : ndarray
        Its light on the clear disc.
    """

    row: IntArray
    separation_arcsec: FloatArray
    pa_deg: FloatArray
    rate_e_s: FloatArray

    def where(self, chosen: BoolArray) -> "Neighbours":
        """Return some of them."""
        place = self.separation_arcsec[chosen], self.pa_deg[chosen]
        return Neighbours(self.row[chosen], *place, self.rate_e_s[chosen])


def neighbours(model: EtcModel, targets: Targets, band: str) -> Neighbours:
    """Return all other stars of a target's scene, or the nearest companions of catalogue stars, where these count.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    """
    if targets.scene is not None:
        from simulator.target import detector_to_sky

        stars = _scene_stars(_Same(model), _Same(targets.scene), band)[1:]
        x, y, rate = (np.array([getattr(star, key) for star in stars]) for key in ("x_arcsec", "y_arcsec", "rate_e_s"))
        separation, pa_deg = detector_to_sky(x, y, parity=model.instrument.detector.parity)
        row = np.repeat(np.arange(len(targets)), len(stars))
        found = Neighbours(row, *(np.tile(part, len(targets)) for part in (separation, pa_deg, rate)))
    else:
        known = np.isfinite(targets.companion_v_mag) & np.isfinite(targets.companion_separation_arcsec)
        row = np.flatnonzero(known & (targets.companions != "off"))
        near = targets.select(row)
        light = star_e_s(model, band, near, near.companion_v_mag, near.companion_teff_k)
        found = Neighbours(row, near.companion_separation_arcsec, near.companion_pa_deg, light)
    return found._replace(pa_deg=found.pa_deg - np.broadcast_to(targets.roll_deg, len(targets))[found.row])


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
