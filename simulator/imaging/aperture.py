"""Circular apertures on a pixelated detector: aperture sums and the core table.

Aperture photometry sums pixels with the fraction of their area that lies in the circle. Averaged over the
position of the circle within a pixel, a photon at distance s from its centre then counts with weight
``disc * triangle(s)``: the disc convolved with the autocorrelation of a pixel.
"""

import math
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray, overlap_weights
from simulator.imaging.zones import BandGeometry

STRIPS = 256
CELLS_PER_PIXEL = 10


def aperture_sums(image: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sum of the image under the weights centred on every pixel; nothing beyond the edges.

    Parameters
    ----------
    image : ndarray, shape (..., n_y, n_x)
    weights : ndarray, shape (m, m), m odd

    Returns
    -------
    ndarray, shape (..., n_y, n_x)
    """
    half = len(weights) // 2
    n_y, n_x = image.shape[-2:]
    padded = np.zeros((*image.shape[:-2], n_y + 2 * half, n_x + 2 * half))
    padded[..., half : half + n_y, half : half + n_x] = image
    total = np.zeros(image.shape)
    for row, column in np.argwhere(weights > 0):
        total += weights[row, column] * padded[..., row : row + n_y, column : column + n_x]
    return total


def _triangle_cumulative(t: FloatArray) -> FloatArray:
    """Return the integral of the unit triangle 1 - |t| from -1 to t."""
    t = np.clip(t, -1.0, 1.0)
    return np.where(t < 0, 0.5 * (1 + t) ** 2, 1 - 0.5 * (1 - t) ** 2)


def photon_weights(y_pixels: FloatArray, x_pixels: FloatArray, radius_pixels: float) -> FloatArray:
    """Return the phase-averaged weight of a photon (y, x) from the aperture centre: disc convolved with triangle.

    Parameters
    ----------
    y_pixels : ndarray
        Row offsets from the centre, pixels.
    x_pixels : ndarray
        Column offsets from the centre, pixels.
    radius_pixels : float
        Radius of the aperture, pixels.
    """
    t = (np.arange(STRIPS) + 0.5) / STRIPS * 2 - 1
    chord = np.sqrt(np.clip(radius_pixels**2 - (x_pixels[:, None] - t) ** 2, 0.0, None))
    y = y_pixels[:, None, None]
    spread = _triangle_cumulative(y + chord) - _triangle_cumulative(y - chord)
    weights: FloatArray = spread @ (1 - np.abs(t)) * (2 / STRIPS)
    return weights


def cumulative_table(cells: FloatArray) -> FloatArray:
    """Return the sums of all cells below and left of every cell corner; one larger than ``cells`` per axis."""
    table = np.zeros((cells.shape[0] + 1, cells.shape[1] + 1))
    table[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return table


def core_from_table(
    table: FloatArray, half_side_arcsec: float, bar_arcsec: float, x_arcsec: ArrayLike, y_arcsec: ArrayLike
) -> FloatArray:
    """Return the energy in the aperture centred at (x, y) that the cross mask lets through.

    The mask opens four corners; the energy in each follows from the cumulative table of the aperture-weighted
    point-spread function by bilinear interpolation.

    Parameters
    ----------
    table : ndarray, shape (k, k)
        `cumulative_table` over offsets -half_side to half_side, ``[y, x]``.
    half_side_arcsec : float
        Half side of the table.
    bar_arcsec : float
        Half width of each bar of the cross.
    x_arcsec, y_arcsec : array_like
        Positions relative to the star.
    """
    x, y = np.broadcast_arrays(np.asarray(x_arcsec, dtype=np.float64), np.asarray(y_arcsec, dtype=np.float64))
    size = len(table)
    scale, last = (size - 1) / (2 * half_side_arcsec), size - 1
    right, top, cells = table[:, last], table[last], table.ravel()

    def at(offset: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the cell of an offset, and how far into it."""
        place = np.clip((offset + half_side_arcsec) * scale, 0.0, last)
        cell = np.minimum(place.astype(np.int64), last - 1)
        return cell, place - cell

    def along(edge: FloatArray, place: tuple[IntArray, FloatArray]) -> FloatArray:
        """Return the sums up to an edge of the table."""
        i, p = place
        sums: FloatArray = edge[i] * (1 - p) + edge[i + 1] * p
        return sums

    def below(row: tuple[IntArray, FloatArray], column: tuple[IntArray, FloatArray]) -> FloatArray:
        (i, p), (j, q) = row, column
        corner = i * size + j
        lower = cells[corner] * (1 - q) + cells[corner + 1] * q
        upper = cells[corner + size] * (1 - q) + cells[corner + size + 1] * q
        sums: FloatArray = lower * (1 - p) + upper * p
        return sums

    x_low, x_high = at(-bar_arcsec - x), at(bar_arcsec - x)
    y_low, y_high = at(-bar_arcsec - y), at(bar_arcsec - y)

    def open_columns(row: tuple[IntArray, FloatArray]) -> FloatArray:
        return along(right, row) - below(row, x_high) + below(row, x_low)

    every_row = table[last, last] - along(top, x_high) + along(top, x_low)
    core: FloatArray = np.maximum(every_row - open_columns(y_high) + open_columns(y_low), 0.0)
    return core


def core_cells(pixel_arcsec: float, radius_arcsec: float) -> tuple[FloatArray, float]:
    """Return the offsets of the cells in which the core is summed, pixels, and the side of a cell, arcsec.

    Parameters
    ----------
    pixel_arcsec, radius_arcsec : float
        Side of a pixel and radius of the aperture, arcsec.
    """
    cells = 2 * math.ceil((radius_arcsec / pixel_arcsec + 1) * CELLS_PER_PIXEL)
    return (np.arange(cells) - cells / 2 + 0.5) / CELLS_PER_PIXEL, pixel_arcsec / CELLS_PER_PIXEL


def figures_of_stamps(
    on_axis: FloatArray, off_axis: FloatArray, core: FloatArray, geometry: BandGeometry, diagonal: tuple[int, int]
) -> dict[str, Any]:
    """Return the figures of `simulator.imaging.metrics.StampMetrics` that two stamps and the core give.

    Parameters
    ----------
    on_axis, off_axis : ndarray
        Star behind the mask and unmasked source, shape (n, n): fraction of the energy on the clear disc in each pixel.
    core : ndarray, shape (k, k)
        Unmasked source, energy per area of a pixel, in each of the `core_cells`.
    geometry : BandGeometry
        Pixel, aperture and mask of the band.
    diagonal : tuple of int
        Signs (x, y) of the diagonal along which the inner working angle is measured.

    Returns
    -------
    dict
        By name of the field.
    """
    pixel, radius, bar = geometry.pixel_scale_arcsec, geometry.aperture_radius_arcsec, geometry.mask_half_width_arcsec
    cells, _ = core_cells(pixel, radius)
    table = cumulative_table(core / CELLS_PER_PIXEL**2 * photon_weights(cells, cells, radius / pixel))
    half = cells.size / 2 / CELLS_PER_PIXEL * pixel
    far = 10.0 * (half + bar)
    core_open = float(core_from_table(table, half, bar, far, far))
    offset = np.arange(0.0, bar + 2 * half, pixel / 50)
    x, y = (sign * offset for sign in diagonal)
    curve = core_from_table(table, half, bar, x, y)
    half_way = float(np.interp(0.5 * core_open, curve, offset)) if curve[0] < 0.5 * core_open else 0.0
    peak = float(off_axis.max())
    return {
        "core_open": core_open,
        "peak_off_axis": peak,
        "iwa_arcsec": math.sqrt(2.0) * half_way,
        "raw_contrast": on_axis / peak,
        "halo_map": aperture_sums(on_axis, overlap_weights(radius / pixel)),
        "core_table": table,
        "core_table_half_arcsec": half,
    }
