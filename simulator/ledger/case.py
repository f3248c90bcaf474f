"""The inputs of the sizes of camera effects: light on the pixels of a window, planets, their noise, hits by particles.

Light is from tables alone, good enough to tell what an effect of it may cost: the star behind the mask is its own image
at the standard settings; a source off the axis is the azimuthal mean of the unmasked point-spread function, or its wing
map where that is brighter: the frame around the stamp, and lines across it. Nothing is propagated.

A pixel above its full well passes the excess on along its column, the register above its own along the row, to what is
read next. Nothing arrives at a place exactly if every run of pixels that ends there holds less than its wells do: the
light of a run is compared with them, five sigma of noise included, however far away it begins.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray, Outcome, Reason, Status, compute_once, stream
from simulator.camera import FrameNoise, load_calibration_set
from simulator.config import AnyDetector, CosmicRayConfig, Instrument, content_hash
from simulator.detectors import INFRARED, VISIBLE, aperture_noise_pixels, in_sums
from simulator.effects import draw_cosmic_rays
from simulator.imaging import PsfMetrics, centred_axis, overlap_weights, pixel_axis
from simulator.signal import drift_halo, overflow, pixel_saturated, sky_pixel_e_s, spot, wing

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from simulator.target import Source

_FLOW_SIGMA = 5.0


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
        if top + _FLOW_SIGMA * math.sqrt(top) <= self._pixel:
            self._pixel = np.inf
        if top + _FLOW_SIGMA * math.sqrt(factor2 * top) <= self._register:
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
        return top + _FLOW_SIGMA * math.sqrt(factor2 * top) > well_e

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
    return np.asarray((passed + _FLOW_SIGMA * share * np.sqrt(factor2 * np.cumsum(charge, axis=1)) > 0).any(axis=1))


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


# Radius of the Gaussian that stands for the core of a planet, lambda/D.
_CORE_SIGMA = 0.66
_SPILLED = 1e-6  # of the noise of a pixel, from which on what it passes on counts
# Speckles of a drifting wavefront scatter by this much more than their two parts would alone, and the largest of a
# stamp by so many times that.
_SPECKLE_SCATTER, _SPECKLE_MOST = 1.4, 3.5


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


@dataclass(frozen=True, eq=False)
class CameraCase:
    """The inputs that the sizes are worked out for.

    Attributes
    ----------
    detector : Detector or InfraredDetector
    light : SceneLight
    noise : FrameNoise
    exposure_s : float
    n_frames : int
    em_gain : float
    reduced : bool
        Whether flat, bias structure and flaws are calibrated out and particles rejected.
    first_pixel : tuple of int or None
        Of the stamp on the frame.
    full : bool
        Whether the frame around the stamp is read too.
    hits_per_s : float
        Tracks a second and pixel.
    hits : PixelHits
    lost_per_s : float
        Rate of tracks that touch an aperture.
    variances : tuple of dict
        Of every measured planet, by origin (`simulator.ledger.visit.visit_variance_e2`), with the least light of other
        sources.
    column_peak_e_s : float
        Brightest pixel in the columns of the hole or of a source on the frame.
    radius_pixels, lambda_d_pixels : float
        Of the aperture; lambda/D.
    edge_arcsec : float
        Separation from an axis below which an aperture meets the mask.
    visits : int
        Of the programme. What averages over visits is weighed as in one of them; what all have in common stands in
        ``variances`` times their number (``common``), so that the rest counts the less the more of them there are.
    """

    detector: Any
    light: SceneLight
    noise: FrameNoise
    exposure_s: float
    n_frames: int
    em_gain: float
    reduced: bool
    first_pixel: tuple[int, int]
    full: bool
    hits_per_s: float
    hits: PixelHits
    lost_per_s: float
    variances: tuple[dict[str, float], ...]
    column_peak_e_s: float
    radius_pixels: float
    lambda_d_pixels: float
    pixel_arcsec: float
    edge_arcsec: float
    visits: int = 1

    @functools.cached_property
    def charge_e(self) -> FloatArray:
        """Electrons of light, and of hot pixels and bad columns, on the stamp in a frame."""
        return self._charged(self.light.total_e_s)

    @functools.cached_property
    def light_e(self) -> FloatArray:
        """The same of every level of light, the stamp first."""
        return np.concatenate([self.charge_e.ravel(), self.light.outside_e_s * self.exposure_s])

    @property
    def counted_e(self) -> FloatArray:
        """Of light and dark current, the electrons that are drawn as counts."""
        return (self.light_e + self.noise.dark_e) * self.noise.photons

    def struck(self) -> float:
        """Return the size of the charge of particles on the variance of a pixel."""
        hits = self.hits_per_s * self.exposure_s * self.hits.square_e2
        return self.variance_change(self.noise.factor2 * hits, inside=False)

    @functools.cached_property
    def most_e(self) -> FloatArray:
        """The same with the light of other sources and of speckles at most."""
        speckles = largest_speckles(self.light.star_e_s, self.light.scattered_e_s)
        stamp = self._charged(self.light.most_e_s + speckles)
        return np.concatenate([stamp.ravel(), self.light.outside_e_s * self.exposure_s])

    def _charged(self, light_e_s: FloatArray) -> FloatArray:
        charge, switches = light_e_s * self.exposure_s, self.detector.switches
        for key in ("bad_pixels", "bad_columns"):
            if getattr(switches, key, False):
                flaw = self.flaws[key]
                charge = np.where(flaw.response > 0, 0.0, charge) + flaw.dark_e_s * (self.exposure_s * switches.dark)
        return charge

    @functools.cached_property
    def spill(self) -> Spill:
        """Where charge beyond the limits flows."""
        return Spill(self)

    def overflow(self, mean_e: FloatArray | float, well_e: float, factor2: float) -> FloatArray:
        """Return what a limit cuts off; see `overflow`."""
        return overflow(mean_e, well_e, factor2)

    def behind_e_s(self, planet: PlanetPlace) -> float:
        """Return the light of others on a pixel of the aperture of a planet, at most, e-/s."""
        return (planet.halo_e_s + planet.other_most_e_s + planet.sky_e_s) / self.light.aperture_pixels

    def spilled_on(
        self, planet: PlanetPlace, well_e: float, factor2: float, flows_into: Callable[[slice, slice], object]
    ) -> float:
        """Return whether charge beyond a limit may reach a planet: 1, or what of its own is cut off.

        Parameters
        ----------
        planet : PlanetPlace
        well_e : float
            The limit, e- at the register input.
        factor2 : float
            Squared excess noise factor of what it cuts off.
        flows_into : callable
            Whether charge of others flows into rows and columns of the stamp.
        """
        if not planet.weights.size:  # off the stamp: from the brightest pixel of all
            return float(overflow(self.column_peak_e_s * self.exposure_s, well_e, factor2) > 1e-9)
        level = (self.behind_e_s(planet) + planet.peak_e_s) * self.exposure_s
        return max(float(bool(flows_into(*planet.place))), float(overflow(level, well_e, factor2)))

    @property
    def largest_stripe_adu(self) -> float:
        """Largest stripe of the bias in what is read."""
        return float(stamp_flaws(self.detector, self.first_pixel, len(self.light.total_e_s))[1][1 if self.full else 0])

    @property
    def flaws(self) -> dict[str, Flaw]:
        """Flaws of the calibration set on the stamp."""
        return stamp_flaws(self.detector, self.first_pixel, len(self.light.total_e_s))[0]

    @functools.cached_property
    def sigma_e(self) -> FloatArray:
        """Standard deviation of these pixels, with the light that is certain."""
        least = self._charged(self.light.least_e_s).ravel()
        light = np.concatenate([least, self.light.outside_e_s * self.exposure_s])
        return np.sqrt(np.maximum(self.noise.variance_e2(light), 1e-30))

    @functools.cached_property
    def spills(self) -> tuple[bool, bool]:
        """Whether pixels overflow into their column, and the register into its row."""
        peak = float(self.most_e.max(initial=0.0)) + self.noise.dark_e
        register = self.detector.trailing_e / self.em_gain
        bloom = bool(overflow(peak, self.detector.blooming_e, 1.0) > _SPILLED)
        return bloom, bool(overflow(peak, register, self.noise.factor2) > _SPILLED)

    def mean_change(self, change_e: FloatArray | float) -> float:
        """Return the largest change of mean and standard deviation in a pixel whose mean changes so.

        Where charge spills, the last pixel that it reaches sees the changes of a whole column or row.
        """
        change = np.abs(np.broadcast_to(np.asarray(change_e, dtype=np.float64), self.sigma_e.shape))
        spread = 0.5 * self.noise.factor2 * self.noise.photons / self.sigma_e
        worst = float(np.max(change / self.sigma_e * np.maximum(1.0, spread), initial=0.0))
        if any(self.spills):
            side = len(self.charge_e)
            stamp = change[: side * side].reshape(side, side)
            sums = [float(stamp.sum(axis=axis).max()) for axis in (0, 1) if self.spills[axis]]
            more = (max(self.detector.n_rows, self.detector.n_columns) - side) * self.full
            beyond = float(change[side * side :].mean()) * more if more else 0.0
            rounded = float(change.max(initial=0.0) > 0)  # of whole electrons a half goes each way
            worst = max(worst, (max(sums) + beyond + rounded) / float(self.sigma_e.min()))
        return worst

    def variance_change(self, variance_e2: FloatArray | float, *, inside: bool = True) -> float:
        """Return the largest share of a pixel's variance, halved; ``inside`` where it is part of the noise already."""
        part = np.broadcast_to(np.asarray(variance_e2, dtype=np.float64), self.sigma_e.shape)
        whole = self.sigma_e**2 if inside else self.sigma_e**2 + part
        return 0.5 * min(float(np.max(part / whole, initial=0.0)), 1.0)

    def light_variance_e2(self, aperture_e_s: float) -> float:
        """Return the variance over the visit of an aperture sum of even light."""
        noise, fraction = self.noise, self.light.noise_pixels / self.light.aperture_pixels
        return self.n_frames * noise.factor2 * noise.photons * self.exposure_s * fraction * aperture_e_s

    def snr_share(self, *origins: str, factor: float = 1.0) -> float:
        """Return half of the share of some origins in the variance of an aperture sum, the largest of all planets.

        Light of other sources counts as much as it may be; what adds no variance is no origin.
        """
        most = 0.0
        for variances, planet in zip(self.variances, self.light.planets, strict=True):
            other = self.light_variance_e2(planet.other_most_e_s)
            more = other - variances["other"] if "other" in origins else 0.0
            part = sum(variances.get(name, 0.0) for name in origins) + more
            most = max(most, 0.5 * factor * part / max(sum(variances.values()) + more, 1e-300))
        return most

    def snr_added(self, variance_e2: Iterable[float]) -> float:
        """Return the same of a variance that is not among the origins, one a planet."""
        totals = (max(sum(variances.values()), 1e-300) for variances in self.variances)
        return max((0.5 * part / total for part, total in zip(variance_e2, totals, strict=True)), default=0.0)

    def over_planets(self, size: Callable[[PlanetPlace], float]) -> float:
        """Return the largest of all planets."""
        return max((size(planet) for planet in self.light.planets), default=0.0)

    @functools.cached_property
    def cores(self) -> tuple[tuple[tuple[slice, slice], FloatArray], ...]:
        """Part of the stamp under the core of each planet, inside its aperture, and the weights there."""
        n, reach, found = len(self.light.total_e_s), math.ceil(self.radius_pixels + 1.0), []
        for planet in self.light.planets:
            spans, offsets = [], []
            for place in (planet.y_arcsec, planet.x_arcsec):
                middle = n // 2 + place / self.pixel_arcsec
                low, high = max(math.floor(middle) - reach, 0), min(math.ceil(middle) + reach + 1, n)
                spans.append(slice(low, max(high, low)))
                offsets.append(np.arange(low, max(high, low)) - middle)
            distance = np.hypot(offsets[0][:, None], offsets[1])
            weight = np.exp(-0.5 * (distance / (_CORE_SIGMA * self.lambda_d_pixels)) ** 2)
            weight *= distance <= self.radius_pixels + 0.5
            found.append(((spans[0], spans[1]), weight / max(float(weight.sum()), 1e-300)))
        return tuple(found)


def largest_speckles(light: FloatArray, scattered: FloatArray) -> FloatArray:
    """Return the largest change of pixels by a wavefront error: ``|dE|^2`` and its beat with the light that is there.

    Parameters
    ----------
    light : ndarray
        That is there without the error.
    scattered : ndarray
        Mean light that the error scatters, in the same units.
    """
    return _SPECKLE_MOST * _SPECKLE_SCATTER * np.sqrt(2.0 * light * scattered + scattered**2)


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


# What a reduction takes out (flaws, bias, particles) or what moves charge between pixels: sums of frames leave it out.
NOT_IN_SUMS = tuple(dict.fromkeys(in_sums((*VISIBLE, *INFRARED), "left_out", "moves_charge", "not_additive")))
_SIGMA = 8.0


def sums_possible(case: CameraCase, metrics: PsfMetrics, star_e_s: float, *, moved: bool) -> Outcome[float]:
    """Return whether frames add up over the dark hole: no pixel in it reaches a limit, and none overflows into it.

    The image that is made decides it pixel by pixel (`simulator.observing.hole_stack.hole_stackable`); this is the same
    from tables of the light.
    """
    if moved:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, "the star stands off the mask")
    detector, t, gain = case.detector, case.exposure_s, case.em_gain
    light = star_e_s * metrics.peak_on_axis_hole + case.light.sky_e_s
    light += max((source.stamp_peak_e_s for source in case.light.sources), default=0.0)
    inside = pixel_saturated(light * t + case.noise.dark_e + case.noise.clock_e, gain, detector, _SIGMA)
    if inside.status is not Status.OK:
        return inside
    rows, columns = (_runs(np.asarray(metrics.hole.any(axis=axis))) for axis in (1, 0))
    places = list(itertools.product(rows, columns))
    if any(case.spill.blooms_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns may enter the hole")
    if any(case.spill.trails_into(*place) for place in places):
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register may enter the hole")
    return inside


def _runs(inside: BoolArray) -> list[slice]:
    """Return the intervals of pixels that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [slice(int(low), int(high)) for low, high in zip(edges[::2], edges[1::2], strict=True)]
