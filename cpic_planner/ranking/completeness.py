"""How many planets of a population one observation of each star detects, of all and of those that may still exist."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, check_finite, real_array
from cpic_planner import etc
from cpic_planner.planets import Planets, StarLimits
from cpic_planner.targets import Targets
from simulator.imaging import HoleZone
from simulator.target import albedo_notes, albedo_source, needs_insolation, sky_to_detector

# Arrays of one step stay below 10 MB each: numbers of star-planet pairs to place, and to observe.
_PLACED = 1_000_000
_OBSERVED = 50_000
_PLANETS = 20_000


@dataclass(frozen=True, eq=False)
class BandCompleteness:
    """Fractions of a population in one band, arrays over the stars.

    Attributes
    ----------
    band : str
    n_planets : int
        Planets drawn, the same for every star.
    completeness : ndarray
        Fraction that the one observation detects and that nothing known excludes: the mean of the probability that a
        detected planet may still exist.
    completeness_unconditional : ndarray
        Fraction detected by the one observation, whatever is known.
    standard_error : ndarray
        Of ``completeness``, by the number of planets drawn: binomial where nothing is known; 0 where none or all are
        detected, and then below 3 / n with 95 %.
    in_zone : ndarray
        Fraction that stands in the dark quadrants.
    observable : ndarray
        Fraction whose whole aperture lies there: no observation detects more.
    expected_planets, expected_planets_unconditional : ndarray or None
        Both times the population's planets per star, if it has an occurrence rate.
    flags : tuple of str
        What was clamped or extrapolated for some planet, and a dark hole that is not as dark as asked.
    """

    band: str
    n_planets: int
    completeness: FloatArray
    completeness_unconditional: FloatArray
    standard_error: FloatArray
    in_zone: FloatArray
    observable: FloatArray
    expected_planets: FloatArray | None
    expected_planets_unconditional: FloatArray | None
    flags: tuple[str, ...]


def completeness(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    planets: Planets,
    *,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    limits: StarLimits | None = None,
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
        Setting of each star, one number or shape ``(n,)``. No frames detect nothing, and their other numbers do not
        matter. Where photons are counted all stars have one gain.
    limits : StarLimits, optional
        What is known of the ``n`` stars; without it every planet may exist.

    Returns
    -------
    BandCompleteness

    Raises
    ------
    InputError
        If the band is unknown, a setting is out of range, or a luminosity that is needed is unknown.

    Notes
    -----
    A planet is detected if its whole photometric aperture lies in the dark zone at roll 0 and its significance reaches
    the small-sample threshold of its separation, which is undefined below three resolution elements. Core throughput,
    halo and contrast are its own. The setting is not changed for it: one bright enough to saturate counts as detected.
    """
    if band not in model.metrics:
        raise InputError("band", band, allowed=", ".join(model.bands))
    settings = _settings(model, len(targets), exposure_s, n_frames, em_gain)
    counts = _Counts(model, targets, band, planets, settings, limits)
    for part in _slices(len(planets), _PLANETS):
        counts.add(part)
    n = len(planets)
    detected, in_zone, observable = counts.found / n
    allowed, squared = counts.allowed / n
    occurrence = planets.planets_per_star
    return BandCompleteness(
        band=band,
        n_planets=n,
        completeness=allowed,
        completeness_unconditional=detected,
        standard_error=np.sqrt(np.maximum(squared - allowed**2, 0.0) / n),
        in_zone=in_zone,
        observable=observable,
        expected_planets=None if occurrence is None else occurrence * allowed,
        expected_planets_unconditional=None if occurrence is None else occurrence * detected,
        flags=_notes(model, band, planets, counts.insolation) + etc.hole_notes(model, band),
    )


class _Counts:
    """Numbers of planets around each star, and the range of insolation of those that follow it.

    The rows of ``found`` are planets detected, in the zone, and observable; those of ``allowed`` the sums, over the
    detected ones, of the probability that they may exist, and of its square.
    """

    def __init__(
        self,
        model: etc.EtcModel,
        targets: Targets,
        band: str,
        planets: Planets,
        settings: tuple[FloatArray, ...],
        limits: StarLimits | None,
    ) -> None:
        self.model = model
        self.targets = targets
        self.band = band
        self.planets = planets
        self.settings = settings
        self.limits = limits
        self.found = np.zeros((3, len(targets)), np.int64)
        self.allowed = np.zeros((2, len(targets)))
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
        self.found[1, rows] += np.count_nonzero(inside_zone(zone, x, y, 0.0), axis=1)
        usable = inside_zone(zone, x, y, radius)
        numbers = np.count_nonzero(usable, axis=1)
        self.found[2, rows] += numbers
        observed = np.flatnonzero((numbers > 0) & (self.settings[1][rows] > 0.0))
        # Stars with about as many planets in the zone go together: little of a rectangle of pairs is then idle.
        observed = observed[np.argsort(numbers[observed], kind="stable")]
        for block in _blocks(numbers[observed]):
            stars = observed[block]
            most = int(numbers[stars].max())
            pick = np.argsort(~usable[stars], axis=1, kind="stable")[:, :most]
            here = (stars[:, None], pick)
            chosen = self.targets.select(stars + rows.start)
            contrast = self._contrast(chosen, pick + part.start, scale[stars], usable[here])
            setting = [value[rows][stars][:, None] for value in self.settings]
            detected = _detected(model, chosen, band, x[here], y[here], contrast, setting) & usable[here]
            numbers_of = stars + rows.start
            self.found[0, numbers_of] += np.count_nonzero(detected, axis=1)
            self.allowed[:, numbers_of] += self._allowed(numbers_of, pick + part.start, scale[stars], detected)

    def _allowed(self, stars: IntArray, pick: IntArray, scale: FloatArray, detected: BoolArray) -> FloatArray:
        """Sums over the detected planets of each star of the probability that they may exist, and of its square."""
        if self.limits is None:
            return np.broadcast_to(np.count_nonzero(detected, axis=1), (2, len(stars))).astype(float)
        rows, _ = np.nonzero(detected)
        which, planets = pick[detected], self.planets
        axis = planets.semi_major_axis_au[which] * scale[rows]
        tilt = planets.inclination_deg[which]
        chance = self.limits.allowed_probability(stars[rows], axis, planets.mass_mjup[which], tilt)
        return np.stack([np.bincount(rows, value, len(stars)) for value in (chance, chance**2)])

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


def _detected(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    x_arcsec: FloatArray,
    y_arcsec: FloatArray,
    contrast: FloatArray,
    setting: list[FloatArray],
) -> BoolArray:
    """Whether planets reach the threshold of their separation."""
    rates = etc.aperture_rates(model, targets, band, x_arcsec, y_arcsec, contrast)
    significance = _significance(model, rates, band, setting)
    # The threshold lies above sigma for any number of elements, and it is what takes longest here.
    sigma = model.strategy.sigma
    hopeful = significance >= sigma
    elements = model.metrics[band].resolution_elements(np.hypot(x_arcsec[hopeful], y_arcsec[hopeful]))
    hopeful[hopeful] = significance[hopeful] >= etc.threshold_array(elements, sigma)
    return hopeful


def _significance(model: etc.EtcModel, rates: etc.ApertureRates, band: str, setting: list[FloatArray]) -> FloatArray:
    """Signal over noise without the planet's own, of charge measured or photons counted."""
    strategy, camera = model.strategy, model.camera(band)
    exposure_s, n_frames, em_gain = setting
    if strategy.mode == "analogue":
        return etc.stack_noise(rates, exposure_s, n_frames, em_gain, camera, strategy).significance
    problem = etc.frame_problem(rates, camera, strategy, objective="significance", em_gain=float(em_gain.flat[0]))
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.sqrt(problem.inverse_snr2(exposure_s, n_frames)))


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
