"""Select the planets of a population that stand in the dark zone of a star and are not too faint to count.

Neither where planets stand nor what they are depends on how dark the zone is: rankings under many instruments of one
geometry place them once.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner import etc
from cpic_planner.planets import Planets
from cpic_planner.ranking.programmes import programme_of
from cpic_planner.targets import Targets
from simulator.imaging import PsfMetrics, Zone
from simulator.signal import ProgrammeLaw, SpeckleLaw, programme_law
from simulator.target import sky_to_detector

# Arrays of one step stay below 10 MB each: numbers of star-planet pairs to place, and to work out together.
_PLACED = 1_000_000
_TOGETHER = 50_000
_PLANETS = 20_000
_IDLE = 6_000
"""Idle places of a rectangle of pairs that cost as much as one more rectangle."""
N_RINGS, _FINE = 40, 40
_SURE = 0.95
"""Part of the faintest contrast that counts: steps of tables and splines are finer by far."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Planets around some of the stars whose whole aperture lies in the zone: ``k`` pairs, star by star.

    Attributes
    ----------
    rows : slice
        The stars that were looked at.
    in_zone, observable : ndarray, shape (len(rows),)
        Number of planets in the zone, and of those whose whole aperture is.
    star, planet : ndarray of int, shape (k,)
        Of each pair.
    x_arcsec, y_arcsec : ndarray, shape (k,)
        Offset from the star on the detector.
    ring : ndarray of int, shape (k,)
        Ring of `faintest_contrast` in which it stands.
    """

    rows: slice
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
        """Yield the planets in the zone of a band, a part of the stars and of the planets at a time.

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
        planets, targets = self.planets, self.targets
        arcsec_au = planets.scale(targets.luminosity_lsun) / targets.distance_pc
        for part in _slices(len(planets), _PLANETS):
            east, north = planets.east_au[part], planets.north_au[part]
            pa_deg = np.rad2deg(np.arctan2(east, north))
            x_au, y_au = sky_to_detector(np.hypot(east, north), pa_deg, parity=parity)
            for rows in _slices(len(targets), _PLACED // len(x_au)):
                x, y = arcsec_au[rows, None] * x_au, arcsec_au[rows, None] * y_au
                in_zone = np.count_nonzero(inside_zone(zone, x, y, 0.0), axis=1)
                usable = inside_zone(zone, x, y, radius_arcsec)
                star, planet = np.nonzero(usable)
                x, y = x[star, planet], y[star, planet]
                yield Placed(
                    rows=rows,
                    in_zone=in_zone,
                    observable=np.count_nonzero(usable, axis=1),
                    star=star + rows.start,
                    planet=planet + part.start,
                    x_arcsec=x,
                    y_arcsec=y,
                    ring=ring_of(zone, np.hypot(x, y)),
                )


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
    least = _least(programme_law(metrics, model.instrument.drift, fine, width, ratio, model.timing))
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


def _least(law: ProgrammeLaw) -> ProgrammeLaw:
    """Return the least of a law along the last axis: its parts all fall and grow with the two variances that it has."""

    def least(part: SpeckleLaw) -> SpeckleLaw:
        return SpeckleLaw(*(np.asarray(k).min(axis=-1) for k in part))

    science, reference, common = map(least, law[:3])
    turned = None if law.turned is None else least(law.turned)
    return law._replace(science=science, reference=reference, common=common, turned=turned)


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


def inside_zone(zone: Zone, x_arcsec: FloatArray, y_arcsec: FloatArray, margin_arcsec: float) -> BoolArray:
    """Return which points lie in the zone, at least ``margin`` from its edges; parameters as of `HoleZone.contains`."""
    return zone.contains(x_arcsec, y_arcsec, margin_arcsec)
