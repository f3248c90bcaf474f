"""How many planets of a population one observation of each star detects, of all and of those that may still exist."""

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, check_finite, real_array
from cpic_planner import etc
from cpic_planner.planets import Planets, StarLimits
from cpic_planner.ranking.programmes import programme_of
from cpic_planner.results import DetectionMode
from cpic_planner.targets import Targets
from simulator.imaging import HoleZone
from simulator.target import albedo_notes, albedo_source, needs_insolation, sky_to_detector

# Arrays of one step stay below 10 MB each: numbers of star-planet pairs to place, and to observe.
_PLACED = 1_000_000
_OBSERVED = 50_000
_PLANETS = 20_000
_N_ELEMENTS = 8000
_FAINTEST = 0.25
"""Significance over threshold below which no planet counts: the law of detections gives it next to nothing."""


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
        """Those of some stars, beside arrays of stars and planets."""
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
) -> BandCompleteness:
    """Fraction of a population that one observation of each star detects.

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
    for part in _slices(len(planets), _PLANETS):
        counts.add(part)
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
        self.found = np.zeros((2, len(targets)), np.int64)
        self.detected = np.zeros((3, 2, len(targets)))
        self.insolation = [np.inf, -np.inf]

    def add(self, part: slice) -> None:
        """Add planets of a slice; a map from sky to detector is linear in the offset, whatever its unit."""
        east, north = self.planets.east_au[part], self.planets.north_au[part]
        pa_deg = np.rad2deg(np.arctan2(east, north))
        x_au, y_au = sky_to_detector(np.hypot(east, north), pa_deg, parity=self.model.instrument.detector.parity)
        for rows in _slices(len(self.targets), _PLACED // len(x_au)):
            self._add_around(rows, part, x_au, y_au)

    def _add_around(self, rows: slice, part: slice, x_au: FloatArray, y_au: FloatArray) -> None:
        """Add planets of a slice around some of the stars."""
        model, band = self.model, self.band
        zone, radius = model.metrics[band].zone, model.metrics[band].aperture_radius_arcsec
        scale = self.planets.scale(self.targets.luminosity_lsun[rows])
        arcsec_au = (scale / self.targets.distance_pc[rows])[:, None]
        x, y = arcsec_au * x_au, arcsec_au * y_au
        self.found[0, rows] += np.count_nonzero(inside_zone(zone, x, y, 0.0), axis=1)
        usable = inside_zone(zone, x, y, radius)
        numbers = np.count_nonzero(usable, axis=1)
        self.found[1, rows] += numbers
        observed = np.flatnonzero((numbers > 0) & (self.setting.n_frames[rows] > 0.0))
        # Stars with about as many planets in the zone go together: little of a rectangle of pairs is then idle.
        observed = observed[np.argsort(numbers[observed], kind="stable")]
        for block in _blocks(numbers[observed]):
            stars = observed[block]
            most = int(numbers[stars].max())
            pick = np.argsort(~usable[stars], axis=1, kind="stable")[:, :most]
            here = (stars[:, None], pick)
            chosen = self.targets.select(stars + rows.start)
            contrast = self._contrast(chosen, pick + part.start, scale[stars], usable[here])
            which = stars + rows.start
            shown = np.nonzero(usable[here])
            places = x[here], y[here], contrast
            chance = _chances(model, chosen, band, places, shown, self.setting.of(which))
            self._count(which, shown[0], pick[shown] + part.start, scale[stars], chance)

    def _count(self, stars: IntArray, row: IntArray, planet: IntArray, scale: FloatArray, chance: FloatArray) -> None:
        """Add the planets of some stars, blind and at their place: chances of shape ``(2, k)``, with row and planet."""
        seen = np.flatnonzero(chance.max(axis=0) > 0.0)
        row, planet, chance = row[seen], planet[seen], chance[:, seen]
        there = chance
        if self.limits is not None:
            planets = self.planets
            axis = planets.semi_major_axis_au[planet] * scale[row]
            mass, tilt = planets.mass_mjup[planet], planets.inclination_deg[planet]
            there = chance * self.limits.allowed_probability(stars[row], axis, mass, tilt)
        for k, values in enumerate((chance, there, there**2)):
            for mode, value in enumerate(values):
                self.detected[k, mode, stars] += np.bincount(row, value, len(stars))

    def _contrast(self, targets: Targets, pick: IntArray, scale: FloatArray, usable: BoolArray) -> FloatArray:
        """Contrast of the picked planets of each star, shape ``(n, k)``; the range of their insolation is noted."""
        planets, kind = self.planets, self.planets.kind[pick]
        distance = planets.distance_au[pick] * scale[:, None]
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
    """Probabilities that planets are detected, blind and at their place, of offsets x and y, and contrasts.

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
    # A threshold lies above its level, and the law is what takes longest here.
    hopeful = np.flatnonzero(noise.significance[shown] >= _FAINTEST * strategy.sigma)
    here = shown[0][hopeful], shown[1][hopeful]
    separation = np.hypot(x[here], y[here])
    elements = model.metrics[band].resolution_elements(separation)
    defined = elements >= etc.MIN_ELEMENTS
    margin = defined * noise.significance[here] / np.exp(np.interp(elements, *_thresholds(strategy.sigma)))
    signal, quiet, white, snr, significance = (
        getattr(noise, name)[here] for name in ("signal_e", "quiet", "white", "snr", "significance")
    )
    seen = etc.StackNoise(signal, quiet, white, snr, significance, lambda: {"speckle": noise.terms["speckle"][here]})
    effective = etc.effective_of(programme, rates.speckle)
    visits, visit_s, many = (np.broadcast_to(part, x.shape)[here] for part in (effective, visit_s, programme.visits))
    search = etc.SearchMotion.of(model, targets, band, separation, here[0]).search
    moving = search.threshold_factor(many, model.time_s(visit_s))
    found = etc.visit_chances(model, band, separation, visit_s, seen, margin, visits, motion=moving)
    for mode, (part, needed) in enumerate(((found.blind, moving), (found.known_place, np.ones_like(moving)))):
        chance[mode, hopeful] = np.where(np.isnan(part), margin >= needed, part) * (margin > _FAINTEST)
    return chance


@functools.lru_cache(maxsize=8)
def _thresholds(sigma: float) -> tuple[FloatArray, FloatArray]:
    """Numbers of resolution elements, and logarithms of the thresholds of that level: to 10^-6 between them."""
    elements = etc.MIN_ELEMENTS - 1.0 + np.geomspace(1.0, 1e5, _N_ELEMENTS)
    return elements, np.log(etc.threshold_array(elements, sigma))


def inside_zone(zone: HoleZone, x_arcsec: FloatArray, y_arcsec: FloatArray, margin_arcsec: float) -> BoolArray:
    """Which points lie in the zone, at least ``margin`` from its edges.

    Parameters
    ----------
    zone : HoleZone
    x_arcsec : ndarray
        Offset from the star on the detector along x, arcsec.
    y_arcsec : ndarray
        Offset from the star on the detector along y, arcsec.
    margin_arcsec : float
        Distance kept from the edges, arcsec.
    """
    inside = np.ones(x_arcsec.shape, bool)
    for offset, parts in zip((y_arcsec, x_arcsec), zone.intervals(), strict=True):
        within = [(offset >= low + margin_arcsec) & (offset <= high - margin_arcsec) for low, high in parts]
        inside &= np.any(within, axis=0)
    return inside


def _notes(model: etc.EtcModel, band: str, planets: Planets, insolation: list[float]) -> tuple[str, ...]:
    """What was clamped or extrapolated in the planets' albedos."""
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
    """Exposure, frames and gain of every star, checked; 1 s and gain 1 where there are no frames."""
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


def _slices(length: int, step: int) -> Iterator[slice]:
    """Slices of at most ``step`` that cover a length."""
    for start in range(0, length, step):
        yield slice(start, min(start + step, length))


def _blocks(numbers: IntArray) -> Iterator[slice]:
    """Slices of ascending numbers, each a rectangle of at most `_OBSERVED` pairs (one row may have more)."""
    end = len(numbers)
    while end > 0:
        start = max(0, end - max(1, _OBSERVED // int(numbers[end - 1])))
        yield slice(start, end)
        end = start
