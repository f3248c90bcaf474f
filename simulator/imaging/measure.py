"""Measurement of `PsfMetrics` from the optical model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simulator.imaging.aperture import (
    cumulative_table,
    figures_of_stamps,
    overlap_weights,
    photon_weights,
)
from simulator.imaging.floor import measure_floor
from simulator.imaging.imager import Imager, centred_axis
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.quadrature import PixelAxis, pixel_axis

__all__ = ["measure_metrics", "stamp_figures", "strehl"]

FloatArray = NDArray[np.float64]
CELLS_PER_PIXEL = 10
JITTER_NODES = 3
POINT = 1e-6  # width of a point that only jitter widens, pixels
FIELD_ARCSEC = 17.2  # the frame's diagonal and a margin: companions' wings across the whole detector
FRAME_ARCSEC = 8.75  # half side of the frame
WING_STEP_ARCSEC = 0.15


def stamp_figures(imager: Imager, on_axis: FloatArray, off_axis: FloatArray) -> dict[str, object]:
    """Figures that follow from the two stamps and the core of the PSF: milliseconds.

    Parameters
    ----------
    imager : Imager
    on_axis : ndarray
        Star behind the mask, (y, x).
    off_axis : ndarray
        Unmasked source, (y, x).
    """
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
    table, half, continuous = _core_table(imager)
    figures = figures_of_stamps(on_axis, off_axis, table, half, pixel, radius, imager.mask_half_width_arcsec)
    offset = centred_axis(len(on_axis), pixel)
    hole = imager.zone.covers(offset, offset, pixel / 2)
    return figures | {
        "core_continuous": continuous,
        "peak_on_axis_hole": float(on_axis[hole].max(initial=0.0)),
    }


def _core_table(imager: Imager) -> tuple[FloatArray, float, float]:
    """Cumulative table of PSF x aperture weight, its half side, and the energy in the ideal circle."""
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
    cells = 2 * int(np.ceil((radius / pixel + 1) * CELLS_PER_PIXEL))
    offset = (np.arange(cells) - cells / 2 + 0.5) / CELLS_PER_PIXEL  # pixels
    cell = pixel_axis(offset * pixel, pixel / CELLS_PER_PIXEL, JITTER_NODES, jitter_arcsec=imager.jitter_arcsec)
    intensity = imager.image(cell, cell) / CELLS_PER_PIXEL**2
    table = cumulative_table(intensity * photon_weights(offset, offset, radius / pixel))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    circle = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        chord = float(np.sqrt(1 - node**2))
        y, x = (_points(imager, at) for at in (radius * chord * nodes, np.array([radius * node])))
        circle += weight * chord * float(weights @ imager.image(y, x)[:, 0])
    return table, cells / 2 / CELLS_PER_PIXEL * pixel, circle * (radius / pixel) ** 2


def _wings(imager: Imager) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Azimuthal mean of the unmasked PSF in rings one pixel wide, its means over small boxes, its sums over columns."""
    pixel = imager.pixel_scale_arcsec
    half = int(np.ceil(FIELD_ARCSEC / pixel))
    pixels = np.arange(-half, half + 1)
    angles = centred_axis(2 * half + 1, pixel)
    image = imager.intensity(angles, angles)
    ring = np.rint(np.hypot(pixels[:, None], pixels)).astype(np.intp).ravel()
    totals, counts = np.bincount(ring, image.ravel()), np.bincount(ring)
    box = max(1, round(WING_STEP_ARCSEC / pixel / 2))
    arm = np.arange(0, FIELD_ARCSEC - 2 * WING_STEP_ARCSEC, WING_STEP_ARCSEC)
    centre = half + np.rint(np.concatenate([-arm[:0:-1], arm]) / pixel).astype(int)
    low, high = centre - box, centre + box + 1
    table = cumulative_table(image)
    sums = table[np.ix_(high, high)] - table[np.ix_(low, high)] - table[np.ix_(high, low)] + table[np.ix_(low, low)]
    return totals[: half + 1] / counts[: half + 1], sums / (2 * box + 1) ** 2, image.sum(axis=0)


def _register_tail(rows: FloatArray, offset_arcsec: FloatArray, intervals: Sequence[tuple[float, float]]) -> float:
    """Largest running mean that ends at an edge of the hole, whichever way the rows are read out.

    A register of capacity q passes the charge above q on to the next pixel. Nothing is left over at the edge
    exactly if every run of pixels that ends there holds at most q a pixel on average.
    """
    worst = 0.0
    for low, high in intervals:
        for run in (rows[:, offset_arcsec < low][:, ::-1], rows[:, offset_arcsec > high]):
            worst = max(worst, float((run.cumsum(axis=1) / np.arange(1, run.shape[1] + 1)).max()))
    return worst


def _source_noise_fraction(imager: Imager) -> float:
    """Mean over nine positions within a pixel of ``sum(w^2 mu) / sum(w mu)``."""
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec / imager.pixel_scale_arcsec
    half = int(np.ceil(radius + 0.5))
    axis = imager.axis(centred_axis(2 * half + 1, pixel), masked=False)
    thirds = (-1 / 3, 0.0, 1 / 3)
    fractions = []
    for dy in thirds:
        for dx in thirds:
            light = imager.image(axis, axis, source_arcsec=(dx * pixel, dy * pixel))
            weights = overlap_weights(radius, dy, dx)
            fractions.append(float((weights**2 * light).sum() / (weights * light).sum()))
    return float(np.mean(fractions))


def measure_metrics(imager: Imager, psd_slope: float, wide: Imager | None = None) -> PsfMetrics:
    """Everything but the state of the hole: stamps, wings, brightest pixel and speckle floor; some seconds.

    Parameters
    ----------
    imager : Imager
    psd_slope : float
        Of the drift screens behind the floor.
    wide : Imager, optional
        The same optics with more wavelengths, for the far wings.
    """
    masked, clear = imager.stamp_axis(masked=True), imager.stamp_axis(masked=False)
    on_axis, off_axis = imager.image(masked, masked), imager.image(clear, clear)
    half = int(np.ceil(FRAME_ARCSEC / imager.pixel_scale_arcsec))
    offset = centred_axis(2 * half + 1, imager.pixel_scale_arcsec)
    coarse = imager.axis(offset, masked=True, pixel_nodes=1)
    frame = (wide or imager).image(coarse, coarse)
    hole, (_, columns) = imager.zone.covers(offset, offset), imager.zone.intervals()
    floor = measure_floor(imager, psd_slope)
    profile, wing_map, column_profile = _wings(wide or imager)
    stamp = slice(half - len(on_axis) // 2, half + len(on_axis) // 2 + 1)
    beyond = np.concatenate([frame[: stamp.start, stamp], frame[stamp.stop :, stamp]])
    values = stamp_figures(imager, on_axis, off_axis)
    values |= {
        "band": imager.band,
        "lambda_d_arcsec": imager.lambda_d_arcsec,
        "pixel_scale_arcsec": imager.pixel_scale_arcsec,
        "aperture_radius_arcsec": imager.aperture_radius_arcsec,
        "mask_half_width_arcsec": imager.mask_half_width_arcsec,
        "hole_inner_arcsec": imager.hole_arcsec[0],
        "hole_outer_arcsec": imager.hole_arcsec[1],
        "hole_mode": imager.zone.mode,
        "hole_side": imager.zone.side,
        "hole_state": "none",
        "strehl": strehl(imager),
        "apodizer_energy": imager.apodizer_energy,
        "peak_on_axis_frame": max(float(frame.max()), float(on_axis.max())),
        "peak_on_axis_columns": float(frame[:, hole.any(axis=0)].max()),
        "register_tail": _register_tail(frame[hole.any(axis=1)], offset, columns),
        "column_light": on_axis.sum(axis=0) + beyond.sum(axis=0),
        "column_profile": column_profile,
        "source_noise_fraction": _source_noise_fraction(imager),
        "wing_profile": profile,
        "wing_map": wing_map,
        "wing_map_step_arcsec": WING_STEP_ARCSEC,
        "floor_visit_nm": floor.visit_nm,
        "floor_separation_arcsec": floor.separation_arcsec,
        "floor_sigma": floor.sigma,
    }
    return PsfMetrics.from_arrays({name: np.asarray(value) for name, value in values.items()})


def strehl(imager: Imager) -> float:
    """On-axis intensity relative to the same apodizer with a flat wavefront and no jitter, over the band."""
    point = _points(imager, np.zeros(1))
    flat = replace(imager, static=None).intensity(np.zeros(1), np.zeros(1))
    return float(imager.image(point, point)[0, 0] / flat[0, 0])


def _points(imager: Imager, angles_arcsec: FloatArray) -> PixelAxis:
    """Points of an axis that only jitter widens."""
    width = POINT * imager.pixel_scale_arcsec
    return pixel_axis(angles_arcsec, width, JITTER_NODES, jitter_arcsec=imager.jitter_arcsec)
