"""False alarms of a visit: noise that passes the threshold, and background stars that pass for planets."""

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_planner.etc import EtcModel, aperture_rates, effective_of, stack_noise, threshold_array
from cpic_planner.ranking import inside_zone
from cpic_planner.survey.detection import Setting, half_margin, programme_of, tail_share
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.targets import Targets

LOWEST_LATITUDE_DEG = 10.0
"""Nearer to the Galactic plane the counts are those of this latitude: the law, which is stated for 20 degrees and more
and knows no dust, runs away there."""
_BRIGHTEST, _FAINTEST = 5.0, 30.0
_STEPS, _PROBE = 16, 1e-9
_ARCSEC2_DEG2 = 3600.0**2
# Direction of the Galactic pole and of the centre, ICRS (Hipparcos catalogue, vol. 1, sect. 1.5.3).
_POLE_RA_DEG, _POLE_DEC_DEG, _NODE_DEG = 192.85948, 27.12825, 32.93192


def galactic_deg(ra_deg: ArrayLike, dec_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Galactic longitude (0 to 360) and latitude of ICRS places, degrees.

    Parameters
    ----------
    ra_deg : array_like
        ICRS right ascension, degrees.
    dec_deg : array_like
        ICRS declination, degrees.
    """
    ra, dec = np.deg2rad(np.asarray(ra_deg, float) - _POLE_RA_DEG), np.deg2rad(np.asarray(dec_deg, float))
    pole = np.deg2rad(_POLE_DEC_DEG)
    sine = np.sin(dec) * np.sin(pole) + np.cos(dec) * np.cos(pole) * np.cos(ra)
    along = np.arctan2(np.sin(dec) * np.cos(pole) - np.cos(dec) * np.sin(pole) * np.cos(ra), np.cos(dec) * np.sin(ra))
    return (np.rad2deg(along) + _NODE_DEG) % 360.0, np.rad2deg(np.arcsin(np.clip(sine, -1.0, 1.0)))


def star_counts_deg2(v_mag: ArrayLike, longitude_deg: ArrayLike, latitude_deg: ArrayLike) -> FloatArray:
    """Stars brighter than V, per square degree, at a Galactic place.

    Parameters
    ----------
    v_mag : array_like
        Limit; taken between 5 and 30.
    longitude_deg, latitude_deg : array_like
        Latitudes below `LOWEST_LATITUDE_DEG` count as that.

    Notes
    -----
    Equation B1 of Bahcall & Soneira 1980 (ApJS 44, 73): a disc ``C1 10^(beta d) / (1 + 10^(alpha d))^delta / (sin b (1
    - mu cot b cos l))^(3 - 5 gamma)`` with ``d = V - 15.75``, and a spheroid ``C2 10^(eta h) / (1 + 10^(kappa
    h))^lambda / (1 - cos b cos l)^sigma`` with ``h = V - 17.5``. Good to 15 % for latitudes of 20 degrees and more;
    nearer to the plane, where dust and arms rule, the order of magnitude.
    """
    limit = np.clip(np.asarray(v_mag, float), _BRIGHTEST, _FAINTEST)
    b = np.deg2rad(np.maximum(np.abs(np.asarray(latitude_deg, float)), LOWEST_LATITUDE_DEG))
    cosine = np.cos(np.deg2rad(np.asarray(longitude_deg, float)))
    faint = np.clip(limit, 12.0, 20.0) - 12.0
    mu, gamma = 0.03 + 0.0075 * faint, 0.36 - 0.04 * faint
    projection = np.maximum(np.sin(b) * (1.0 - mu * cosine / np.tan(b)), 0.02)
    from_disc = limit - 15.75
    disc = 925.0 * 10.0 ** (0.035 * from_disc) / (1.0 + 10.0 ** (-0.132 * from_disc)) ** 3.0
    from_halo = limit - 17.5
    halo = 1050.0 * 10.0 ** (0.087 * from_halo) / (1.0 + 10.0 ** (-0.180 * from_halo)) ** 2.5
    to_centre = np.cos(b) * cosine
    spheroid = halo / np.maximum(1.0 - to_centre, 0.02) ** (1.45 - 0.20 * to_centre)
    return np.asarray(disc / projection ** (3.0 - 5.0 * gamma) + spheroid)


def background_alarms(model: EtcModel, star: Targets, setting: Setting, rule: DetectionRule) -> float:
    """Expected background stars that one visit detects in the dark quadrants.

    Parameters
    ----------
    model : EtcModel
    star : Targets
        One star.
    setting : Setting
    rule : DetectionRule
        Where half of the planets are detected, background stars are counted.

    Notes
    -----
    The limiting contrast at every place of the hole becomes a limiting magnitude, with the colour of the star, and that
    a number of stars. Every visit counts anew: nearby stars move by an arcsec or more between visits a year apart.
    """
    metrics, band = model.metrics[setting.band], setting.band
    if not setting.possible:
        return 0.0
    axis = (np.arange(-_STEPS, _STEPS) + 0.5) / _STEPS * metrics.hole_outer_arcsec
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    inside = inside_zone(metrics.zone, x, y, metrics.aperture_radius_arcsec)
    x, y = x[inside], y[inside]
    if not x.size:
        return 0.0
    rates = aperture_rates(model, star, band, x[None], y[None], np.full((1, x.size), _PROBE))
    made = programme_of(model, setting)
    noise = stack_noise(rates, *setting.frames, model.camera(band), model.strategy, made)
    separation = np.hypot(x, y)
    threshold = threshold_array(metrics.resolution_elements(separation), model.strategy.sigma)
    tails, inward = tail_share(model, setting, separation[None], noise)[0], metrics.lambda_d_arcsec / separation
    middle = half_margin(rule, np.zeros(x.size, bool), tails, inward, effective_of(made, rates.speckle))
    with np.errstate(divide="ignore"):
        faintest = middle * _PROBE * threshold / noise.significance[0]
    good = np.isfinite(faintest) & (faintest > 0.0)
    limit = float(star.v_mag[0]) - 2.5 * np.log10(faintest[good])
    density = star_counts_deg2(limit, *galactic_deg(star.ra_deg, star.dec_deg)) / _ARCSEC2_DEG2
    return float(density.sum() * (axis[1] - axis[0]) ** 2)


def noise_alarms(model: EtcModel, band: str) -> float:
    """Expected noise peaks of one visit above the threshold of a blind search.

    The thresholds keep the false-alarm probability of ``sigma`` in every resolution element, an area of
    ``(lambda/D)^2`` of the dark hole (`cpic_planner.validation.search`); images hold it (``reports/blind_validator``).

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    from scipy.special import ndtr

    metrics = model.metrics[band]
    elements = np.count_nonzero(metrics.hole) * (metrics.pixel_scale_arcsec / metrics.lambda_d_arcsec) ** 2
    return float(elements * ndtr(-model.strategy.sigma))
