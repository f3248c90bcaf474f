"""Detection by a visit: the significance and probability of planets that stand anywhere, and false alarms.

False alarms are noise that passes the threshold, and background stars that pass for planets.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from catalogs import OrbitPlaces
from cpic_core import ArrayLike, BoolArray, FloatArray, IntArray, NDArray, Record
from cpic_planner import etc
from cpic_planner.ranking import faintest_contrast, ring_of
from cpic_planner.survey.strategy import DetectionRule, SurveyStrategy, UniverseConfig
from cpic_planner.survey.universe import PlanetSample
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec

_UNSEEN = {"reached_blind": -math.inf, "width_blind": 1.0, "reached_known": -math.inf, "width_known": 1.0}
_ERRORS = 6.0  # standard errors by which a law may be off
_ROLLS = 32  # at once: tables of the companion's light take memory


class Setting(Record):
    """Frames of one observation of a star in a band: of each of the visits that are reduced together.

    ``time_s`` is wall time of them all with readouts and reference frames; no frames: it is not possible.
    """

    band: str
    exposure_s: float
    n_frames: float
    em_gain: float
    time_s: float

    @property
    def possible(self) -> bool:
        """Whether there is a frame."""
        return self.n_frames >= 1

    @property
    def frames(self) -> tuple[float, float, float]:
        """Exposure, number of frames and gain, as the noise of a stack takes them."""
        return self.exposure_s, self.n_frames, self.em_gain


class ExpectedSignals(Record, eq=False):
    """The signals that visits expect of planets; arrays of one shape.

    ``margin`` is significance over the small-sample threshold, 0 where the aperture leaves the dark quadrants or no
    threshold is defined there; ``reached_blind`` and ``reached_known`` the logarithm of significance over that at which
    half of the planets are detected, of a blind search that looks along orbits and at a known place, and
    ``width_blind`` and ``width_known`` the widths of the law in it (`cpic_planner.etc.SearchLaw.reach`). The others are
    the planet's own, ``pa_deg`` east of north.
    """

    margin: FloatArray
    reached_blind: FloatArray
    width_blind: FloatArray
    reached_known: FloatArray
    width_known: FloatArray
    snr: FloatArray
    contrast: FloatArray
    separation_arcsec: FloatArray
    pa_deg: FloatArray


def programme_of(model: etc.EtcModel, setting: Setting) -> etc.Programme:
    """Return the visits of a setting that are reduced together, each begun after the one before it.

    Parameters
    ----------
    model : EtcModel
        Its strategy says how many there are, and how long the telescope waits between them.
    setting : Setting
    """
    return etc.Programme.of(model.strategy, visit_time_s=model.time_s(_visit_s(model, setting)))


def _visit_s(model: etc.EtcModel, setting: Setting) -> float:
    """Return the length of the science part of a visit."""
    return setting.n_frames * (setting.exposure_s + model.camera(setting.band).readout_s)


def least_factor(rule: DetectionRule, *, errors: bool = True) -> float:
    """Return the least factor on the significance at which the law detects, by what a rule says of the search.

    Parameters
    ----------
    rule : DetectionRule
    errors : bool
        With whatever calibration and middle of the law its errors allow in a universe.
    """
    if rule.rule == "expected":
        return 1.0
    off = _ERRORS * (rule.half_error + rule.calibration_error) if errors else 0.0
    return rule.half_factor / rule.calibration * math.exp(-off)


def faintest_of(
    model: etc.EtcModel, stars: Targets, settings: Sequence[Setting], rule: DetectionRule, *, errors: bool = True
) -> FloatArray:
    """Return the contrast below which a visit detects no planet, by star and ring; see `faintest_contrast`.

    Parameters
    ----------
    model : EtcModel
    stars : Targets
        ``n`` stars.
    settings : sequence of Setting
        A visit of each of them, all in one band.
    rule : DetectionRule
    errors : bool
        As of `least_factor`.

    Returns
    -------
    ndarray, shape (n, ring)
    """
    frames = np.array([(item.exposure_s, item.n_frames, item.em_gain) for item in settings]).T
    return min(least_factor(rule, errors=errors), 1.0) * faintest_contrast(
        model,
        stars,
        settings[0].band,
        **dict(zip(("exposure_s", "n_frames", "em_gain"), frames, strict=True)),
        visits=np.full(len(stars), float(model.strategy.visits or 1)),
        law=None if rule.rule == "expected" else etc.band_law(model, settings[0].band),
    )


class Pairs(Record, eq=False):
    """Planets at some of the dates of visits: arrays ``(k,)``.

    Attributes
    ----------
    visit, planet : ndarray of int
        Position of the visit and of the planet.
    east_au, north_au, distance_au, phase_deg : ndarray
        As of `catalogs.OrbitPlaces`.
    """

    visit: NDArray[np.int32]
    planet: NDArray[np.int32]
    east_au: FloatArray
    north_au: FloatArray
    distance_au: FloatArray
    phase_deg: FloatArray

    @classmethod
    def between(cls, places: OrbitPlaces, inner_au: float, outer_au: float) -> "Pairs":
        """Return those whose projected distance lies between two, of places of shape ``(d, n)``."""
        apart = np.hypot(places.east_au, places.north_au)
        near = (apart >= inner_au) & (apart <= outer_au)
        visit, planet = (part.astype(np.int32) for part in np.nonzero(near))
        return cls(visit, planet, **{name: part[near] for name, part in vars(places).items()})


def pair_signals(
    model: etc.EtcModel,
    star: Targets,
    setting: Setting,
    planets: PlanetSample,
    albedos: tuple[AlbedoSpec, ...],
    pairs: Pairs,
    roll_deg: ArrayLike,
    zodis: FloatArray | None = None,
    faintest: FloatArray | None = None,
    at_place: bool = True,
    *,
    least: float = 0.0,
    margins: bool = True,
) -> tuple[IntArray, ExpectedSignals]:
    """Return which planets can be seen where they stand at visits, and what these expect of them.

    Parameters
    ----------
    model, star, setting, planets, albedos, roll_deg, zodis
        As of `expected_signals`.
    pairs : Pairs
        Which planets, and where they stand at which visit.
    faintest : ndarray, shape (ring,), optional
        Contrast below which planets are not looked at: nothing is seen of them (`faintest_of`).
    at_place : bool
        Whether any of them is looked for at a known place; if not, none is reached there.
    least : float
        Factor on the significance that has any chance in any noise, below which the law need not be asked
        (`least_factor`): nothing is reached there.
    margins : bool
        Whether the significance over the threshold is wanted; 0 if not.

    Returns
    -------
    some : ndarray of int
        Numbers of the pairs whose aperture lies in the dark hole whole.
    signals : ExpectedSignals
        Of these.
    """
    band, metrics = setting.band, model.metrics[setting.band]
    east, north = (part / float(star.distance_pc[0]) for part in (pairs.east_au, pairs.north_au))
    x, y, usable = on_detector(model, band, east, north, roll_deg, pairs.visit)
    some = np.flatnonzero(usable & setting.possible)
    x, y, visit, planet = x[some], y[some], pairs.visit[some], pairs.planet[some]
    separation, pa_deg = np.hypot(east[some], north[some]), np.rad2deg(np.arctan2(east[some], north[some]))
    margin, snr, contrast = np.zeros((3, some.size))
    reached, widths = np.full((2, some.size), -np.inf), np.ones((2, some.size))
    bright = np.arange(some.size)
    if some.size:
        kind, radius = planets.kind[planet][None], planets.radius_rjup[planet][None]
        distance, phase = pairs.distance_au[some][None], pairs.phase_deg[some][None]
        contrast = etc.mixture_contrast(model, star, band, albedos, kind, radius, distance, phase)[0]
        if faintest is not None:
            bright = np.flatnonzero(contrast >= faintest[ring_of(metrics.zone, separation)])
    if bright.size:
        # Only a companion's wings care for the roll, with two of them that of the places x and y.
        wings = np.isfinite(star.companion_v_mag[0]) and star.companions == "on"
        roll = np.asarray(roll_deg, float)[visit[bright]] + model.strategy.rolls_deg[-1]
        angles, which = np.unique(roll if wings else np.zeros(bright.size), return_inverse=True)
        made, law = programme_of(model, setting), etc.band_law(model, band)
        for begin in range(0, angles.size, _ROLLS):
            here = np.flatnonzero((which >= begin) & (which < begin + _ROLLS))
            rolls_deg = angles[begin : begin + _ROLLS]
            rolls = replace(star.select(np.zeros(rolls_deg.size, np.int64)), roll_deg=rolls_deg % 360.0)
            # One row a roll, as long as the longest; what is behind its last planet is that planet again.
            order = here[np.argsort(which[here], kind="stable")]
            count = np.bincount(which[here] - begin, minlength=rolls_deg.size)
            column = np.minimum(np.arange(count.max()), count[:, None] - 1)
            at = bright[order[(np.cumsum(count) - count)[:, None] + column]]
            real = np.arange(count.max()) < count[:, None]
            dust = None if zodis is None else zodis[planet[at]]
            rates = etc.aperture_rates(model, rolls, band, x[at], y[at], contrast[at], zodis=dust)
            noise = etc.stack_noise(rates, *setting.frames, model.camera(band), model.strategy, made)
            place = separation[at]
            elements, paid = metrics.resolution_elements(place), noise.significance
            snr[at[real]] = noise.snr[real]
            if margins:
                margin[at[real]] = (paid / etc.threshold_array(elements, model.strategy.sigma))[real]
            asked = real & (elements >= etc.MIN_ELEMENTS) & (paid > 0.0)
            if least > 0.0:
                asked &= paid >= least * law.least(place, etc.LEAST_PROBABILITY, at_place=at_place)
            put, row = at[asked], np.nonzero(asked)[0]
            search, visit_s = etc.search_motion(model, rolls, band, separation[put], row), _visit_s(model, setting)
            motion = etc.motion_factor(model, search, made, visit_s)
            light = etc.light_share(model, band, separation[put], visit_s)
            seen, visits = noise.at(asked), np.broadcast_to(made.effective(rates.speckle), at.shape)[asked]
            where = etc.own_share(seen), separation[put], etc.speckled_share(seen), etc.lit_share(seen, light), visits
            # At a known place the orbit is followed.
            for known, paid in enumerate((seen.significance / motion, seen.significance)[: 1 + at_place]):
                reached[known][put], widths[known][put] = law.reach(paid, *where, at_place=bool(known))
    found = reached[0], widths[0], reached[1], widths[1]
    return some, ExpectedSignals(margin, *found, snr, contrast, separation, pa_deg)


def expected_signals(
    model: etc.EtcModel,
    star: Targets,
    setting: Setting,
    planets: PlanetSample,
    albedos: tuple[AlbedoSpec, ...],
    places: OrbitPlaces,
    roll_deg: ArrayLike,
    zodis: FloatArray | None = None,
    faintest: FloatArray | None = None,
    at_place: bool = True,
) -> ExpectedSignals:
    """Return what visits at some dates expect of every planet.

    Parameters
    ----------
    model : EtcModel
    star : Targets
        One star.
    setting : Setting
    planets : PlanetSample
        ``n`` planets.
    albedos : tuple of AlbedoSpec
        By ``planets.kind``.
    places : OrbitPlaces
        Where they stand at each visit, shape ``(d, n)``.
    roll_deg : array_like, shape (d,)
        Position angle of the detector's +y axis at each visit.
    zodis : ndarray, shape (n,), optional
        Dust around the star of each planet; by default that of the model.
    faintest, at_place
        As of `pair_signals`.

    Returns
    -------
    ExpectedSignals
        Shape ``(d, n)``.

    Notes
    -----
    The aperture has to lie in the dark quadrants whole. Noise is that of `cpic_planner.etc.noise.stack_noise` at the
    planet's own place; a companion's wings turn with the roll. With a library of two rolls, half of it to either side,
    the aperture has to lie there at both, and to move by its diameter between them.
    """
    shape = places.phase_deg.shape
    every = Pairs.between(places, 0.0, math.inf)
    roll = np.broadcast_to(np.asarray(roll_deg, float), shape[:1])
    some, found = pair_signals(model, star, setting, planets, albedos, every, roll, zodis, faintest, at_place)
    whole = {name: np.full(every.visit.size, _UNSEEN.get(name, 0.0)) for name in vars(found)}
    east, north = (part / float(star.distance_pc[0]) for part in (every.east_au, every.north_au))
    whole |= {"separation_arcsec": np.hypot(east, north), "pa_deg": np.rad2deg(np.arctan2(east, north))}
    for name, part in vars(found).items():
        whole[name][some] = part
    return ExpectedSignals(**{name: part.reshape(shape) for name, part in whole.items()})


def on_detector(
    model: etc.EtcModel,
    band: str,
    east_arcsec: FloatArray,
    north_arcsec: FloatArray,
    roll_deg: ArrayLike,
    visit: Any = ...,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the places of planets on the detector, and whether a visit can see them there.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    east_arcsec, north_arcsec : ndarray
        Offsets from the star.
    roll_deg : array_like
        Position angle of the detector's +y axis.
    visit : ndarray of int, optional
        Which of these rolls each place is seen at; one each by default.

    Returns
    -------
    x, y : ndarray
        Place in arcsec, with two rolls that at the first.
    usable : ndarray of bool
        Whether the aperture lies in the dark hole whole, with two rolls at both, and moves by its diameter between.

    Notes
    -----
    As `simulator.target.sky_to_detector`, with the sine and cosine of each roll alone.
    """
    metrics, parity, rolls_deg = model.metrics[band], model.instrument.detector.parity, model.strategy.rolls_deg
    radius, places = metrics.aperture_radius_arcsec, []
    for turn in rolls_deg:
        angle = np.deg2rad(np.asarray(roll_deg, float) - turn)
        cosine, sine = np.cos(angle)[visit], np.sin(angle)[visit]
        x, y = east_arcsec * cosine - north_arcsec * sine, north_arcsec * cosine + east_arcsec * sine
        places.append((parity * x, y))
    usable = np.logical_and.reduce([metrics.zone.contains(*place, radius) for place in places])
    if len(rolls_deg) > 1:
        moved = 2.0 * np.hypot(east_arcsec, north_arcsec) * math.sin(math.radians(rolls_deg[-1]))
        usable &= moved >= 2.0 * radius
    return *places[0], usable


def reach_au(model: etc.EtcModel, distance_pc: float) -> tuple[float, float]:
    """Return the projected distances at which some band can show a planet of a star: corners of its dark hole.

    Parameters
    ----------
    model : EtcModel
    distance_pc : float
        Distance, pc, above 0.
    """
    inner = min(metrics.hole_inner_corner_arcsec for metrics in model.metrics.values())
    outer = max(metrics.owa_arcsec for metrics in model.metrics.values())
    return inner * distance_pc, outer * distance_pc


def looks_at_place(rule: DetectionRule, known: BoolArray) -> bool:
    """Return whether visits look for any planet at a known place, by the rule and what is known of each."""
    return rule.rule == "known_place" or bool(np.any(known))


def detection_chance(
    seen: ExpectedSignals, rule: DetectionRule, known: BoolArray, shift: ArrayLike = 0.0, calibration: ArrayLike = 1.0
) -> FloatArray:
    """Return the probability that a visit detects planets.

    Parameters
    ----------
    seen : ExpectedSignals
        What it expects of them.
    rule : DetectionRule
    known : ndarray of bool
        Planets whose place is known.
    shift : array_like
        Standard errors by which the law's middle is off.
    calibration : array_like
        Factor on a predicted SNR that gives that of images.

    Notes
    -----
    The law of a search (`cpic_planner.etc.SearchLaw`), blind and at a known place, where the orbit is followed.
    ``expected`` is a step at 1. Where nothing can be seen the chance is 0.
    """
    if rule.rule == "expected":
        return np.where(seen.margin >= 1.0, 1.0, 0.0)
    from scipy.special import ndtr

    with np.errstate(divide="ignore"):  # a calibration of 0 detects nothing
        off = np.log(np.asarray(calibration, float) / rule.half_factor) - rule.half_error * np.asarray(shift, float)
    blind = ndtr((seen.reached_blind + off) / seen.width_blind)
    at_place = np.fmax(blind, ndtr((seen.reached_known + off) / seen.width_known))
    chance: FloatArray = np.where(np.asarray(known, bool) | (rule.rule == "known_place"), at_place, blind)
    return chance


def rolled(star: Targets, roll_deg: float) -> Targets:
    """Return the star as a rolled detector sees it: its companion stands elsewhere on it.

    Parameters
    ----------
    star : Targets
    roll_deg : float
        Roll of the telescope, degrees; turns the sky on the detector.
    """
    return replace(star, roll_deg=roll_deg % 360.0)


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
    inside = metrics.zone.contains(x, y, metrics.aperture_radius_arcsec)
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
    (``reports/truth/blind_validator``).

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
_Each = tuple[tuple[Any, ...], ...]


def of_ways(targets: Targets, options: Ways, worked: Callable[[Targets, list[Setting]], Iterable[Any]]) -> _Each:
    """Return something of each way to visit stars, by star and option.

    Parameters
    ----------
    targets : Targets
    options : tuple of tuple of Setting
        Ways to visit each star.
    worked : callable
        Returns it for some stars, each with a visit in the same band.
    """
    every = [(i, o, way) for i, ways in enumerate(options) for o, way in enumerate(ways)]
    found = [[None] * len(ways) for ways in options]
    for band in dict.fromkeys(way.band for *_, way in every):
        stars, places, settings = zip(*(item for item in every if item[2].band == band), strict=True)
        for i, o, value in zip(stars, places, worked(targets.select(list(stars)), list(settings)), strict=True):
            found[i][o] = value
    return tuple(map(tuple, found))


def alarms(
    universe: UniverseConfig, strategy: SurveyStrategy, model: etc.EtcModel, targets: Targets, options: Ways
) -> tuple[_Each, _Each]:
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

    def background(stars: Targets, settings: list[Setting]) -> list[float]:
        if universe.background == "off":
            return [0.0] * len(settings)
        return list(background_alarms(model, stars, settings, strategy.detection).tolist())

    noise = tuple(tuple(noise_alarms(model, way.band) for way in ways) for ways in options)
    return noise, of_ways(targets, options, background)
