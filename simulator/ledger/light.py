"""Light of a scene on the pixels of a window, from tables alone: good enough to tell what an effect of it may cost.

The star behind the mask is its own image at the standard settings; a source off the axis is the azimuthal mean of the
unmasked point-spread function, or its wing map where that is brighter. Nothing is propagated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.config import Instrument
from simulator.imaging.aperture import overlap_weights
from simulator.imaging.imager import centred_axis
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.quadrature import pixel_axis
from simulator.ledger.wings import MOST, MOST_BEYOND, FarLights, Surroundings, beyond, frame_reach
from simulator.signal.light import sky_pixel_e_s
from simulator.signal.variance import aperture_noise_pixels
from simulator.signal.wings import spot, wing
from simulator.target.sources import Source

FloatArray = NDArray[np.float64]
# Mean light of a wavefront error of 1 nm rms at 662 nm that falls as f^-2.5, relative to the peak, times u^2.5 with u
# in lambda/D: at most 1.7 times too large in the dark holes of the visible bands (60 screens each).
_DRIFT_AT_1_NM = 2.4e-5
# Light in a pixel or an aperture over that of the wing map at least, on it and beyond it (at most: `wings`).
_LEAST, _LEAST_BEYOND = 0.02, 0.0
_MOST_SPOTS = 12
_NEAR_STEPS = 4.0  # of the wing map, beyond which the light of a source is even over a few pixels


@dataclass(frozen=True, eq=False)
class SourceLight:
    """What a source other than the central star leaves on the window.

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
class Sketch:
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


def drift_halo(
    metrics: PsfMetrics, separation_arcsec: FloatArray, rms_nm: float, slope: float, wavelength_nm: float
) -> FloatArray:
    """Mean light that a wavefront error scatters, relative to the peak of a source; at most 1.

    ``2.4e-5 (rms / nm)^2 (662 nm / lambda)^2 u^-slope`` with u the separation in lambda/D, at least 1: the power
    spectrum of the screens seen through the telescope, its scale measured in the dark holes of the visible bands.
    """
    u = np.maximum(separation_arcsec / metrics.lambda_d_arcsec, 1.0)
    return np.minimum(_DRIFT_AT_1_NM * (rms_nm * 662.0 / wavelength_nm) ** 2 * u**-slope, 1.0)


def sketch_of(
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
) -> Sketch:
    """Light of a scene.

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
    offset = centred_axis(n, pixel)
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
    apertures = {i: _aperture(metrics, n, *places[i]) for i in chosen}
    frame, half = frame_reach(instrument, band, pixel), n // 2 * pixel
    window = frame if full else (half, half)
    lights, total, least, most = [], *[star_map + sky * open_map] * 3
    brightest = sorted(range(1, len(sources)), key=lambda i: -sources[i].rate_e_s)[:_MOST_SPOTS]
    close = half + _NEAR_STEPS * metrics.wing_map_step_arcsec
    near = {i for i in brightest if max(map(abs, places[i])) <= close}
    far = [i for i in range(1, len(sources)) if i not in near]
    x_far, y_far = np.array([places[i] for i in far]).reshape(-1, 2).T
    outer = FarLights.of(metrics, np.array([sources[i].rate_e_s for i in far]), x_far, y_far, half, open_map)
    total, least, most = (
        part + factor * outer.total_e_s for part, factor in ((total, 1.0), (least, _LEAST), (most, MOST))
    )
    far_inside = {
        j: outer.sums_e_s(place, weights)
        if weights.size
        else np.array([sources[i].rate_e_s for i in far])
        * wing(metrics, places[j][0] - x_far, places[j][1] - y_far)
        * metrics.aperture_pixels
        for j, (place, weights) in apertures.items()
    }
    row_of = {i: row for row, i in enumerate(far)}
    for i, source in enumerate(sources[1:], start=1):
        x, y = places[i]
        away = math.hypot(max(abs(x) - window[0], 0.0), max(abs(y) - window[1], 0.0))
        if i in near:
            light = source.rate_e_s * spot(metrics, offset, x, y) * open_map
            beside = np.hypot(offset - x, (offset - y)[:, None]) > 2.0 * metrics.wing_map_step_arcsec
            peak = max(float(light.max()), MOST * float(light[beside].max(initial=0.0)))
            total, least = total + light, least + _LEAST * light
            most = most + np.minimum(MOST * light, source.rate_e_s * metrics.peak_off_axis * open_map)
            inside = np.array(
                [
                    float((weights * light[place]).sum())
                    if weights.size
                    else source.rate_e_s
                    * float(wing(metrics, places[j][0] - x, places[j][1] - y))
                    * metrics.aperture_pixels
                    for j, (place, weights) in apertures.items()
                ]
            )
        else:
            peak = float(outer.peak_e_s[row_of[i]])
            inside = np.array([sums[row_of[i]] for sums in far_inside.values()])
        stamp_peak = peak
        if away == 0 and full:
            peak = max(peak, source.rate_e_s * metrics.peak_off_axis)
        off_map = max(abs(x), abs(y)) - half > len(metrics.wing_map) // 2 * metrics.wing_map_step_arcsec
        high, low = (MOST_BEYOND, _LEAST_BEYOND) if off_map else (MOST, _LEAST)
        lights.append(
            SourceLight(source.name, source.kind, peak, stamp_peak, source.rate_e_s, away, high * inside, low * inside)
        )
    rates, x_all = (np.array(values) for values in ([s.rate_e_s for s in sources], [place[0] for place in places]))

    def columns_e_s(x: float, own: int) -> float:
        """Of every source but the planet itself, and the sky."""
        unmasked = np.arange(len(sources)) != own
        unmasked[0] &= moved
        light = float((rates * metrics.source_column_aperture(x - x_all))[unmasked].sum())
        light += 0.0 if moved else star.rate_e_s * float(metrics.column_aperture(x))
        return light + sky * 2.0 * frame[1] / pixel * metrics.aperture_pixels

    planets = []
    for index, i in enumerate(chosen):
        (x, y), (place, weights) = places[i], apertures[i]
        core = float(metrics.core_throughput(x, y))
        own = i - 1
        behind = star.rate_e_s * float(wing(metrics, x - places[0][0], y - places[0][1])) * metrics.aperture_pixels
        planets.append(
            PlanetPlace(
                name=sources[i].name,
                x_arcsec=x,
                y_arcsec=y,
                signal_e_s=sources[i].rate_e_s * core,
                peak_e_s=min(sources[i].rate_e_s * metrics.peak_off_axis, lights[own].peak_e_s),
                core=min(core / metrics.core_open, 1.0) if metrics.core_open > 0 else 1.0,
                halo_e_s=float((weights * star_map[place]).sum()) if weights.size else behind,
                other_e_s=sum(float(light.least_e_s[index]) for j, light in enumerate(lights) if j != own),
                other_most_e_s=sum(float(light.aperture_e_s[index]) for j, light in enumerate(lights) if j != own),
                sky_e_s=sky * (float((weights * open_map[place]).sum()) if weights.size else metrics.aperture_pixels),
                scattered_e_s=float((weights * scattered[place]).sum()),
                column_e_s=columns_e_s(x, i),
                inside=bool(metrics.zone.covers(np.array([y]), np.array([x]), -metrics.aperture_radius_arcsec)[0, 0]),
                place=place,
                weights=weights,
            )
        )
    stars = [(*place, source.rate_e_s) for place, source in zip(places[1:], sources[1:], strict=True)]
    around = Surroundings(
        metrics=metrics,
        star_e_s=0.0 if moved else star.rate_e_s,
        stars=tuple(stars) + (((*places[0], star.rate_e_s),) if moved else ()),
        half_arcsec=half,
        frame_arcsec=frame,
        sky_e_s=sky,
    )
    outside, columns, crossing = beyond(metrics, star.rate_e_s, half, frame, sky, stars)
    return Sketch(
        star_e_s=star_map,
        scattered_e_s=scattered,
        total_e_s=total,
        least_e_s=least,
        most_e_s=most,
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


def _aperture(metrics: PsfMetrics, n: int, x: float, y: float) -> tuple[tuple[slice, slice], FloatArray]:
    """Part of the stamp under an aperture and the weights there; nothing where it reaches beyond the stamp."""
    column, row = (part / metrics.pixel_scale_arcsec + n // 2 for part in (x, y))
    middle = round(row), round(column)
    radius = metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec
    half = math.ceil(radius + 0.5)
    if min(middle) < half or max(middle) >= n - half:
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0))
    weights = overlap_weights(radius, row - middle[0], column - middle[1])
    return (slice(middle[0] - half, middle[0] + half + 1), slice(middle[1] - half, middle[1] + half + 1)), weights
