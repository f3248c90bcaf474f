"""Completeness: the planets of a population, or known ones, that one observation of each star detects.

Where planets stand and what they are does not depend on how dark the zone is: rankings under many instruments of one
geometry place them once, and those that are too faint to count need no further look.

Filters choose the stars of a question.
"""

import functools
import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Catalogue, KnownPlanetTable, load_known_planets
from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    IntArray,
    Record,
    check_finite,
    check_whole,
    real_array,
)
from cpic_planner import etc
from cpic_planner.etc import EtcModel
from cpic_planner.planets import (
    Planets,
    PopulationChoice,
    StarLimits,
    draw_known,
    known_uniforms,
    planets_of,
    star_masses_msun,
)
from cpic_planner.queries import RankedQuestion, ReferencePlanet, called, observed_utc
from cpic_planner.ranking.optimiser import OptimalSetting, programme_of
from cpic_planner.results import KNOWN_PLANETS, DetectionMode, PopulationRecord
from cpic_planner.targets import Targets, named_among, rank_sample, sample_text
from simulator.config import AlbedoSpec, Instrument, checked_utc, unit_of
from simulator.imaging import PsfMetrics, Zone
from simulator.products import mjd_of
from simulator.signal import programme_law
from simulator.target import albedo_notes, albedo_source, needs_insolation, sky_to_detector

# Arrays of one step stay below 10 MB each: numbers of planets to place, and of pairs with stars to work out together.
_TOGETHER = 50_000
_PLANETS = 20_000
_IDLE = 6_000
"""Idle places of a rectangle of pairs that cost as much as one more rectangle."""
N_RINGS, _FINE = 40, 40
_SURE = 0.95
"""Part of the faintest contrast that counts: steps of tables and splines are finer by far."""


class Placed(Record, eq=False):
    """Planets around ``n`` stars whose whole aperture lies in the zone: ``k`` pairs, star by star.

    Attributes
    ----------
    in_zone, observable : ndarray, shape (n,)
        Number of planets in the zone around each star, and of those whose whole aperture is.
    star, planet : ndarray of int, shape (k,)
        Of each pair.
    x_arcsec, y_arcsec : ndarray, shape (k,)
        Offset from the star on the detector.
    ring : ndarray of int, shape (k,)
        Ring of `faintest_contrast` in which it stands.
    """

    in_zone: IntArray
    observable: IntArray
    star: IntArray
    planet: IntArray
    x_arcsec: FloatArray
    y_arcsec: FloatArray
    ring: IntArray


class ZonePlanets:
    """Planets of a population in the dark zones of bands, around ``n`` stars.

    Parameters
    ----------
    targets : Targets
    planets : Planets
        The same at every star.
    keep : bool
        Remember them, for further instruments of the same geometry: 50 bytes for each planet in the zone.
    """

    def __init__(self, targets: Targets, planets: Planets, *, keep: bool = False) -> None:
        self.targets = targets
        self.planets = planets
        self._kept: dict[tuple[Zone, float, int], list[Placed]] | None = {} if keep else None

    def of(self, model: etc.EtcModel, band: str) -> Iterator[Placed]:
        """Yield the planets in the zone of a band, a part of the planets at a time.

        Raises
        ------
        InputError
            If orbits follow insolation and a luminosity is unknown.
        """
        metrics = model.metrics[band]
        key = metrics.zone, metrics.aperture_radius_arcsec, model.instrument.detector.parity
        if self._kept is None:
            yield from self._placed(*key)
            return
        if key not in self._kept:
            self._kept[key] = list(self._placed(*key))
        yield from self._kept[key]

    def _placed(self, zone: Zone, radius_arcsec: float, parity: int) -> Iterator[Placed]:
        """Return the places on the detector: a map from sky to detector is linear in the offset, whatever its unit."""
        planets, n_stars = self.planets, len(self.targets)
        arcsec_au = planets.scale(self.targets.luminosity_lsun) / self.targets.distance_pc
        order = np.argsort(arcsec_au, kind="stable")
        ascending = arcsec_au[order]
        for part in _slices(len(planets), _PLANETS):
            east, north = planets.east_au[part], planets.north_au[part]
            pa_deg = np.rad2deg(np.arctan2(east, north))
            x_au, y_au = sky_to_detector(np.hypot(east, north), pa_deg, parity=parity)
            # A planet is in the zone around stars of a range of scales: those that follow each other in their order.
            found = []
            for margin in (0.0, radius_arcsec):
                least, most = zone.reaches(x_au, y_au, margin)
                first = np.searchsorted(ascending, least)
                end = np.maximum(first, np.searchsorted(ascending, most, "right"))
                begun, over = (np.bincount(some, minlength=n_stars + 1)[:n_stars] for some in (first, end))
                number = np.empty(n_stars, np.int64)
                number[order] = np.cumsum(begun - over)
                found.append(number)
            planet = np.repeat(np.arange(part.start, part.stop), end - first)
            star = order[np.arange(len(planet)) + np.repeat(end - np.cumsum(end - first), end - first)]
            by_star = np.argsort(star, kind="stable")
            star, planet = star[by_star], planet[by_star]
            x, y = (arcsec_au[star] * offset[planet - part.start] for offset in (x_au, y_au))
            yield Placed(found[0], found[1], star, planet, x, y, ring_of(zone, np.hypot(x, y)))


def ring_of(zone: Zone, separation_arcsec: FloatArray) -> IntArray:
    """Return the ring of `faintest_contrast` in which points stand.

    Parameters
    ----------
    zone : HoleZone or RingZone
    separation_arcsec : ndarray
        Distance from the star.
    """
    low, high = zone.inner_corner_arcsec, zone.outer_corner_arcsec
    ring = ((separation_arcsec - low) / (high - low) * N_RINGS).astype(np.int64)
    return np.clip(ring, 0, N_RINGS - 1)


def faintest_contrast(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    *,
    exposure_s: FloatArray,
    n_frames: FloatArray,
    em_gain: FloatArray,
    visits: FloatArray,
    law: etc.SearchLaw | None,
    at_place: bool = True,
) -> FloatArray:
    """Return the contrast below which no planet of a ring is detected: all of them need no further look.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    exposure_s, n_frames, em_gain, visits : ndarray, shape (n,)
        Of each star, frames of one visit.
    law : SearchLaw or None
        What a detection is: a probability of `cpic_planner.etc.LEAST_PROBABILITY`. Without a law a significance of the
        threshold.
    at_place : bool
        Whether planets are looked for at a known place, too.

    Returns
    -------
    ndarray, shape (n, ring)
        By ring around the star, of equal widths between the corners of the zone. 0 where photons are counted.

    Notes
    -----
    A planet beside the mask's shadow, in noise without the light of star, companion and dust, and with the least
    speckles, sky and core of its ring, is more significant than any real one of that contrast. What it needs
    is the least of the ring, too.
    """
    metrics, strategy, rings = model.metrics[band], model.strategy, np.zeros((len(targets), N_RINGS))
    if strategy.mode == "photon_counting":
        return rings
    zone, none = metrics.zone, np.zeros((1, 1))
    low, high = zone.inner_corner_arcsec, zone.outer_corner_arcsec
    x, y = etc.diagonal(zone, np.full((1, 1), 0.5 * (low + high)))
    rates = etc.aperture_rates(model, replace(targets, companions="off"), band, x, y, np.ones((1, 1)))
    star = rates.peak_planet_e_s / metrics.peak_off_axis
    library = model.library_noise(band, star)
    fine = low + (high - low) * (np.arange(N_RINGS)[:, None] + np.linspace(0.0, 1.0, _FINE + 1)) / N_RINGS
    width, ratio = strategy.annulus_lambda_d, strategy.reference_ratio
    law_of = programme_law(metrics, model.instrument.drift, fine, width, ratio, model.timing)
    # Its parts all fall and grow with the two variances that it has.
    least = etc.mapped(lambda part: part.min(axis=-1), law_of)
    bright, large = _least_shares(metrics, fine, (x, y))
    sky, charge = rates.sky_e_s * bright * large, rates.dark_e_s * large
    dark = replace(
        rates,
        planet_e_s=star * metrics.core_open,
        halo_e_s=none,
        errors_e_s=none,
        exozodi_e_s=none,
        sky_e_s=sky,
        dark_e_s=charge,
        aperture_pixels=rates.aperture_pixels * large,
        speckle=least.scaled(star**2 * library.speckle),
        reference_light_e_s=library.light(none, none, sky + charge),
        smear_e=none,
        reference_smear_e=none,
    )
    exposure, frames, gain, many = (part[:, None] for part in (exposure_s, n_frames, em_gain, visits))
    camera = model.camera(band)
    programme = programme_of(model, many, frames * (exposure + camera.readout_s))
    noise = etc.stack_noise(dark, exposure, frames, gain, camera, strategy, programme=programme)
    if law is None:
        needed = etc.near_threshold(metrics.resolution_elements(fine), strategy.sigma).min(axis=-1)
    else:
        needed = law.least(fine, etc.LEAST_PROBABILITY, at_place=at_place).min(axis=-1)
    with np.errstate(divide="ignore"):
        return np.asarray(_SURE * needed / noise.significance + rings)


def _least_shares(
    metrics: PsfMetrics, fine: FloatArray, middle: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray | float, FloatArray | float]:
    """Return the least sky on a pixel of each ring, and the least core, in the middle of the zone; at most 1."""
    found: list[FloatArray | float] = []
    for value in (metrics.sky_share, metrics.core_pixels):
        there = value(*etc.diagonal(metrics.zone, fine))
        ratio = 1.0 if isinstance(there, float) else np.minimum(there.min(axis=-1) / value(*middle), 1.0)
        found.append(ratio)
    return found[0], found[1]


def rectangles(star: IntArray) -> Iterator[tuple[IntArray, IntArray, BoolArray]]:
    """Put pairs into rectangles, a row for each star: stars with about as many planets go together.

    Parameters
    ----------
    star : ndarray of int, shape (k,)
        Of each pair, ascending.

    Yields
    ------
    stars : ndarray of int, shape (r,)
    pair : ndarray of int, shape (r, m)
        Number of the pair at each place; where a star has fewer than ``m``, its first one again.
    filled : ndarray of bool, shape (r, m)
        Which places hold the star's pairs.
    """
    stars, first, numbers = np.unique(star, return_index=True, return_counts=True)
    order = np.argsort(numbers, kind="stable")
    for block in _blocks(numbers[order]):
        mine = order[block]
        column = np.arange(numbers[mine].max())
        filled = column < numbers[mine][:, None]
        yield stars[mine], first[mine][:, None] + filled * column, filled


def _blocks(numbers: IntArray) -> Iterator[slice]:
    """Yield the slices of ascending numbers, each a rectangle of at most `_TOGETHER` pairs (one row may have more)."""
    end = len(numbers)
    while end > 0:
        most, start, idle = int(numbers[end - 1]), end - 1, 0
        while start > 0 and (end - start + 1) * most <= _TOGETHER and idle + most - numbers[start - 1] <= _IDLE:
            start -= 1
            idle += most - int(numbers[start])
        yield slice(start, end)
        end = start


def _slices(length: int, step: int) -> Iterator[slice]:
    """Yield the slices of at most ``step`` that cover a length."""
    for start in range(0, length, step):
        yield slice(start, min(start + step, length))


class BandCompleteness(Record, eq=False):
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


class _Setting(etc.CaseArrays, Record, eq=False):
    """Frames of one visit and visits of each star: arrays ``(n,)``, or ``(n, 1)`` of those that are looked at."""

    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    visits: FloatArray


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
    brief: bool = False,
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
    brief : bool
        Of a blind search the completeness at a known place is left out: NaN.

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
    (`cpic_planner.etc.visit_chances`).
    Core throughput, halo and contrast are its own. The setting is not changed for it: one bright enough to saturate
    counts as detected.
    """
    if band not in model.metrics:
        raise InputError("band", band, allowed=", ".join(model.bands))
    exposure, frames, gain = _settings(model, len(targets), exposure_s, n_frames, em_gain)
    setting = _Setting(exposure, frames, gain, _one_each("visits", visits, len(targets)))
    own = model.strategy.search if search is None else search
    mine = int(own == "known_place")
    counts = _Counts(model, targets, band, planets, setting, limits, bool(mine) or not brief)
    for placed in (around or ZonePlanets(targets, planets)).of(model, band):
        counts.add(placed)
    n = len(planets)
    in_zone, observable = counts.found / n
    detected, allowed, squared = counts.detected / n
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


@dataclass(eq=False)
class _Counts:
    """Numbers of planets around each star, and the range of insolation of those that follow it.

    The rows of ``found`` are planets in the zone, and observable; ``detected`` are sums over the planets, blind and at
    their place: of the probability of a detection, of that times the one that they may exist, and of its square.
    """

    model: etc.EtcModel
    targets: Targets
    band: str
    planets: Planets
    setting: _Setting
    limits: StarLimits | None
    at_place: bool

    def __post_init__(self) -> None:
        self.scale = self.planets.scale(self.targets.luminosity_lsun)
        self.found = np.zeros((2, len(self.targets)), np.int64)
        self.detected = np.zeros((3, 2, len(self.targets)))
        self.detected[:, 1] = 0.0 if self.at_place else np.nan
        self.insolation = [np.inf, -np.inf]

    def add(self, placed: Placed) -> None:
        """Add some of the planets."""
        self.found += placed.in_zone, placed.observable
        pairs = np.flatnonzero(self.setting.n_frames[placed.star] > 0.0)
        contrast = np.empty(len(pairs))
        for stars, pair, filled in rectangles(placed.star[pairs]):
            contrast[pair[filled]] = self._contrast(stars, placed.planet[pairs[pair]], filled)[filled]
        bright = contrast >= self._faintest[placed.star[pairs], placed.ring[pairs]]
        pairs, contrast = pairs[bright], contrast[bright]
        for stars, pair, filled in rectangles(placed.star[pairs]):
            whose = pairs[pair]
            places = placed.x_arcsec[whose], placed.y_arcsec[whose], contrast[pair]
            shown = np.nonzero(filled)
            chance = self._chances(stars, places, shown)
            self._count(stars, shown[0], placed.planet[whose][shown], chance)

    @functools.cached_property
    def _faintest(self) -> FloatArray:
        """Contrast below which no planet counts, by star and ring."""
        law = etc.band_law(self.model, self.band)
        found, observed = np.full((len(self.targets), N_RINGS), np.inf), np.flatnonzero(self.setting.n_frames > 0.0)
        frames = {name: part[observed] for name, part in vars(self.setting).items()}
        chosen = self.targets.select(observed)
        found[observed] = faintest_contrast(self.model, chosen, self.band, law=law, at_place=self.at_place, **frames)
        return found

    def _chances(self, stars: IntArray, places: tuple[FloatArray, ...], shown: tuple[IntArray, ...]) -> FloatArray:
        """Return the probabilities that planets around stars are detected, blind and at their place.

        ``places`` are offsets x and y, and contrasts. The planets of every star fill the first columns of a rectangle:
        ``shown`` are those that count, and the result has the shape ``(2, k)`` of them, or ``(1, k)`` of a blind search
        alone.
        """
        model, band, at_place = self.model, self.band, self.at_place
        camera, strategy, setting = model.camera(band), model.strategy, self.setting.at(stars).at((slice(None), None))
        x, y, contrast = places
        targets = self.targets.select(stars)
        rates = etc.aperture_rates(model, targets, band, x, y, contrast)
        frames = setting.exposure_s, setting.n_frames, setting.em_gain
        visit_s = setting.n_frames * (setting.exposure_s + camera.readout_s)
        programme = programme_of(model, setting.visits, visit_s)
        noise = etc.stack_noise(rates, *frames, camera, strategy, programme=programme)
        chance = np.zeros((1 + at_place, len(shown[0])))
        separation = np.hypot(x, y)
        # The law is what takes longest here.
        least = etc.band_law(model, band).least(separation, etc.LEAST_PROBABILITY, at_place=at_place)
        hopeful = np.flatnonzero((noise.significance >= least)[shown])
        here = shown[0][hopeful], shown[1][hopeful]
        separation = separation[here]
        seen = noise.at(here)
        effective = programme.effective(rates.speckle)
        visits, visit_s, many = (
            np.broadcast_to(part, x.shape)[here] for part in (effective, visit_s, programme.visits)
        )
        search = etc.search_motion(model, targets, band, separation, here[0])
        moving = search.threshold_factor(many, model.time_s(visit_s))
        found = etc.visit_chances(model, band, separation, visit_s, seen, visits, motion=moving, at_place=at_place)
        for row, part in zip(chance, (found.blind, found.known_place), strict=False):
            row[hopeful] = part * (part >= etc.LEAST_PROBABILITY)
        return chance

    def _count(self, stars: IntArray, row: IntArray, planet: IntArray, chance: FloatArray) -> None:
        """Add the planets of some stars, blind and at their place: chances of `_chances`, with row and planet."""
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


MAX_DRAWS = 100_000
N_DRAWS = 4000
KNOWN_ONLY = "those with known planets only"
"""What a sample is called whose stars all have known planets."""


def known_rows(table: KnownPlanetTable, targets: Targets) -> list[tuple[int, ...]]:
    """Return the rows of the counted planets of each star, by any of its names; empty where it has none."""
    return [table.rows_of(str(name)) for name in targets.name]


def hosts_among(targets: Targets, table: KnownPlanetTable) -> BoolArray:
    """Tell which targets have known planets that are counted."""
    return np.array([bool(rows) for rows in known_rows(table, targets)], bool)


class KnownSample(Record, eq=False):
    """Draws of the known planets of ``n`` stars at one date: for each star, its planets with their draws."""

    planets: tuple[tuple[Planets, ...], ...]
    n_draws: int


class KnownChoice(Record, eq=False):
    """A table of known planets, a date, and how often each planet is drawn.

    Attributes
    ----------
    table : KnownPlanetTable
    date_utc : str
        As written into results.
    mjd : float
        The same date.
    albedo : AlbedoSpec
        What the planets reflect.
    n_draws, seed : int
    """

    table: KnownPlanetTable
    date_utc: str
    mjd: float
    albedo: AlbedoSpec
    n_draws: int = N_DRAWS
    seed: int = 1

    @classmethod
    def at(
        cls,
        source: str | Path,
        date: str | None,
        albedo: AlbedoSpec,
        instrument: Instrument,
        *,
        n_draws: int,
        seed: int,
        candidates: bool = False,
    ) -> "KnownChoice":
        """Return the choice of a table and a date as people write them.

        Parameters
        ----------
        source : str or Path
            As `catalogs.known_planets.load_known_planets` reads it.
        date : str or None
            UTC; None for the start of the instrument's mission.
        albedo : AlbedoSpec
        instrument : Instrument
        n_draws, seed : int
        candidates : bool
            Whether candidates are counted.

        Raises
        ------
        InputError
            For a table that cannot be used, or a text that is no date.
        """
        utc = checked_utc("--date", instrument.mission.start_utc if date is None else date)
        return cls(load_known_planets(source, candidates=candidates), utc, mjd_of(utc), albedo, n_draws, seed)

    def stars(self, targets: Targets) -> Targets:
        """Return the targets that have known planets which are counted.

        Raises
        ------
        InputError
            If none has.
        """
        hosts = hosts_among(targets, self.table)
        if not hosts.any():
            raise InputError("known_planets", self.table.provenance, allowed="planets of stars of the sample")
        return targets.select(hosts)

    def draw(self, targets: Targets) -> KnownSample:
        """Return the draws of the planets of each star.

        Raises
        ------
        InputError
            If a number is out of range.
        """
        n = check_whole("n_draws", self.n_draws, 1, MAX_DRAWS)
        mjd = float(check_finite("mjd", self.mjd, "d"))
        made = []
        masses = star_masses_msun(targets.name.tolist(), targets.log_g, targets.luminosity_lsun, targets.teff_k)
        for rows, mass in zip(known_rows(self.table, targets), masses, strict=True):
            uniforms = known_uniforms(self.table, rows, n, self.seed)
            drawn = draw_known(self.table, rows, uniforms, epoch_mjd=mjd, star_mass_msun=mass)
            made.append(tuple(planets_of(drawn, k, self.albedo) for k in range(len(rows))))
        return KnownSample(tuple(made), n)

    def record(self) -> PopulationRecord:
        """Return what is written into results, where the population of a ranking is."""
        return PopulationRecord(
            name=KNOWN_PLANETS,
            description=f"{self.table.provenance}, on {self.date_utc}",
            n_planets=self.n_draws,
            seed=self.seed,
            planets_per_star=None,
            columns_not_used=list(self.table.unused),
        )

    def content(self) -> dict[str, Any]:
        """Return what decides the probability, for content hashes."""
        tables = [self.table, *self.table.solutions.values()]
        cells = [[(name, column.tolist()) for name, column in table.columns.items()] for table in tables]
        digest = hashlib.sha256(repr((cells, self.table.candidates)).encode()).hexdigest()
        albedo = ReferencePlanet(albedo=self.albedo).content()["albedo"]
        return {"table": digest, "mjd": self.mjd, "n_draws": self.n_draws, "seed": self.seed, "albedo": albedo}


def counted_planets(question: RankedQuestion) -> PopulationChoice | KnownChoice:
    """Return the population, or the known planets, that the completeness of a ranking refers to.

    Raises
    ------
    InputError
        If there is no such table of known planets, or it cannot be used.
    """
    if question.known_planets is None:
        return PopulationChoice(question.population, question.n_planets, question.seed, question.exclusions)
    n_draws, albedo = check_whole("n_planets", question.n_planets, 1, MAX_DRAWS), question.planet.albedo
    where = question.known_planets, question.date_utc, albedo, question.instrument
    return KnownChoice.at(*where, n_draws=n_draws, seed=question.seed, candidates=question.candidates)


def chosen_targets(targets: Targets, question: RankedQuestion, catalogue: Catalogue) -> tuple[BoolArray, str]:
    """Return which targets pass the filters of a question, and what these are in words.

    Parameters
    ----------
    targets : Targets
        ``n`` stars of the catalogue, at the date.
    question : RankedQuestion
    catalogue : Catalogue

    Returns
    -------
    ndarray of bool, shape (n,)
    str

    Raises
    ------
    InputError
        For names that are unknown, mean several stars or are no target, all of them in one line; and for a filter that
        leaves no star.
    """
    asked = {name: getattr(question, name) for name in question.filters}
    texts = {
        "stars": "named",
        "sp_type": f"of type {' or '.join(question.sp_type)}",
        "distance_max_pc": "within {:g} pc",
        "dec_min_deg": "at {:g} deg of declination or north of it",
        "dec_max_deg": "at {:g} deg of declination or south of it",
        "known_hosts": "hosts of known planets",
    }
    tests: dict[str, Callable[[], Any]] = {
        "stars": lambda: named_among(targets, question.stars, catalogue),
        "sp_type": lambda: [_class_first(text).startswith(question.sp_type) for text in targets.sp_type.tolist()],
        "distance_max_pc": lambda: targets.distance_pc <= asked["distance_max_pc"],
        "dec_min_deg": lambda: targets.dec_deg >= asked["dec_min_deg"],
        "dec_max_deg": lambda: targets.dec_deg <= asked["dec_max_deg"],
        "known_hosts": lambda: [
            bool(rows) for rows in known_rows(load_known_planets(candidates=question.candidates), targets)
        ],
    }
    keep, left = np.ones(len(targets), bool), f"none of the {len(targets)} ranked stars passes"
    for name, value in asked.items():
        keep = keep & np.asarray(tests[name](), bool)
        if not keep.any():
            shown = "given" if value is True else value
            raise InputError(name, shown, unit=unit_of(name), allowed="a filter that leaves a star", hint=left)
        left = f"none of the {keep.sum()} stars that {called(name)} leaves passes"
    return keep, ", ".join(texts[name].format(value) for name, value in asked.items())


def _class_first(sp_type: str) -> str:
    """Return a spectral type from its class on, without blanks and without what stands before it (sd, d, a bracket)."""
    return re.sub(r"^[^OBAFGKM]*", "", "".join(sp_type.split()))


class AskedStars(Record, eq=False):
    """The stars that a question ranks.

    Attributes
    ----------
    targets : Targets
        All ``n`` that are ranked.
    counted : PopulationChoice or KnownChoice
        The planets that completeness counts.
    chosen : ndarray of bool, shape (n,), or None
        Those that pass the filters of the question; None without filters.
    text : str
        In words, those that are chosen.
    notes : tuple of str
        Remarks on the tables, for the person who asked.
    """

    targets: Targets
    counted: PopulationChoice | KnownChoice
    chosen: BoolArray | None
    text: str
    notes: tuple[str, ...]

    @property
    def answered(self) -> Targets:
        """The stars that an answer is about."""
        return self.targets if self.chosen is None else self.targets.select(self.chosen)


def asked_stars(question: RankedQuestion, catalogue: Catalogue) -> AskedStars:
    """Return the stars that a question ranks and the planets that count around them.

    Raises
    ------
    InputError
        For tables that cannot be read, and cuts or filters that leave no star.
    """
    cuts = {name: getattr(question, name) for name in ("v_mag_max", "dwarfs_only", "singles_only")}
    date_utc = observed_utc(question)
    targets = rank_sample(catalog=catalogue, companions=question.companions, date_utc=date_utc, **cuts)
    text, counted, notes = sample_text(catalogue, *cuts.values()), counted_planets(question), catalogue.notes
    if isinstance(counted, KnownChoice):
        targets, text = counted.stars(targets), f"{text}; {KNOWN_ONLY}"
        notes = (*notes, *counted.table.notes)
    if not question.filters:
        return AskedStars(targets, counted, None, text, tuple(notes))
    chosen, words = chosen_targets(targets, question, catalogue)
    return AskedStars(targets, counted, chosen, f"{text}; of these only those that are {words}", tuple(notes))


def known_completeness(
    model: EtcModel,
    targets: Targets,
    band: str,
    known: KnownSample,
    *,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    visits: ArrayLike = 1.0,
) -> BandCompleteness:
    """Return the probability that one observation of each star detects at least one of its known planets.

    Parameters
    ----------
    model, targets, band, exposure_s, n_frames, em_gain, visits
        As of `cpic_planner.ranking.completeness.completeness`.
    known : KnownSample
        Of the same stars.

    Returns
    -------
    BandCompleteness
        Completenesses, ``in_zone`` and ``observable`` are probabilities of at least one planet, those of a star's
        planets taken as independent; ``expected_planets`` is the sum of those at their places, where known planets are
        looked for. What velocities exclude does not count: these planets are known.
    """
    asked = {"exposure_s": exposure_s, "n_frames": n_frames, "em_gain": em_gain, "visits": visits}
    settings = {name: np.broadcast_to(np.asarray(value, float), (len(targets),)) for name, value in asked.items()}
    missed, (expected, variance) = np.ones((4, len(targets))), np.zeros((2, len(targets)))
    flags: dict[str, None] = {}
    for i, bodies in enumerate(known.planets):
        star = targets.select([i])
        shares, scatter = [], []
        for body in bodies:
            own = {name: values[i] for name, values in settings.items()}
            one = completeness(model, star, band, body, **own, search="known_place")
            seen = one.completeness[0], one.completeness_known_place[0], one.in_zone[0], one.observable[0]
            missed[:, i] *= 1.0 - np.array(seen)
            shares.append(float(one.counted[0]))
            scatter.append(float(one.standard_error[0]))
            flags |= dict.fromkeys(one.flags)
        expected[i] = sum(shares)
        variance[i] = _variance(shares, scatter)
    blind, placed, in_zone, observable = 1.0 - missed
    return BandCompleteness(
        band=band,
        search="known_place",
        n_planets=known.n_draws,
        completeness=blind,
        completeness_known_place=placed,
        completeness_unconditional=blind,
        completeness_known_place_unconditional=placed,
        standard_error=np.sqrt(variance),
        in_zone=in_zone,
        observable=observable,
        expected_planets=expected,
        expected_planets_unconditional=expected,
        flags=tuple(flags),
    )


class CountedPlanets(Record, eq=False):
    """Planets that completeness counts around ``n`` stars, the same under every instrument; made by `of`.

    Attributes
    ----------
    targets : Targets
    planets : Planets or KnownSample
        Of a population, the same at every star, or each star's own.
    limits : StarLimits or None
        What is known of the stars and excludes planets; None where the planets are the known ones.
    around : ZonePlanets or None
        Where the planets of a population stand.
    """

    targets: Targets
    planets: Planets | KnownSample
    limits: StarLimits | None
    around: ZonePlanets | None

    @classmethod
    def of(cls, choice: PopulationChoice | KnownChoice, targets: Targets, *, keep: bool = False) -> "CountedPlanets":
        """Return what a choice counts; ``keep`` it placed, for more than one instrument."""
        if isinstance(choice, KnownChoice):
            return cls(targets, choice.draw(targets), None, None)
        planets = choice.draw()
        return cls(targets, planets, choice.limits(targets.name.tolist()), ZonePlanets(targets, planets, keep=keep))

    def completeness(
        self, model: EtcModel, band: str, setting: OptimalSetting, *, brief: bool = False
    ) -> BandCompleteness:
        """Return the completeness of the observation of each star.

        Parameters
        ----------
        model : EtcModel
        band : str
        setting : OptimalSetting
            How each star is observed in that band.
        brief : bool
            As of `completeness`.
        """
        taken: dict[str, Any] = {name: getattr(setting, name) for name in ("exposure_s", "em_gain", "visits")}
        taken["n_frames"] = setting.frames_per_visit
        if isinstance(self.planets, KnownSample):
            return known_completeness(model, self.targets, band, self.planets, **taken)
        taken |= {"limits": self.limits, "around": self.around, "brief": brief}
        return completeness(model, self.targets, band, self.planets, **taken)


def _variance(shares: Sequence[float], errors: Sequence[float]) -> float:
    """Return the variance of ``1 - prod(1 - p)`` where each p has a standard error."""
    total = 0.0
    for k, error in enumerate(errors):
        others = np.prod([1.0 - other for j, other in enumerate(shares) if j != k])
        total += error**2 * float(others) ** 2
    return total
