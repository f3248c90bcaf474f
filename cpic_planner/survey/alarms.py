"""False alarms of a visit: noise that passes the threshold, and background stars that pass for planets."""

from collections.abc import Iterator, Sequence

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_planner import etc
from cpic_planner.ranking import inside_zone
from cpic_planner.survey.detection import Setting, faintest_of
from cpic_planner.survey.strategy import DetectionRule, SurveyStrategy
from cpic_planner.survey.strategy_file import UniverseConfig
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
    """Return the galactic longitude (0 to 360) and latitude of ICRS places, degrees.

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
    """Return the stars brighter than V, per square degree, at a Galactic place.

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


def background_alarms(
    model: etc.EtcModel, stars: Targets, settings: Sequence[Setting], rule: DetectionRule
) -> FloatArray:
    """Return the expected background stars that one visit of each star detects in the dark quadrants, shape ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    stars : Targets
        ``n`` stars.
    settings : sequence of Setting
        That of the visit of each, all of one band; visits that are not possible detect nothing.
    rule : DetectionRule
        Where half of the planets are detected, background stars are counted.

    Notes
    -----
    The limiting contrast at every place of the hole becomes a limiting magnitude, with the colour of the star, and that
    a number of stars. Every visit counts anew: nearby stars move by an arcsec or more between visits a year apart.
    """
    expected = np.zeros(len(stars))
    some = [k for k, setting in enumerate(settings) if setting.possible]
    if not some:
        return expected
    band, chosen = settings[some[0]].band, stars.select(some)
    metrics, camera = model.metrics[band], model.camera(band)
    axis = (np.arange(-_STEPS, _STEPS) + 0.5) / _STEPS * metrics.hole_outer_arcsec
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    inside = inside_zone(metrics.zone, x, y, metrics.aperture_radius_arcsec)
    x, y = x[inside], y[inside]
    if not x.size:
        return expected
    exposure, frames, gain = (np.array(part)[:, None] for part in zip(*(settings[k].frames for k in some), strict=True))
    visit_s = frames * (exposure + camera.readout_s)
    rates = etc.aperture_rates(model, chosen, band, x[None], y[None], np.full((len(some), x.size), _PROBE))
    made = etc.Programme.of(model.strategy, visit_time_s=model.time_s(visit_s))
    noise = etc.stack_noise(rates, exposure, frames, gain, camera, model.strategy, made)
    separation = np.hypot(x, y)[None]
    if rule.rule == "expected":
        needed = etc.threshold_array(metrics.resolution_elements(separation), model.strategy.sigma)
    else:
        light, visits = etc.light_share(model, band, separation, visit_s), made.effective(rates.speckle)
        where = separation, etc.speckled_share(noise), etc.lit_share(noise, light), visits
        law = etc.band_law(model, band)
        needed = rule.half_factor * law.half(*where, at_place=rule.rule == "known_place")
    with np.errstate(divide="ignore"):
        faintest = _PROBE * needed / noise.significance
    good = np.isfinite(faintest) & (faintest > 0.0)
    limit = chosen.v_mag[:, None] - 2.5 * np.log10(np.where(good, faintest, 1.0))
    longitude, latitude = (part[:, None] for part in galactic_deg(chosen.ra_deg, chosen.dec_deg))
    density = np.where(good, star_counts_deg2(limit, longitude, latitude), 0.0) / _ARCSEC2_DEG2
    expected[some] = density.sum(axis=1) * (axis[1] - axis[0]) ** 2
    return expected


def noise_alarms(model: etc.EtcModel, band: str) -> float:
    """Return the expected noise peaks of one visit above the threshold of a blind search.

    The thresholds keep the false-alarm probability of ``sigma`` in every resolution element, an area of
    ``(lambda/D)^2`` of the dark hole (`cpic_planner.etc.search_threshold`); images hold it
    (``reports/blind_validator``).

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


Ways = tuple[tuple[Setting, ...], ...]
"""Ways to visit some stars."""
_Rates = tuple[tuple[float, ...], ...]


def alarms(
    universe: UniverseConfig, strategy: SurveyStrategy, model: etc.EtcModel, targets: Targets, options: Ways
) -> tuple[_Rates, _Rates]:
    """Return the expected false alarms of a visit by star and option: of noise, and of background stars.

    Parameters
    ----------
    universe : UniverseConfig
        Says whether background stars make any.
    strategy : SurveyStrategy
    model : EtcModel
    targets : Targets
    options : tuple of tuple of Setting
        Ways to visit each star.
    """
    noise = tuple(tuple(noise_alarms(model, way.band) for way in ways) for ways in options)
    background = [[0.0] * len(ways) for ways in options]
    for places, stars, settings in by_band(targets, options) if universe.background == "on" else ():
        found = background_alarms(model, stars, settings, strategy.detection)
        for (i, o), expected in zip(places, found.tolist(), strict=True):
            background[i][o] = expected
    return noise, tuple(map(tuple, background))


def by_band(targets: Targets, options: Ways) -> Iterator[tuple[list[tuple[int, int]], Targets, list[Setting]]]:
    """Yield the visits of each band: positions of star and option, the stars, and the settings.

    Parameters
    ----------
    targets : Targets
    options : tuple of tuple of Setting
        Ways to visit each star.
    """
    every = [(i, o, way) for i, ways in enumerate(options) for o, way in enumerate(ways)]
    for band in dict.fromkeys(way.band for *_, way in every):
        own = [item for item in every if item[2].band == band]
        yield [(i, o) for i, o, _ in own], targets.select([i for i, *_ in own]), [way for *_, way in own]


def faintest_by_way(
    strategy: SurveyStrategy, model: etc.EtcModel, targets: Targets, options: Ways
) -> tuple[tuple[FloatArray, ...], ...]:
    """Return the contrast below which a visit shows no planet, by star, option and ring.

    Parameters
    ----------
    strategy : SurveyStrategy
    model : EtcModel
    targets : Targets
    options : tuple of tuple of Setting
        Ways to visit each star.
    """
    found = [[np.zeros(0)] * len(ways) for ways in options]
    for places, stars, settings in by_band(targets, options):
        for (i, o), rings in zip(places, faintest_of(model, stars, settings, strategy.detection), strict=True):
            found[i][o] = rings
    return tuple(map(tuple, found))
