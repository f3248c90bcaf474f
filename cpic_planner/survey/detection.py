"""Whether a visit shows planets that stand anywhere: significance over threshold, and the chance of a detection.

False alarms of a visit: noise that passes the threshold, and background stars that pass for planets.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from catalogs import OrbitPlaces
from cpic_core import ArrayLike, BoolArray, FloatArray
from cpic_planner.etc import (
    EtcModel,
    Programme,
    SearchMotion,
    StackNoise,
    aperture_rates,
    detection,
    effective_of,
    mixture_contrast,
    stack_noise,
    threshold_array,
)
from cpic_planner.ranking import inside_zone
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import PlanetSample
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec
from simulator.imaging import PsfMetrics
from simulator.target import sky_to_detector

_ROLLS = 32  # at once: tables of the companion's light take memory


@dataclass(frozen=True)
class Setting:
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


@dataclass(frozen=True, eq=False)
class ExpectedSignals:
    """What visits expect of planets; arrays of one shape.

    ``margin`` is significance over the small-sample threshold, 0 where the aperture leaves the dark quadrants or no
    threshold is defined there; ``tails`` the share of the noise, as rms, that is light of the wavefront's errors, and
    ``inward`` the width of a resolution element over the separation, both 0 there too. The others are the planet's own,
    ``pa_deg`` east of north. ``visits`` are the independent wavefronts behind the noise (`effective_of`), 1 where
    nothing is seen, and ``motion`` the factor on the threshold of a blind search that looks along orbits.
    """

    margin: FloatArray
    tails: FloatArray
    inward: FloatArray
    snr: FloatArray
    contrast: FloatArray
    separation_arcsec: FloatArray
    pa_deg: FloatArray
    distance_au: FloatArray
    phase_deg: FloatArray
    visits: FloatArray = field(default_factory=lambda: np.ones(()))
    motion: FloatArray = field(default_factory=lambda: np.ones(()))


def programme_of(model: EtcModel, setting: Setting) -> Programme:
    """Return the visits of a setting that are reduced together, each begun after the one before it.

    Parameters
    ----------
    model : EtcModel
        Its strategy says how many there are, and how long the telescope waits between them.
    setting : Setting
    """
    return Programme.of(model.strategy, visit_time_s=model.time_s(_visit_s(model, setting)))


def _visit_s(model: EtcModel, setting: Setting) -> float:
    """Length of the science part of a visit."""
    return setting.n_frames * (setting.exposure_s + model.camera(setting.band).readout_s)


def expected_signals(
    model: EtcModel,
    star: Targets,
    setting: Setting,
    planets: PlanetSample,
    albedos: tuple[AlbedoSpec, ...],
    places: OrbitPlaces,
    roll_deg: ArrayLike,
) -> ExpectedSignals:
    """What visits at some dates expect of every planet.

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
    band = setting.band
    metrics = model.metrics[band]
    roll = np.broadcast_to(np.asarray(roll_deg, float)[:, None], shape)
    separation_au = np.hypot(places.east_au, places.north_au)
    separation = separation_au / float(star.distance_pc[0])
    pa_deg = np.rad2deg(np.arctan2(places.east_au, places.north_au))
    x, y = sky_to_detector(separation, pa_deg - roll, parity=model.instrument.detector.parity)
    margin, tails, inward, snr, contrast = np.zeros((5, *shape))
    visits, motion = np.ones((2, *shape))
    usable = inside_zone(metrics.zone, x, y, metrics.aperture_radius_arcsec)
    first = model.strategy.rolls_deg[-1]
    if len(model.strategy.rolls_deg) > 1:
        x, y, usable = _at_two_rolls(model, metrics, separation, pa_deg - roll)
    if setting.possible and usable.any():
        visit, planet = np.nonzero(usable)
        kind, radius = planets.kind[planet][None], planets.radius_rjup[planet][None]
        distance, phase = places.distance_au[usable][None], places.phase_deg[usable][None]
        light = mixture_contrast(model, star, band, albedos, kind, radius, distance, phase)[0]
        contrast[usable] = light
        # Only a companion's wings care for the roll, with two of them that of the places x and y.
        wings = np.isfinite(star.companion_v_mag[0]) and star.companions == "on"
        angles, which = np.unique((roll + first)[usable] if wings else np.zeros(light.shape), return_inverse=True)
        made = programme_of(model, setting)
        for begin in range(0, angles.size, _ROLLS):
            here = np.flatnonzero((which >= begin) & (which < begin + _ROLLS))
            turned = angles[begin : begin + _ROLLS]
            rolls = replace(star.select(np.zeros(turned.size, np.int64)), roll_deg=turned % 360.0)
            # One row a roll, as long as the longest; what is behind its last planet is that planet again.
            order = here[np.argsort(which[here], kind="stable")]
            count = np.bincount(which[here] - begin, minlength=turned.size)
            column = np.minimum(np.arange(count.max()), count[:, None] - 1)
            every = order[(np.cumsum(count) - count)[:, None] + column]
            real = np.arange(count.max()) < count[:, None]
            put = (visit[every[real]], planet[every[real]])
            at = (visit[every], planet[every])
            rates = aperture_rates(model, rolls, band, x[at], y[at], light[every])
            noise = stack_noise(rates, *setting.frames, model.camera(band), model.strategy, made)
            elements = metrics.resolution_elements(separation[at])
            moving = SearchMotion.of(model, rolls, band, separation[at])
            margin[put] = (noise.significance / threshold_array(elements, model.strategy.sigma))[real]
            tails[put] = tail_share(model, setting, separation[at], noise)[real]
            inward[put] = metrics.lambda_d_arcsec / separation[put]
            snr[put] = noise.snr[real]
            visits[put] = np.broadcast_to(effective_of(made, rates.speckle), real.shape)[real]
            motion[put] = np.broadcast_to(moving.factor(made, _visit_s(model, setting)), real.shape)[real]
    others = places.distance_au, places.phase_deg, visits, motion
    return ExpectedSignals(margin, tails, inward, snr, contrast, separation, pa_deg, *others)


def _at_two_rolls(
    model: EtcModel, metrics: PsfMetrics, separation_arcsec: FloatArray, pa_deg: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Places at the first of two rolls, and whether planets can be told from themselves at the second."""
    half, parity = model.strategy.rolls_deg[-1], model.instrument.detector.parity
    first, second = (sky_to_detector(separation_arcsec, pa_deg + turn, parity=parity) for turn in (-half, half))
    radius = metrics.aperture_radius_arcsec
    usable = inside_zone(metrics.zone, *first, radius) & inside_zone(metrics.zone, *second, radius)
    usable &= 2.0 * separation_arcsec * math.sin(math.radians(half)) >= 2.0 * radius
    return first[0], first[1], usable


def reach_au(model: EtcModel, distance_pc: float) -> tuple[float, float]:
    """Projected distances at which any band of a model can show a planet of a star: corners of its dark hole.

    Parameters
    ----------
    model : EtcModel
    distance_pc : float
        Distance, pc, above 0.
    """
    inner = min(metrics.hole_inner_arcsec for metrics in model.metrics.values()) * math.sqrt(2.0)
    outer = max(metrics.owa_arcsec for metrics in model.metrics.values())
    return inner * distance_pc, outer * distance_pc


def tail_share(model: EtcModel, setting: Setting, separation_arcsec: FloatArray, noise: StackNoise) -> FloatArray:
    """Return `cpic_planner.etc.tail_share` of the noise of a setting, at projected separations in arcsec."""
    return detection.tail_share(model, setting.band, separation_arcsec, _visit_s(model, setting), noise)


def half_margin(
    rule: DetectionRule, known: ArrayLike, tails: ArrayLike, inward: ArrayLike, visits: ArrayLike = 1.0
) -> FloatArray:
    """Significance over threshold at which half of the planets are detected.

    Parameters
    ----------
    rule : DetectionRule
        ``expected`` is a step at 1; any other follows the law of `cpic_planner.etc.detection.half_margin`.
    known : array_like of bool
        Planets whose place is known.
    tails, inward, visits : array_like
        As of `ExpectedSignals`.
    """
    if rule.rule == "expected":
        return np.ones(np.broadcast_shapes(np.shape(known), np.shape(tails)))
    return detection.half_margin(rule, _at_place(rule, known), tails, inward, visits)


def detection_chance(
    seen: ExpectedSignals, rule: DetectionRule, known: BoolArray, shift: ArrayLike = 0.0, calibration: ArrayLike = 1.0
) -> FloatArray:
    """Probability that a visit detects planets.

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
        Recovered over predicted SNR.

    Notes
    -----
    The law that images follow (`cpic_planner.etc.detection.detection_probability`), for a blind search and at a known
    place, where the orbit is followed. ``expected`` is a step at 1. Where nothing can be seen the chance is 0.
    """
    if rule.rule == "expected":
        return np.where(seen.margin >= 1.0, 1.0, 0.0)
    at_place = _at_place(rule, known)
    expected = seen.margin / np.where(at_place, 1.0, seen.motion), at_place, seen.tails, seen.inward
    return detection.detection_probability(rule, *expected, visits=seen.visits, shift=shift, calibration=calibration)


def _at_place(rule: DetectionRule, known: ArrayLike) -> BoolArray:
    """Planets that are looked for at a known place under a rule."""
    return np.asarray(known, bool) | (rule.rule == "known_place")


def rolled(star: Targets, roll_deg: float) -> Targets:
    """The star as a rolled detector sees it: its companion stands elsewhere on it.

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
