"""Completeness: the planets of a population that one observation of each star detects, all or still possible."""

import functools
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, check_finite, real_array
from cpic_planner import etc
from cpic_planner.planets import Planets, StarLimits
from cpic_planner.ranking.in_zone import N_RINGS, Placed, ZonePlanets, faintest_contrast, rectangles
from cpic_planner.ranking.programmes import programme_of
from cpic_planner.results import DetectionMode
from cpic_planner.targets import Targets
from simulator.target import albedo_notes, albedo_source, needs_insolation


@dataclass(frozen=True, eq=False)
class BandCompleteness:
    """Fractions of a population in one band, arrays over the stars.

    Attributes
    ----------
    band : str
    search : {"blind", "known_place"}
        How these planets are looked for, which says which of the two completenesses counts.
    n_planets : int
        Planets drawn, the same for every star.
    completeness, completeness_known_place : ndarray
        Fraction that the one observation detects and that nothing known excludes, by a search that does not know where
        planets stand and by one that does: the mean, over the planets, of the probability of a detection times that of
        being there still.
    completeness_unconditional, completeness_known_place_unconditional : ndarray
        Fraction detected by the one observation, whatever is known.
    standard_error : ndarray
        Of `counted`, by the number of planets drawn; 0 where none or all are detected, and then below 3 / n with 95 %.
    in_zone : ndarray
        Fraction that stands in the dark quadrants.
    observable : ndarray
        Fraction whose whole aperture lies there: no observation detects more.
    expected_planets, expected_planets_unconditional : ndarray or None
        The completeness that counts times the population's planets per star, if it has an occurrence rate.
    flags : tuple of str
        What was clamped or extrapolated for some planet, and a dark hole that is not as dark as asked.
    """

    band: str
    search: DetectionMode
    n_planets: int
    completeness: FloatArray
    completeness_known_place: FloatArray
    completeness_unconditional: FloatArray
    completeness_known_place_unconditional: FloatArray
    standard_error: FloatArray
    in_zone: FloatArray
    observable: FloatArray
    expected_planets: FloatArray | None
    expected_planets_unconditional: FloatArray | None
    flags: tuple[str, ...]

    @property
    def counted(self) -> FloatArray:
        """Completeness of the search that these planets are looked for by."""
        return self.completeness if self.search == "blind" else self.completeness_known_place


@dataclass(frozen=True, eq=False)
class _Setting:
    """Frames of one visit and visits of each star: arrays ``(n,)``, or ``(n, 1)`` of those that are looked at."""

    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    visits: FloatArray

    def of(self, stars: IntArray) -> "_Setting":
        """Return the frames of some stars, beside arrays of stars and planets."""
        return _Setting(*(value[stars][:, None] for value in vars(self).values()))


def completeness(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    planets: Planets,
    *,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    visits: ArrayLike = 1.0,
    limits: StarLimits | None = None,
    search: DetectionMode | None = None,
    around: ZonePlanets | None = None,
) -> BandCompleteness:
    """Return the fraction of a population that one observation of each star detects.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    planets : Planets
        The same planets at every star: stars are then told apart by what they are, not by the luck of the draw.
    exposure_s, n_frames, em_gain : array_like
        Setting of each star, one number or shape ``(n,)``; frames of one visit. No frames detect nothing, and their
        other numbers do not matter. Where photons are counted all stars have one gain.
    visits : array_like
        Visits of the observation of each star, likewise, at least 1; the strategy says how many references they have.
    limits : StarLimits, optional
        What is known of the ``n`` stars; without it every planet may exist.
    search : {"blind", "known_place"}, optional
        Which completeness counts, that of the model's strategy by default.
    around : ZonePlanets, optional
        These planets around these stars, where they are known.

    Returns
    -------
    BandCompleteness

    Raises
    ------
    InputError
        If the band is unknown, a setting is out of range, or a luminosity that is needed is unknown.

    Notes
    -----
    A planet can be detected if its whole photometric aperture lies in the dark zone at roll 0 and the small-sample
    threshold of its separation is defined, which it is not below three resolution elements. Its significance over that
    threshold then gives the probability of a detection, by the law that images follow
    (`cpic_planner.etc.visit_chances`); where no law was measured, a planet that reaches the threshold counts whole.
    Core throughput, halo and contrast are its own. The setting is not changed for it: one bright enough to saturate
    counts as detected.
    """
    if band not in model.metrics:
        raise InputError("band", band, allowed=", ".join(model.bands))
    exposure, frames, gain = _settings(model, len(targets), exposure_s, n_frames, em_gain)
    setting = _Setting(exposure, frames, gain, _one_each("visits", visits, len(targets)))
    counts = _Counts(model, targets, band, planets, setting, limits)
    for placed in (around or ZonePlanets(targets, planets)).of(model, band):
        counts.add(placed)
    n = len(planets)
    in_zone, observable = counts.found / n
    detected, allowed, squared = counts.detected / n
    own = model.strategy.search if search is None else search
    mine = int(own == "known_place")
    occurrence = planets.planets_per_star
    return BandCompleteness(
        band=band,
        search=own,
        n_planets=n,
        completeness=allowed[0],
        completeness_known_place=allowed[1],
        completeness_unconditional=detected[0],
        completeness_known_place_unconditional=detected[1],
        standard_error=np.sqrt(np.maximum(squared[mine] - allowed[mine] ** 2, 0.0) / n),
        in_zone=in_zone,
        observable=observable,
        expected_planets=None if occurrence is None else occurrence * allowed[mine],
        expected_planets_unconditional=None if occurrence is None else occurrence * detected[mine],
        flags=_notes(model, band, planets, counts.insolation) + etc.hole_notes(model, band),
    )


class _Counts:
    """Numbers of planets around each star, and the range of insolation of those that follow it.

    The rows of ``found`` are planets in the zone, and observable; ``detected`` are sums over the planets, blind and at
    their place: of the probability of a detection, of that times the one that they may exist, and of its square.
    """

    def __init__(
        self,
        model: etc.EtcModel,
        targets: Targets,
        band: str,
        planets: Planets,
        setting: _Setting,
        limits: StarLimits | None,
    ) -> None:
        self.model = model
        self.targets = targets
        self.band = band
        self.planets = planets
        self.setting = setting
        self.limits = limits
        self.scale = planets.scale(targets.luminosity_lsun)
        self.found = np.zeros((2, len(targets)), np.int64)
        self.detected = np.zeros((3, 2, len(targets)))
        self.insolation = [np.inf, -np.inf]

    def add(self, placed: Placed) -> None:
        """Add some of the planets."""
        self.found[0, placed.rows] += placed.in_zone
        self.found[1, placed.rows] += placed.observable
        pairs = np.flatnonzero(self.setting.n_frames[placed.star] > 0.0)
        contrast = np.empty(len(pairs))
        for stars, pair, filled in rectangles(placed.star[pairs]):
            contrast[pair[filled]] = self._contrast(stars, placed.planet[pairs[pair]], filled)[filled]
        bright = contrast >= self._faintest[placed.star[pairs], placed.ring[pairs]]
        pairs, contrast = pairs[bright], contrast[bright]
        for stars, pair, filled in rectangles(placed.star[pairs]):
            whose = pairs[pair]
            places = placed.x_arcsec[whose], placed.y_arcsec[whose], contrast[pair]
            chosen, shown = self.targets.select(stars), np.nonzero(filled)
            chance = _chances(self.model, chosen, self.band, places, shown, self.setting.of(stars))
            self._count(stars, shown[0], placed.planet[whose][shown], chance)

    @functools.cached_property
    def _faintest(self) -> FloatArray:
        """Contrast below which no planet counts, by star and ring."""
        law = etc.law_of(self.model, self.band)
        found, observed = np.full((len(self.targets), N_RINGS), np.inf), np.flatnonzero(self.setting.n_frames > 0.0)
        frames = {name: part[observed] for name, part in vars(self.setting).items()}
        chosen = self.targets.select(observed)
        found[observed] = faintest_contrast(self.model, chosen, self.band, law=law, **frames)
        return found

    def _count(self, stars: IntArray, row: IntArray, planet: IntArray, chance: FloatArray) -> None:
        """Add the planets of some stars, blind and at their place: chances of shape ``(2, k)``, with row and planet."""
        seen = np.flatnonzero(chance.max(axis=0) > 0.0)
        row, planet, chance = row[seen], planet[seen], chance[:, seen]
        there = chance
        if self.limits is not None:
            planets, star = self.planets, stars[row]
            axis = planets.semi_major_axis_au[planet] * self.scale[star]
            mass, tilt = planets.mass_mjup[planet], planets.inclination_deg[planet]
            there = chance * self.limits.allowed_probability(star, axis, mass, tilt)
        for k, values in enumerate((chance, there, there**2)):
            for mode, value in enumerate(values):
                self.detected[k, mode, stars] += np.bincount(row, value, len(stars))

    def _contrast(self, stars: IntArray, pick: IntArray, usable: BoolArray) -> FloatArray:
        """Return the contrast of the picked planets of each star, ``(n, k)``; note the range of their insolation."""
        planets, kind, targets = self.planets, self.planets.kind[pick], self.targets.select(stars)
        distance = planets.distance_au[pick] * self.scale[stars][:, None]
        follows = np.array([needs_insolation(spec) for spec in planets.albedos])[kind] & usable
        if follows.any():
            seen = etc.insolation_distance_au(targets, distance)[follows]
            low, high = self.insolation
            self.insolation = [min(low, float(seen.min())), max(high, float(seen.max()))]
        radius, phase = planets.radius_rjup[pick], planets.phase_deg[pick]
        return etc.mixture_contrast(self.model, targets, self.band, planets.albedos, kind, radius, distance, phase)


def _chances(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    places: tuple[FloatArray, ...],
    shown: tuple[IntArray, ...],
    setting: _Setting,
) -> FloatArray:
    """Return the probabilities that planets are detected, blind and at their place, of offsets x and y, and contrasts.

    The planets of every star fill the first columns of a rectangle: ``shown`` are those that count, and the result has
    the shape ``(2, k)`` of them.
    """
    x, y, contrast = places
    camera, strategy = model.camera(band), model.strategy
    rates = etc.aperture_rates(model, targets, band, x, y, contrast)
    frames = setting.exposure_s, setting.n_frames, setting.em_gain
    visit_s = setting.n_frames * (setting.exposure_s + camera.readout_s)
    programme = programme_of(model, setting.visits, visit_s)
    noise = etc.stack_noise(rates, *frames, camera, strategy, programme=programme)
    chance = np.zeros((2, len(shown[0])))
    separation, law, least = np.hypot(x, y), etc.law_of(model, band), np.ones(())
    if law is not None:
        least = etc.least_margin(law, model.metrics[band].lambda_d_arcsec / separation, programme)
    # A threshold lies above its level, and the law is what takes longest here.
    hopeful = np.flatnonzero((noise.significance >= least * strategy.sigma)[shown])
    here = shown[0][hopeful], shown[1][hopeful]
    separation = separation[here]
    elements = model.metrics[band].resolution_elements(separation)
    margin = noise.significance[here] / etc.near_threshold(elements, strategy.sigma)
    signal, quiet, white, speckle, snr, significance = (
        getattr(noise, name)[here] for name in ("signal_e", "quiet", "white", "speckle", "snr", "significance")
    )
    seen = etc.StackNoise(signal, quiet, white, speckle, snr, significance, dict)
    effective = etc.effective_of(programme, rates.speckle)
    visits, visit_s, many = (np.broadcast_to(part, x.shape)[here] for part in (effective, visit_s, programme.visits))
    search = etc.SearchMotion.of(model, targets, band, separation, here[0]).search
    moving = search.threshold_factor(many, model.time_s(visit_s))
    found = etc.visit_chances(model, band, separation, visit_s, seen, margin, visits, motion=moving)
    for mode, (part, needed) in enumerate(((found.blind, moving), (found.known_place, np.ones_like(moving)))):
        chance[mode, hopeful] = np.where(np.isnan(part), margin >= needed, part * (part >= etc.LEAST_PROBABILITY))
    return chance


def _notes(model: etc.EtcModel, band: str, planets: Planets, insolation: list[float]) -> tuple[str, ...]:
    """Return what was clamped or extrapolated in the planets' albedos."""
    notes: list[str] = []
    for spec, _ in etc.kinds_by_albedo(planets.albedos):
        if not needs_insolation(spec):
            notes += albedo_notes(spec)
        elif insolation[0] <= insolation[1]:
            notes += [note for end in insolation for note in albedo_notes(spec, end)]
        if model.passbands.albedo_flags(albedo_source(spec))[model.passbands.index(band)]:
            notes.append("extrapolated")
    return tuple(dict.fromkeys(notes))


def _settings(
    model: etc.EtcModel, n_stars: int, exposure_s: ArrayLike, n_frames: ArrayLike, em_gain: ArrayLike
) -> tuple[FloatArray, ...]:
    """Return the exposure, frames and gain of every star, checked; 1 s and gain 1 where there are no frames."""
    frames = _one_each("n_frames", n_frames, n_stars)
    bad = frames[~(np.isfinite(frames) & (frames >= 0.0))]
    if bad.size:
        raise InputError("n_frames", float(bad[0]), allowed="finite numbers, at least 0")
    taken = frames > 0.0
    given = [
        np.where(taken, _one_each(name, value, n_stars), 1.0)
        for name, value in (("exposure_s", exposure_s), ("em_gain", em_gain))
    ]
    exposure, gain = check_finite("exposure_s", given[0], "s"), check_finite("em_gain", given[1])
    if np.any(exposure <= 0.0):
        raise InputError("exposure_s", float(exposure.min()), unit="s", allowed="above 0")
    if np.any(gain < 1.0):
        raise InputError("em_gain", float(gain.min()), allowed="at least 1")
    if model.strategy.mode == "photon_counting" and np.unique(gain[taken]).size > 1:
        raise InputError("em_gain", gain.tolist(), allowed="one gain for all stars where photons are counted")
    return exposure, frames, gain


def _one_each(name: str, value: ArrayLike, n_stars: int) -> FloatArray:
    given = real_array(name, value)
    if given.shape not in ((), (1,), (n_stars,)):
        raise InputError(name, given.shape, allowed=f"one number, or one for each of {n_stars} stars")
    return np.broadcast_to(given, (n_stars,))
