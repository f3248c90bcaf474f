"""Light of a scene on the pixels of a window, from tables alone: good enough to tell what an effect of it may cost.

The star behind the mask is its own image at the standard settings; a source off the axis is the azimuthal mean of the
unmasked point-spread function, or its wing map where that is brighter: the frame around the stamp, and lines across it.
Nothing is propagated.

A pixel above its full well passes the excess on along its column, the register above its own along the row, to what is
read next. Nothing arrives at a place exactly if every run of pixels that ends there holds less than its wells do: the
light of a run is compared with them, five sigma of noise included, however far away it begins.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray
from simulator.config import Instrument
from simulator.detectors import aperture_noise_pixels
from simulator.imaging import PsfMetrics, centred_axis, overlap_weights, pixel_axis
from simulator.signal import drift_halo, sky_pixel_e_s, spot, wing
from simulator.target import Source

if TYPE_CHECKING:
    from simulator.ledger.case import CameraCase


_SIGMA = 5.0


class Spill:
    """Blooming and tails of the register on the stamp of a case."""

    def __init__(self, case: CameraCase) -> None:
        self.case = case
        detector, factor2 = case.detector, case.noise.factor2
        self._pixel, self._register = detector.blooming_e, detector.trailing_e / case.em_gain
        self._factor2 = factor2
        self._known: dict[tuple[str, int], tuple[FloatArray, float]] = {}
        # Where even the brightest pixel stays below its limit nothing flows.
        top = float(case.most_e.max()) + case.noise.dark_e + case.noise.clock_e
        if top + _SIGMA * math.sqrt(top) <= self._pixel:
            self._pixel = np.inf
        if top + _SIGMA * math.sqrt(factor2 * top) <= self._register:
            self._register = np.inf

    @functools.cached_property
    def _charge_e(self) -> FloatArray:
        """Electrons of the pixels of the stamp at the register, with the light of other sources at most."""
        case = self.case
        side = len(case.charge_e)
        return case.most_e[: side * side].reshape(side, side) + case.noise.dark_e + case.noise.clock_e

    def blooms_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge flows along the columns into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._pixel):
            return False
        return self._over(rows, columns, self._pixel, 1.0) or bool(self._blooming_columns(rows)[columns].any())

    def trails_into(self, rows: slice, columns: slice) -> bool:
        """Return whether charge of the register flows along the rows into a part of the stamp, or is too much there.

        Parameters
        ----------
        rows, columns : slice
            The part of the stamp.
        """
        if not np.isfinite(self._register):
            return False
        if self._over(rows, columns, self._register, self._factor2):
            return True
        charge = self._charge_e[rows]
        # No pixel hands on more than it holds; what blooms across these rows fills its pixels there.
        most = self.case.detector.blooming_e
        charge = np.minimum(charge, most)
        if np.isfinite(self._pixel):
            charge = np.where(self._blooming_columns(rows), most, charge)
        before = charge[:, : columns.start][:, ::-1]
        parts = [(before, 1.0)]
        if self.case.full:
            light, pixels = self._lanes("x", -1)
            parts.append((np.minimum(light[rows], most), pixels))
        return bool(_arrives(parts, self._register, self._factor2).any())

    def _over(self, rows: slice, columns: slice, well_e: float, factor2: float) -> bool:
        """Return whether a pixel in there holds too much itself."""
        top = float(self._charge_e[rows, columns].max(initial=0.0))
        return top + _SIGMA * math.sqrt(factor2 * top) > well_e

    def _blooming_columns(self, rows: slice) -> BoolArray:
        """Return the columns of the stamp along which charge arrives at some rows."""
        charge, found = self._charge_e.T, np.zeros(len(self._charge_e), dtype=np.bool_)
        # Half of the excess goes up, first; the other half down, where the first may have taken its room.
        for sign, run, part in ((-1, charge[:, : rows.start][:, ::-1], 0.5), (1, charge[:, rows.stop :], 1.0)):
            parts = [(run, 1.0)]
            if self.case.full:
                parts.append(self._lanes("y", sign))
            found |= _arrives(parts, self._pixel, 1.0, part)
        return found

    def _lanes(self, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the charge beyond the stamp along all its rows or columns, and the pixels of a box."""
        if (axis, sign) not in self._known:
            case = self.case
            places = centred_axis(len(case.light.star_e_s), case.pixel_arcsec)
            light, pixels = case.light.surroundings.lanes(places, axis, sign)
            self._known[axis, sign] = light * case.exposure_s + case.noise.dark_e + case.noise.clock_e, pixels
        return self._known[axis, sign]


def _arrives(parts: Sequence[tuple[FloatArray, float]], well_e: float, factor2: float, share: float = 1.0) -> BoolArray:
    """Return whether any run of each line, nearest pixel first, holds more than its wells; shape (lines,).

    ``share`` of what is above the well of a pixel goes this way.
    """
    charge = np.concatenate([levels * pixels for levels, pixels in parts], axis=1)
    length = np.concatenate([np.full(levels.shape[1], pixels) for levels, pixels in parts])
    if not charge.shape[1]:
        return np.zeros(len(charge), dtype=np.bool_)
    over = charge - well_e * length
    passed = np.cumsum(np.where(over > 0, share * over, over), axis=1)
    return np.asarray((passed + _SIGMA * share * np.sqrt(factor2 * np.cumsum(charge, axis=1)) > 0).any(axis=1))


MOST, MOST_BEYOND = 5.0, 20.0
"""Light in a pixel or an aperture over that of the wing map, at most, on it and beyond it: 4.6 out to 4 arcsec in the
four visible bands, where one pixel in a hundred has more than 3.8."""
# Light that a core leaves in one row or column, in peak pixels, and how far from its middle.
_CORE_PEAKS, _CORE_REACH_LD = 8.0, 3.0
# Means over the boxes of the wing map, over single rows and columns of them.
_LANE = 2.0
_BRIGHTEST = 12


def frame_reach(instrument: Instrument, band: str, pixel: float) -> tuple[float, float]:
    """Return the half sides of the frame, x and y, in arcsec.

    Parameters
    ----------
    instrument : Instrument
    band : str
    pixel : float
        Scale, arcsec.
    """
    detector = instrument.detector_of(band)
    column, row = detector.star_column, detector.star_row
    return max(column, detector.n_columns - 1 - column) * pixel, max(row, detector.n_rows - 1 - row) * pixel


def beyond(
    metrics: PsfMetrics,
    rate_e_s: float,
    half: float,
    frame: tuple[float, float],
    sky_e_s: float,
    stars: Sequence[tuple[float, float, float]],
) -> tuple[FloatArray, float, tuple[float, float]]:
    """Return levels of pixels beyond the stamp, their largest sum over a column, the brightest in its columns and rows.

    A core holds the light of eight of its peak pixels in one column, the arm of a star beside the column some ten
    pixels of its wing.

    Parameters
    ----------
    metrics : PsfMetrics
    rate_e_s : float
        Of the central star.
    half : float
        Half side of the stamp, arcsec.
    frame : tuple of float
        Half sides of the frame, arcsec.
    sky_e_s : float
        On an open pixel.
    stars : sequence of tuple of float
        Place x and y, arcsec, and rate of the others.
    """
    step, pixel = metrics.wing_map_step_arcsec, metrics.pixel_scale_arcsec
    last = len(metrics.wing_map) // 2
    arm = np.arange(-last, last + 1) * step
    x, y = np.meshgrid(arm, arm)
    cross = np.minimum(np.abs(x), np.abs(y)) >= metrics.mask_half_width_arcsec
    outside = (np.maximum(np.abs(x), np.abs(y)) > half) & (np.abs(x) <= frame[0]) & (np.abs(y) <= frame[1])
    light = np.where(cross & outside, metrics.wing_map, 0.0) * rate_e_s
    column = float(light[:, np.abs(arm) <= half].sum(axis=0).max()) * step / pixel + sky_e_s * 2.0 * frame[1] / pixel
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
    levels = light[outside] * MOST + sky_e_s
    return np.concatenate([levels, [brightest, sky_e_s, 0.0]]), column, (in_columns, in_rows)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The frame around the stamp, for what runs along its rows and columns.

    Attributes
    ----------
    metrics : PsfMetrics
    star_e_s : float
        Rate of the star behind the mask.
    stars : tuple of (float, float, float)
        Place in arcsec and rate of every other source.
    half_arcsec : float
        Half side of the stamp.
    frame_arcsec : tuple of float
        Half sides of the frame, x and y.
    sky_e_s : float
        On an open pixel.
    """

    metrics: PsfMetrics
    star_e_s: float
    stars: tuple[tuple[float, float, float], ...]
    half_arcsec: float
    frame_arcsec: tuple[float, float]
    sky_e_s: float

    def lanes(self, places_arcsec: FloatArray, axis: Literal["x", "y"], sign: int) -> tuple[FloatArray, float]:
        """Return the light along rows or columns beyond the stamp, electrons per second and pixel.

        Parameters
        ----------
        places_arcsec : ndarray, shape (k,)
            Of the rows (``axis="x"``) or columns (``"y"``), from the star.
        axis : {"x", "y"}
            Along which they run.
        sign : {-1, 1}
            Side of the stamp.

        Returns
        -------
        light : ndarray, shape (k, m)
            At most, in boxes; nearest to the stamp first.
        pixels : float
            Length of a box.
        """
        figures, across = self.metrics, np.asarray(places_arcsec, dtype=np.float64)[:, None]
        step, edge = figures.wing_map_step_arcsec, self.frame_arcsec[axis == "y"]
        n = max(int(np.ceil((edge - self.half_arcsec) / step)), 0)
        along = np.asarray(sign * (self.half_arcsec + step * (np.arange(n) + 0.5)), float)[None, :]
        pixel, open_lane = figures.pixel_scale_arcsec, np.abs(across) > figures.mask_half_width_arcsec
        light = np.full((len(across), n), self.sky_e_s)
        if self.star_e_s > 0:
            light = light + _LANE * self.star_e_s * _pair(figures, along, across, axis) * open_lane
        reach = _CORE_REACH_LD * figures.lambda_d_arcsec
        for rank, (x, y, rate) in enumerate(sorted(self.stars, key=lambda star: -star[2])):
            here, beside = (x, y) if axis == "x" else (y, x)
            if rank < _BRIGHTEST:
                light = light + _LANE * rate * _pair(figures, along - here, across - beside, axis)
            # A row or column through a core holds much of its light; wings of the many faint stars are nothing to it.
            if across.min() - reach <= beside <= across.max() + reach:
                core = (np.abs(across - beside) <= reach) & (np.abs(along - here) <= 0.5 * step + reach)
                light = light + core * (_CORE_PEAKS * rate * figures.peak_off_axis * pixel / step)
        return light, step / pixel


def _pair(metrics: PsfMetrics, along: FloatArray, across: FloatArray, axis: str) -> FloatArray:
    return wing(metrics, along, across) if axis == "x" else wing(metrics, across, along)


# Light in a pixel or an aperture over that of the wing map at least, on it and beyond it (at most: `wings`).
_LEAST, _LEAST_BEYOND = 0.02, 0.0
_MOST_SPOTS = 12
_FAR_POINTS = 16
_NEAR_STEPS = 4.0  # of the wing map, beyond which the light of a source is even over a few pixels


@dataclass(frozen=True, eq=False)
class SourceLight:
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


@dataclass(frozen=True, eq=False)
class PlanetPlace:
    """A measured planet in its aperture; electrons per second.

    Attributes
    ----------
    name : str
    x_arcsec, y_arcsec : float
        From the centre of the mask.
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
    place : tuple of slice
        Part of the stamp under the aperture.
    weights : ndarray
        Fractions of these pixels in the aperture; empty off the stamp.
    """

    name: str
    x_arcsec: float
    y_arcsec: float
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
    place: tuple[slice, slice]
    weights: FloatArray

    @property
    def hidden(self) -> float:
        """What mask and cross hide of its core over what they leave, at most 50."""
        return min((1.0 - self.core) / max(self.core, 1e-3), 50.0)


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Light on a window; electrons per second and pixel, before the camera.

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
    surroundings : Surroundings
        The rest of the frame.
    """

    star_e_s: FloatArray
    scattered_e_s: FloatArray
    total_e_s: FloatArray
    least_e_s: FloatArray
    most_e_s: FloatArray
    outside_e_s: FloatArray
    column_e_s: float
    beyond_peaks_e_s: tuple[float, float]
    sky_e_s: float
    radius_arcsec: FloatArray
    sources: tuple[SourceLight, ...]
    planets: tuple[PlanetPlace, ...]
    aperture_pixels: float
    noise_pixels: float
    surroundings: Surroundings


def scene_light(
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
) -> SceneLight:
    """Return the light of a scene.

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
    """
    n, pixel = len(metrics.raw_contrast), metrics.pixel_scale_arcsec
    offset, half = centred_axis(n, pixel), n // 2 * pixel
    open_part = pixel_axis(offset, pixel, 1, metrics.mask_half_width_arcsec).open_fraction
    open_map = np.outer(open_part, open_part)
    radius = np.hypot(offset[:, None], offset)
    star, moved = sources[0], any(star_offset_arcsec)
    if moved:
        scattered = np.zeros((n, n))
        star_map = star.rate_e_s * spot(metrics, offset, *star_offset_arcsec) * open_map
    else:
        halo = drift_halo(metrics, radius, drift_nm, instrument.drift.psd_slope, instrument.band(band).center_nm)
        scattered = star.rate_e_s * metrics.peak_off_axis * halo * open_map
        star_map = star.rate_e_s * metrics.peak_off_axis * metrics.raw_contrast + scattered
    sky = float(sky_pixel_e_s(metrics, sky_e_s_arcsec2)) + stray_e_s
    places = [(s.x_arcsec + star_offset_arcsec[0], s.y_arcsec + star_offset_arcsec[1]) for s in sources]
    chosen = [i for i, source in enumerate(sources) if source.kind == "planet" and source.name in measured]
    apertures = [_Aperture.of(metrics, n, *places[i]) for i in chosen]
    frame = frame_reach(instrument, band, pixel)
    peaks, inside, others, others_most = _other_lights(metrics, sources[1:], places[1:], apertures, offset, open_map)
    window, lights = frame if full else (half, half), []
    for source, (x, y), peak, light in zip(sources[1:], places[1:], peaks, inside, strict=True):
        away = math.hypot(max(abs(x) - window[0], 0.0), max(abs(y) - window[1], 0.0))
        seen = max(peak, source.rate_e_s * metrics.peak_off_axis) if away == 0 and full else peak
        high, low = (MOST_BEYOND, _LEAST_BEYOND) if _off_map(metrics, x, y, half) else (MOST, _LEAST)
        lights.append(
            SourceLight(
                source.name, source.kind, float(seen), float(peak), source.rate_e_s, away, high * light, low * light
            )
        )
    rates = np.array([source.rate_e_s for source in sources])
    x_all = np.array([place[0] for place in places])

    def columns_e_s(x: float, own: int) -> float:
        """Return the light in columns of every source but the planet itself, and of the sky."""
        unmasked = np.arange(len(sources)) != own
        unmasked[0] &= moved
        light = float((rates * metrics.source_column_aperture(x - x_all))[unmasked].sum())
        light += 0.0 if moved else star.rate_e_s * float(metrics.column_aperture(x))
        return light + sky * 2.0 * frame[1] / pixel * metrics.aperture_pixels

    planets = []
    for index, (i, aperture) in enumerate(zip(chosen, apertures, strict=True)):
        (x, y), place, weights = places[i], aperture.place, aperture.weights
        core = float(metrics.core_throughput(x, y))
        elsewhere = [light for j, light in enumerate(lights) if j != i - 1]
        whole_e_s, open_pixels = sources[i].rate_e_s, metrics.aperture_pixels
        if weights.size:
            open_pixels = float((weights * open_map[place]).sum())
        in_hole = metrics.zone.contains(np.array(x), np.array(y), metrics.aperture_radius_arcsec)
        planets.append(
            PlanetPlace(
                name=sources[i].name,
                x_arcsec=x,
                y_arcsec=y,
                signal_e_s=whole_e_s * core,
                peak_e_s=min(whole_e_s * metrics.peak_off_axis, lights[i - 1].peak_e_s),
                core=min(core / metrics.core_open, 1.0) if metrics.core_open > 0 else 1.0,
                halo_e_s=aperture.light_e_s(metrics, star_map, star.rate_e_s, *places[0]),
                other_e_s=sum(float(light.least_e_s[index]) for light in elsewhere),
                other_most_e_s=sum(float(light.aperture_e_s[index]) for light in elsewhere),
                sky_e_s=sky * open_pixels,
                scattered_e_s=float((weights * scattered[place]).sum()),
                column_e_s=columns_e_s(x, i),
                inside=bool(in_hole),
                place=place,
                weights=weights,
            )
        )
    stars = [(*place, source.rate_e_s) for place, source in zip(places[1:], sources[1:], strict=True)]
    shining = (*stars, (*places[0], star.rate_e_s)) if moved else tuple(stars)
    around = Surroundings(metrics, 0.0 if moved else star.rate_e_s, shining, half, frame, sky)
    outside, columns, crossing = beyond(metrics, star.rate_e_s, half, frame, sky, stars)
    even = star_map + sky * open_map
    total = even + others
    return SceneLight(
        star_e_s=star_map,
        scattered_e_s=scattered,
        total_e_s=total,
        least_e_s=even + _LEAST * others,
        most_e_s=even + others_most,
        outside_e_s=outside if full else np.zeros(0),
        column_e_s=float(total.sum(axis=0).max()) + columns,
        beyond_peaks_e_s=(0.0, 0.0) if full else crossing,
        sky_e_s=sky,
        radius_arcsec=radius,
        sources=tuple(lights),
        planets=tuple(planets),
        aperture_pixels=metrics.aperture_pixels,
        noise_pixels=float(aperture_noise_pixels(metrics.aperture_radius_arcsec / pixel)),
        surroundings=around,
    )


class _Aperture(NamedTuple):
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
