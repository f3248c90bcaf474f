"""The paper's shortcut for off-axis sources (``scene_model="paper"``), so that its error can be measured.

CPISM puts each source into the nearest cell of a grid of 4 x 4 cells a pixel, convolves the grid with one unmasked
off-axis PSF and bins it. The focal-plane mask is honoured for the star alone. `simulator.imaging.scene_image` is exact
and faster; nothing else in the project uses this module.

At 520 nm a source between cells is misplaced by up to 2 mas per axis (up to 5 % of its peak), and a source behind the
mask keeps all its light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.errors import InputError
from simulator.imaging.imager import Imager
from simulator.imaging.quadrature import pixel_axis
from simulator.imaging.scene_image import PointSources, checked_centres

__all__ = ["CELLS", "paper_scene_image"]

FloatArray = NDArray[np.float64]

CELLS = 4  # per pixel and axis (paper, section on imaging)
CELL_NODES = 2  # Gauss nodes per cell: the kernel is exact to 1e-6, the grid is the only error
ROWS_AT_A_TIME = 256


def paper_scene_image(
    imager: Imager,
    y_centres_arcsec: ArrayLike,
    x_centres_arcsec: ArrayLike,
    sources: PointSources,
    *,
    kernel_half_pixels: int = 128,
) -> FloatArray:
    """Image of point sources by the nearest cell of a 4 x 4 grid and one convolution, without the mask.

    Parameters
    ----------
    imager : Imager
        Optical model; the pixels are its own.
    y_centres_arcsec, x_centres_arcsec : array_like, shapes (n,) and (m,)
        Centres of the rows and columns, one pixel apart.
    sources : PointSources
        Those farther outside the window than the kernel reaches are left out.
    kernel_half_pixels : int
        Half side of the kernel; light beyond it is lost.

    Returns
    -------
    ndarray, shape (n, m)
        Light per pixel in the unit of the fluxes.

    Raises
    ------
    InputError
        If the centres are not one pixel apart, or the kernel has no size.
    """
    from scipy.signal import oaconvolve

    if kernel_half_pixels < 1:
        raise InputError("kernel_half_pixels", kernel_half_pixels, unit="px", allowed=">= 1")
    pixel = imager.pixel_scale_arcsec
    rows = _lattice("y_centres_arcsec", y_centres_arcsec, pixel)
    columns = _lattice("x_centres_arcsec", x_centres_arcsec, pixel)
    half = CELLS * kernel_half_pixels
    x, y, flux = sources.arrays
    row, column = _cell(y, rows[0], pixel) + half, _cell(x, columns[0], pixel) + half
    shape = CELLS * rows.size + 2 * half, CELLS * columns.size + 2 * half
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    grid = np.zeros(shape)
    np.add.at(grid, (row[inside].astype(np.intp), column[inside].astype(np.intp)), flux[inside])
    fine = oaconvolve(grid, _cell_kernel(imager, half), mode="valid")
    image: FloatArray = fine.reshape(rows.size, CELLS, columns.size, CELLS).sum(axis=(1, 3))
    return np.maximum(image, 0.0)


def _cell_kernel(imager: Imager, half: int) -> FloatArray:
    """Light in every cell for a source on the central one, without the mask."""
    cell = imager.pixel_scale_arcsec / CELLS
    centres = np.arange(-half, half + 1, dtype=np.float64) * cell
    columns = pixel_axis(centres, cell, CELL_NODES, 0.0, imager.jitter_arcsec)
    kernel = np.empty((centres.size, centres.size))
    for start in range(0, centres.size, ROWS_AT_A_TIME):
        part = slice(start, start + ROWS_AT_A_TIME)
        kernel[part] = imager.image(pixel_axis(centres[part], cell, CELL_NODES, 0.0, imager.jitter_arcsec), columns)
    kernel /= CELLS**2  # the imager gives light per detector pixel
    return kernel


def _cell(positions: FloatArray, first_centre: float, pixel: float) -> FloatArray:
    """Index of the cell that holds each position, cell 0 being the first of the first pixel."""
    return np.floor((positions - (first_centre - pixel / 2.0)) * (CELLS / pixel))


def _lattice(name: str, values: ArrayLike, pixel: float) -> FloatArray:
    centres = checked_centres(name, values)
    if np.abs(np.diff(centres) - pixel).max(initial=0.0) > 1e-6 * pixel:
        raise InputError(name, "centres", allowed=f"one pixel of {pixel} arcsec apart")
    return centres
