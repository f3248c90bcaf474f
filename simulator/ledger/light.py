"""Light of a scene on the pixels of a window, what particles leave there, and flaws of the pixels.

Light is from tables alone, good enough to tell what an effect of it may cost: the star behind the mask is its own image
at the standard settings; a source off the axis is the azimuthal mean of the unmasked point-spread function, or its wing
map where that is brighter: the frame around the stamp, and lines across it. Nothing is propagated.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray, Record, compute_once, stream
from simulator.camera import load_calibration_set
from simulator.config import AnyDetector, CosmicRayConfig, Instrument, content_hash
from simulator.detectors import aperture_noise_pixels
from simulator.effects import draw_cosmic_rays
from simulator.imaging import PsfMetrics, centred_axis, overlap_weights, pixel_axis
from simulator.signal import drift_halo, sky_pixel_e_s, spot, wing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from simulator.target import Source

MOST, MOST_BEYOND = 5.0, 20.0
"""Light in a pixel or an aperture over that of the wing map, at most, on it and beyond it: 4.6 out to 4 arcsec in the
four visible bands, where one pixel in a hundred has more than 3.8."""
# The same at least.
_LEAST, _LEAST_BEYOND = 0.02, 0.0
# Light that a core leaves in one row or column, in peak pixels, and how far from its middle.
_CORE_PEAKS, _CORE_REACH_LD = 8.0, 3.0
# Means over the boxes of the wing map, over single rows and columns of them.
_LANE = 2.0
_BRIGHTEST = 12
_MOST_SPOTS = 12
_FAR_POINTS = 16
_NEAR_STEPS = 4.0  # of the wing map, beyond which the light of a source is even over a few pixels


class SourceLight(Record, eq=False):
    """The light that a source other than the central star leaves on the window.

    Attributes
    ----------
    name : str
    kind : {"planet", "star"}
    peak_e_s, stamp_peak_e_s : float
        On its brightest pixel of the window, and of the stamp around the mask.
    rate_e_s : float
        Of all its light.
    distance_arcsec : float
        From the nearest pixel of the window, 0 inside.
    aperture_e_s, least_e_s : ndarray, shape (planets,)
        In the aperture of each measured planet, at most and at least.
    """

    name: str
    kind: str
    peak_e_s: float
    stamp_peak_e_s: float
    rate_e_s: float
    distance_arcsec: float
    aperture_e_s: FloatArray
    least_e_s: FloatArray


class _Aperture(Record, eq=False):
    """Aperture of a measured planet: its place, the part of the stamp under it and the weights there, none off it."""

    x_arcsec: float
    y_arcsec: float
    place: tuple[slice, slice]
    weights: FloatArray

    @classmethod
    def of(cls, metrics: PsfMetrics, n: int, x: float, y: float) -> _Aperture:
        column, row = (part / metrics.pixel_scale_arcsec + n // 2 for part in (x, y))
        middle = round(row), round(column)
        radius = metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec
        half = math.ceil(radius + 0.5)
        if min(middle) < half or max(middle) >= n - half:
            return cls(x, y, (slice(0, 0), slice(0, 0)), np.zeros((0, 0)))
        rows, columns = (slice(part - half, part + half + 1) for part in middle)
        return cls(x, y, (rows, columns), overlap_weights(radius, row - middle[0], column - middle[1]))

    def light_e_s(self, metrics: PsfMetrics, image: FloatArray, rate_e_s: float, x: float, y: float) -> float:
        """Return the light of a source at (x, y) with this image on the stamp; off the stamp that of its wings."""
        if self.weights.size:
            return float((self.weights * image[self.place]).sum())
        return rate_e_s * float(wing(metrics, self.x_arcsec - x, self.y_arcsec - y)) * metrics.aperture_pixels


class PlanetPlace(_Aperture, eq=False, kw_only=True):
    """A measured planet in its aperture; electrons per second.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        From the centre of the mask.
    place : tuple of slice
        Part of the stamp under the aperture.
    weights : ndarray
        Fractions of these pixels in the aperture; empty off the stamp.
    name : str
    signal_e_s, peak_e_s : float
        Its light in the aperture, and on its brightest pixel.
    core : float
        Of its core, the part that mask and cross leave; 1 far from both.
    halo_e_s, other_e_s, other_most_e_s, sky_e_s : float
        Light of the central star, of other sources at least and at most, and of the sky in the aperture.
    scattered_e_s : float
        Of the halo, what a drifting wavefront adds.
    column_e_s : float
        Light of whole columns of the frame under the aperture, which the transfer smears into it.
    inside : bool
        Whether all of the aperture lies in the dark hole.
    """

    name: str
    signal_e_s: float
    peak_e_s: float
    core: float
    halo_e_s: float
    other_e_s: float
    other_most_e_s: float
    sky_e_s: float
    scattered_e_s: float
    column_e_s: float
    inside: bool

    @property
    def hidden(self) -> float:
        """What mask and cross hide of its core over what they leave, at most 50."""
        return min((1.0 - self.core) / max(self.core, 1e-3), 50.0)


class SceneLight:
    """Light on a window; electrons per second and pixel, before the camera.

    Parameters
    ----------
    instrument : Instrument
    band : str
    metrics : PsfMetrics
    sources : sequence of Source
        The central star first.
    measured : sequence of str
        Names of the planets that are measured.
    full : bool
        Whole frame, or the stamp around the mask.
    star_offset_arcsec : tuple of float
        Place of the central star relative to the mask.
    sky_e_s_arcsec2, stray_e_s : float
        Sky in front of the telescope, and light given on a pixel.
    drift_nm : float
        Rms of the wavefront at the end of the visit.

    Attributes
    ----------
    star_e_s : ndarray, shape (n, n)
        Central star on the stamp around the mask.
    scattered_e_s : ndarray, shape (n, n)
        Of it, what a drifting wavefront adds.
    total_e_s, least_e_s, most_e_s : ndarray, shape (n, n)
        Everything there; with what is certain of the other sources alone, and with their light at most.
    outside_e_s : ndarray, shape (k,)
        Levels of pixels of the window beyond the stamp; empty where there are none.
    column_e_s : float
        Largest sum over a column of the frame, of those of the window.
    beyond_peaks_e_s : tuple of float
        Brightest pixel of the frame beyond the window in its columns, and brightest run of pixels in its rows.
    sky_e_s : float
        Of the sky and stray light on an open pixel.
    radius_arcsec : ndarray, shape (n, n)
        Distance of the pixels of the stamp from the star.
    sources : tuple of SourceLight
    planets : tuple of PlanetPlace
        The measured ones.
    aperture_pixels, noise_pixels : float
        Area of the aperture in pixels, and the sum of squared weights.
    half_arcsec : float
        Half side of the stamp.
    frame_arcsec : tuple of float
        Half sides of the frame, x and y.
    """

    def __init__(
        self,
        instrument: Instrument,
        band: str,
        metrics: PsfMetrics,
        sources: Sequence[Source],
        *,
        measured: Sequence[str],
        full: bool,
        star_offset_arcsec: tuple[float, float],
        sky_e_s_arcsec2: float,
        stray_e_s: float,
        drift_nm: float,
    ) -> None:
        n, pixel = len(metrics.raw_contrast), metrics.pixel_scale_arcsec
        offset, detector = centred_axis(n, pixel), instrument.detector_of(band)
        open_part = pixel_axis(offset, pixel, 1, metrics.mask_half_width_arcsec).open_fraction
        open_map = np.outer(open_part, open_part)
        star = sources[0]
        lengths = (detector.star_column, detector.n_columns), (detector.star_row, detector.n_rows)
        self.metrics, self.half_arcsec = metrics, n // 2 * pixel
        self.frame_arcsec = [max(middle, length - 1 - middle) * pixel for middle, length in lengths]
        self.radius_arcsec = np.hypot(offset[:, None], offset)
        self.aperture_pixels = metrics.aperture_pixels
        self.noise_pixels = float(aperture_noise_pixels(metrics.aperture_radius_arcsec / pixel))
        self.sky_e_s = float(sky_pixel_e_s(metrics, sky_e_s_arcsec2)) + stray_e_s
        self._moved = any(star_offset_arcsec)
        if self._moved:
            self.scattered_e_s = np.zeros((n, n))
            self.star_e_s = star.rate_e_s * spot(metrics, offset, *star_offset_arcsec) * open_map
        else:
            slope, wavelength_nm = instrument.drift.psd_slope, instrument.band(band).center_nm
            halo = drift_halo(metrics, self.radius_arcsec, drift_nm, slope, wavelength_nm)
            self.scattered_e_s = star.rate_e_s * metrics.peak_off_axis * halo * open_map
            self.star_e_s = star.rate_e_s * metrics.peak_off_axis * metrics.raw_contrast + self.scattered_e_s
        places = [(s.x_arcsec + star_offset_arcsec[0], s.y_arcsec + star_offset_arcsec[1]) for s in sources]
        self._every, self._places, self._open_map = sources, places, open_map
        self._rates = np.array([source.rate_e_s for source in sources])
        chosen = [i for i, source in enumerate(sources) if source.kind == "planet" and source.name in measured]
        apertures = [_Aperture.of(metrics, n, *places[i]) for i in chosen]
        lights = _other_lights(metrics, sources[1:], places[1:], apertures, offset, open_map)
        peaks, inside, others, others_most = lights
        even = self.star_e_s + self.sky_e_s * open_map
        self.total_e_s = even + others
        self.least_e_s, self.most_e_s = even + _LEAST * others, even + others_most
        self.sources = tuple(
            self._source(source, *place, peak, light, full=full)
            for source, place, peak, light in zip(sources[1:], places[1:], peaks, inside, strict=True)
        )
        self.planets = tuple(
            self._planet(aperture, index, i) for index, (i, aperture) in enumerate(zip(chosen, apertures, strict=True))
        )
        stars = [(*place, source.rate_e_s) for place, source in zip(places[1:], sources[1:], strict=True)]
        self._shining = [*stars, *([(*places[0], star.rate_e_s)] if self._moved else [])]
        outside, columns, crossing = self._beyond(star.rate_e_s, stars)
        self.outside_e_s = outside if full else np.zeros(0)
        self.column_e_s = float(self.total_e_s.sum(axis=0).max()) + columns
        self.beyond_peaks_e_s = (0.0, 0.0) if full else crossing

    def _source(
        self, source: Source, x: float, y: float, peak: float, aperture_e_s: FloatArray, *, full: bool
    ) -> SourceLight:
        window = self.frame_arcsec if full else (self.half_arcsec, self.half_arcsec)
        away = math.hypot(max(abs(x) - window[0], 0.0), max(abs(y) - window[1], 0.0))
        seen = max(peak, source.rate_e_s * self.metrics.peak_off_axis) if away == 0 and full else peak
        off = _off_map(self.metrics, x, y, self.half_arcsec)
        most, least = (part * aperture_e_s for part in ((MOST_BEYOND, _LEAST_BEYOND) if off else (MOST, _LEAST)))
        return SourceLight(source.name, source.kind, float(seen), float(peak), source.rate_e_s, away, most, least)

    def _planet(self, aperture: _Aperture, index: int, own: int) -> PlanetPlace:
        """Return one of the measured planets, number ``own`` of all sources."""
        metrics, x, weights, place = self.metrics, aperture.x_arcsec, aperture.weights, aperture.place
        core, planet = float(metrics.core_throughput(x, aperture.y_arcsec)), self._every[own]
        elsewhere = [light for number, light in enumerate(self.sources, start=1) if number != own]
        open_pixels = float((weights * self._open_map[place]).sum()) if weights.size else metrics.aperture_pixels
        in_hole = metrics.zone.contains(np.array(x), np.array(aperture.y_arcsec), metrics.aperture_radius_arcsec)
        # Light in columns of every source but the planet itself, and of the sky.
        unmasked = np.arange(len(self._every)) != own
        unmasked[0] &= self._moved
        columns = metrics.source_column_aperture(x - np.array([each for each, _ in self._places]))
        column_e_s = float((self._rates * columns)[unmasked].sum())
        column_e_s += 0.0 if self._moved else self._every[0].rate_e_s * float(metrics.column_aperture(x))
        sky_e_s = self.sky_e_s * 2.0 * self.frame_arcsec[1] / metrics.pixel_scale_arcsec * metrics.aperture_pixels
        return PlanetPlace(
            **vars(aperture),
            name=planet.name,
            signal_e_s=planet.rate_e_s * core,
            peak_e_s=min(planet.rate_e_s * metrics.peak_off_axis, self.sources[own - 1].peak_e_s),
            core=min(core / metrics.core_open, 1.0) if metrics.core_open > 0 else 1.0,
            halo_e_s=aperture.light_e_s(metrics, self.star_e_s, self._every[0].rate_e_s, *self._places[0]),
            other_e_s=sum(float(light.least_e_s[index]) for light in elsewhere),
            other_most_e_s=sum(float(light.aperture_e_s[index]) for light in elsewhere),
            sky_e_s=self.sky_e_s * open_pixels,
            scattered_e_s=float((weights * self.scattered_e_s[place]).sum()),
            column_e_s=column_e_s + sky_e_s,
            inside=bool(in_hole),
        )

    def _beyond(
        self, rate_e_s: float, stars: Sequence[tuple[float, float, float]]
    ) -> tuple[FloatArray, float, tuple[float, float]]:
        """Return levels of pixels beyond the stamp, their largest sum over a column, the brightest in columns and rows.

        A core holds the light of eight of its peak pixels in one column, the arm of a star beside the column some ten
        pixels of its wing.
        """
        metrics, half, frame = self.metrics, self.half_arcsec, self.frame_arcsec
        step, pixel = metrics.wing_map_step_arcsec, metrics.pixel_scale_arcsec
        last = len(metrics.wing_map) // 2
        arm = np.arange(-last, last + 1) * step
        x, y = np.meshgrid(arm, arm)
        cross = np.minimum(np.abs(x), np.abs(y)) >= metrics.mask_half_width_arcsec
        outside = (np.maximum(np.abs(x), np.abs(y)) > half) & (np.abs(x) <= frame[0]) & (np.abs(y) <= frame[1])
        light = np.where(cross & outside, metrics.wing_map, 0.0) * rate_e_s
        column = float(light[:, np.abs(arm) <= half].sum(axis=0).max()) * step / pixel
        column += self.sky_e_s * 2.0 * frame[1] / pixel
        brightest = rate_e_s * metrics.peak_on_axis_frame
        in_columns, in_rows = rate_e_s * metrics.peak_on_axis_columns, rate_e_s * metrics.register_tail
        for at_x, at_y, rate in stars:
            seen, peak = abs(at_x) <= frame[0] and abs(at_y) <= frame[1], rate * metrics.peak_off_axis
            if seen:
                brightest = max(brightest, peak)
            if seen and abs(at_y) <= half:
                in_rows = max(in_rows, peak)
            if seen and abs(at_x) <= half:
                in_columns, column = max(in_columns, peak), column + 8.0 * peak
            else:
                column += 10.0 * MOST * rate * float(wing(metrics, max(abs(at_x) - half, pixel), 0.0))
        levels = light[outside] * MOST + self.sky_e_s
        return np.concatenate([levels, [brightest, self.sky_e_s, 0.0]]), column, (in_columns, in_rows)

    def lanes(self, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the light beyond the stamp along all its rows or columns, electrons per second and pixel.

        Parameters
        ----------
        axis : {"x", "y"}
            Along which they run: rows, or columns.
        sign : {-1, 1}
            Side of the stamp.

        Returns
        -------
        light : ndarray, shape (n, m)
            At most, in boxes; nearest to the stamp first.
        pixels : float
            Length of a box.
        """
        metrics = self.metrics
        step, pixel, edge = metrics.wing_map_step_arcsec, metrics.pixel_scale_arcsec, self.frame_arcsec[axis == "y"]
        across = centred_axis(len(self.star_e_s), pixel)[:, None]
        n = max(int(np.ceil((edge - self.half_arcsec) / step)), 0)
        along = np.asarray(sign * (self.half_arcsec + step * (np.arange(n) + 0.5)), float)[None, :]

        def wings(here: float, beside: float) -> FloatArray:
            offsets = along - here, across - beside
            return wing(metrics, *(offsets if axis == "x" else offsets[::-1]))

        light = np.full((len(across), n), self.sky_e_s)
        if not self._moved:
            open_lane = np.abs(across) > metrics.mask_half_width_arcsec
            light = light + _LANE * self._every[0].rate_e_s * wings(0.0, 0.0) * open_lane
        reach = _CORE_REACH_LD * metrics.lambda_d_arcsec
        for rank, (x, y, rate) in enumerate(sorted(self._shining, key=lambda star: -star[2])):
            here, beside = (x, y) if axis == "x" else (y, x)
            if rank < _BRIGHTEST:
                light = light + _LANE * rate * wings(here, beside)
            # A row or column through a core holds much of its light; wings of the many faint stars are nothing to it.
            if across.min() - reach <= beside <= across.max() + reach:
                core = (np.abs(across - beside) <= reach) & (np.abs(along - here) <= 0.5 * step + reach)
                light = light + core * (_CORE_PEAKS * rate * metrics.peak_off_axis * pixel / step)
        return light, step / pixel


def _other_lights(
    metrics: PsfMetrics,
    sources: Sequence[Source],
    places: Sequence[tuple[float, float]],
    apertures: Sequence[_Aperture],
    offset: FloatArray,
    open_map: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return light of sources off the axis: brightest pixels (s,), in apertures (s, k), the most on the stamp.

    The brightest sources near the stamp have an image each; light of the others is even over cells as wide as those of
    the wing map.
    """
    half, n = len(offset) // 2 * metrics.pixel_scale_arcsec, len(offset)
    rates, (x, y) = np.array([source.rate_e_s for source in sources]), np.array(places).reshape(-1, 2).T
    close = half + _NEAR_STEPS * metrics.wing_map_step_arcsec
    brightest = np.argsort(-rates, kind="stable")[:_MOST_SPOTS]
    near = sorted(int(i) for i in brightest if max(abs(x[i]), abs(y[i])) <= close)
    far = np.setdiff1d(np.arange(len(sources)), near).astype(np.intp)
    along, cell = np.linspace(-half, half, _FAR_POINTS), np.rint(np.linspace(0, _FAR_POINTS - 1, n)).astype(np.intp)
    cells = wing(metrics, along - x[far, None, None], along[:, None] - y[far, None, None]) * rates[far, None, None]
    peaks, inside = np.zeros(len(sources)), np.zeros((len(sources), len(apertures)))
    most_there = np.where(_off_map(metrics, x[far], y[far], half), MOST_BEYOND, MOST)
    peaks[far] = cells.max(axis=(1, 2), initial=0.0) * most_there
    for j, aperture in enumerate(apertures):
        if aperture.weights.size:
            rows, columns = (cell[part] for part in aperture.place)
            shares = np.zeros((_FAR_POINTS, _FAR_POINTS))
            np.add.at(shares, (rows[:, None], columns), aperture.weights * open_map[aperture.place])
            inside[far, j] = np.tensordot(cells, shares, axes=2)
        else:
            wings = wing(metrics, aperture.x_arcsec - x[far], aperture.y_arcsec - y[far])
            inside[far, j] = rates[far] * wings * metrics.aperture_pixels
    total = cells.sum(axis=0)[np.ix_(cell, cell)] * open_map
    most = MOST * total
    for i in near:
        light = rates[i] * spot(metrics, offset, x[i], y[i]) * open_map
        beside = np.hypot(offset - x[i], (offset - y[i])[:, None]) > 2.0 * metrics.wing_map_step_arcsec
        peaks[i] = max(float(light.max()), MOST * float(light[beside].max(initial=0.0)))
        total = total + light
        most = most + np.minimum(MOST * light, rates[i] * metrics.peak_off_axis * open_map)
        inside[i] = [aperture.light_e_s(metrics, light, rates[i], x[i], y[i]) for aperture in apertures]
    return peaks, inside, total, most


def _off_map(metrics: PsfMetrics, x: FloatArray | float, y: FloatArray | float, half: float) -> BoolArray:
    """Return whether a source is so far from the stamp that the wing map does not reach it."""
    reach = len(metrics.wing_map) // 2 * metrics.wing_map_step_arcsec
    return np.asarray(np.maximum(np.abs(x), np.abs(y)) - half > reach)


class Flaw(NamedTuple):
    """Relative change of the response and of the dark current by one flaw: on the stamp, and at most on the frame."""

    response: FloatArray
    dark_e_s: FloatArray
    most_response: float
    most_dark_e_s: float


@functools.lru_cache(maxsize=8)
def stamp_flaws(detector: AnyDetector, corner: tuple[int, int], side: int) -> tuple[dict[str, Flaw], FloatArray]:
    """Return the flaws of the calibration set, by switch, and the stripes of the stamp and of the frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    corner : tuple of int
        First row and column of the stamp on the frame.
    side : int
        Of the stamp, pixels.
    """
    maps = load_calibration_set(detector)
    hot = maps.hot & ~maps.bad_column
    raised, nothing = maps.dark_e_s - maps.dark_smooth_e_s, np.zeros(maps.shape)
    frame = {
        "flat": (np.where(maps.sensitivity > 0, maps.sensitivity - 1.0, 0.0), nothing),
        "dark_structure": (nothing, maps.dark_smooth_e_s - maps.dark_uniform_e_s),
        "bad_pixels": (maps.dead * 1.0, hot * raised),
        "bad_columns": (maps.bad_column * 1.0, maps.bad_column * raised),
    }

    def stamp(values: FloatArray) -> FloatArray:
        part = np.zeros((side, side))
        rows, columns = (np.arange(first, first + side) for first in corner)
        there = [(axis >= 0) & (axis < size) for axis, size in zip((rows, columns), values.shape, strict=True)]
        part[np.ix_(*there)] = np.abs(values[np.ix_(rows[there[0]], columns[there[1]])])
        return part

    found = {
        key: Flaw(stamp(response), stamp(dark), float(np.abs(response).max()), float(np.abs(dark).max()))
        for key, (response, dark) in frame.items()
    }
    seen = maps.stripe_adu[max(corner[1], 0) : corner[1] + side]
    return found, np.array([np.abs(seen).max(initial=0.0), np.abs(maps.stripe_adu).max(initial=0.0)])


_SIDE, _TRACKS = 700, 1500.0
_CM_PER_UM = 1e-4


class PixelHits(NamedTuple):
    """Charge of a track by pixels.

    Attributes
    ----------
    mean_e : float
        Electrons a track.
    square_e2 : float
        Sum over its pixels of the squared charge.
    charge_e : ndarray
        Charge of pixels that were hit, ascending.
    """

    mean_e: float
    square_e2: float
    charge_e: FloatArray

    def share_above(self, level_e: float) -> float:
        """Return the share of the squared charge in pixels of more than a level."""
        squares = self.charge_e**2
        return float(squares[np.searchsorted(self.charge_e, level_e) :].sum() / max(squares.sum(), 1e-300))

    @property
    def typical_e(self) -> float:
        """Mean charge weighted by its square."""
        squares = self.charge_e**2
        return float((squares * self.charge_e).sum() / max(squares.sum(), 1e-300))


@functools.lru_cache(maxsize=8)
def pixel_hits(config: CosmicRayConfig, pixel_um: float) -> PixelHits:
    """Return the moments of a configured model of tracks, from 1500 of them drawn from a fixed stream.

    The moments of a track that crosses pixels at random have no closed form; those drawn are good to 5 %. They are
    drawn once and kept in the cache, but for tracks of a file, which may change.

    Parameters
    ----------
    config : CosmicRayConfig
    pixel_um : float
        Side of a pixel.
    """

    def drawn() -> dict[str, Any]:
        area_cm2 = (_SIDE * pixel_um * _CM_PER_UM) ** 2
        found = draw_cosmic_rays(config, (_SIDE, _SIDE), pixel_um, 1.0, _TRACKS / area_cm2, stream(1, "ledger", "hits"))
        charge, tracks = np.sort(found.electrons.astype(np.float64)), max(found.n_events, 1)
        return PixelHits(charge.sum() / tracks, (charge**2).sum() / tracks, charge)._asdict()

    def read(found: Mapping[str, Any]) -> PixelHits:
        return PixelHits(float(found["mean_e"]), float(found["square_e2"]), found["charge_e"])

    if config.model == "template" and config.template.template_file is not None:
        return read(drawn())
    key = {"tracks": config.model_dump(mode="json"), "pixel_um": pixel_um, "side": _SIDE, "mean": _TRACKS, "schema": 1}
    return compute_once(f"hits-{content_hash(key)}", drawn, read)
