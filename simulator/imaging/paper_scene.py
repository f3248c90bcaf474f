"""The paper's shortcut for off-axis sources (``scene_model="paper"``), so that its error can be measured.

CPISM puts each source into the nearest cell of a grid of 4 x 4 cells a pixel, convolves the grid with one unmasked
off-axis PSF and bins it. The same sum is taken here source by source: one kernel for each of the 16 cells of a pixel,
binned once and laid down on the pixels. The focal-plane mask is honoured for the star alone.
`simulator.imaging.scene_image` is exact; nothing else in the project uses this module.

At 520 nm a source between cells is misplaced by up to 2 mas per axis (up to 5 % of its peak), and a source behind the
mask keeps all its light.
"""

import functools

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError
from simulator.imaging.imager import Imager, Optics
from simulator.imaging.sampling import pixel_axis
from simulator.imaging.scene_image import PointSources, checked_centres

CELLS = 4  # per pixel and axis (paper, section on imaging)
CELL_NODES = 2  # Gauss nodes per cell: the kernel is exact to 1e-6, the grid is the only error
ROWS_AT_A_TIME = 64  # on either side of the axis
N_KEPT = 2  # optics whose kernels are kept, 8 MB each


def paper_scene_image(
    imager: Imager, y_arcsec: ArrayLike, x_arcsec: ArrayLike, sources: PointSources, *, kernel_half_pixels: int = 128
) -> FloatArray:
    """Return the image of point sources by the nearest cell of a 4 x 4 grid and one convolution, without the mask.

    Parameters
    ----------
    imager : Imager
        Optical model; the pixels are its own.
    y_arcsec, x_arcsec : array_like, shapes (n,) and (m,)
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
    if kernel_half_pixels < 1:
        raise InputError("kernel_half_pixels", kernel_half_pixels, unit="px", allowed=">= 1")
    pixel, reach = imager.pixel_scale_arcsec, kernel_half_pixels
    rows = _lattice("y_centres_arcsec", y_arcsec, pixel)
    columns = _lattice("x_centres_arcsec", x_arcsec, pixel)
    image = np.zeros((rows.size, columns.size))
    places = [_cell(part, axis[0], pixel) for part, axis in zip(sources.arrays[1::-1], (rows, columns), strict=True)]
    inside = np.ones(places[0].shape, dtype=np.bool_)
    for cell, n_pixels in zip(places, image.shape, strict=True):
        inside &= (cell >= -CELLS * reach) & (cell < CELLS * (n_pixels + reach))
    if not inside.any():
        return image
    kernels = _binned_kernels(Optics.of(imager), reach)
    cells = np.stack([cell[inside] for cell in places], axis=1).astype(np.intp)
    for (row, column), flux in zip(cells, sources.arrays[2][inside], strict=True):
        spans = [_overlap(int(cell) // CELLS, reach, n) for cell, n in zip((row, column), image.shape, strict=True)]
        kernel = kernels[row % CELLS, column % CELLS]
        image[spans[0][0], spans[1][0]] += flux * kernel[spans[0][1], spans[1][1]]
    return image


def _overlap(pixel: int, reach: int, n_pixels: int) -> tuple[slice, slice]:
    """Return the pixels of a window that a kernel around a pixel reaches, and the kernel's part that falls on them."""
    low, high = max(pixel - reach, 0), min(pixel + reach + 1, n_pixels)
    return slice(low, high), slice(low - pixel + reach, high - pixel + reach)


@functools.lru_cache(maxsize=N_KEPT)
def _binned_kernels(optics: Optics, reach: int) -> FloatArray:
    """Return the light in every pixel for a source on each cell of the middle one, without the mask.

    Returns
    -------
    ndarray, shape (4, 4, 2 reach + 1, 2 reach + 1)
        By row and column of the cell.
    """
    imager, half, side = optics.imager, CELLS * reach, 2 * reach + 1
    cell = imager.pixel_scale_arcsec / CELLS
    place = np.arange(-half, half + 1)
    centres: FloatArray = place.astype(np.float64) * cell
    columns = pixel_axis(centres, cell, CELL_NODES, 0.0, imager.jitter_arcsec)
    starts = np.arange(0, CELLS * side, CELLS)
    kernels = np.zeros((CELLS, CELLS, side, side))
    for start in range(0, half + 1, ROWS_AT_A_TIME):
        # Rows above and below the axis together: where nodes are symmetric, half of the work is enough.
        part = np.flatnonzero((np.abs(place) >= start) & (np.abs(place) < start + ROWS_AT_A_TIME))
        light = imager.image(pixel_axis(centres[part], cell, CELL_NODES, 0.0, imager.jitter_arcsec), columns)
        for right in range(CELLS):
            shifted = np.pad(light, ((0, 0), (right, CELLS - 1 - right)))
            binned = np.add.reduceat(shifted, starts, axis=1)
            for up in range(CELLS):
                np.add.at(kernels[up, right], (part + up) // CELLS, binned)
    kernels /= CELLS**2  # the imager gives light per detector pixel
    kernels.flags.writeable = False
    return kernels


def _cell(positions: FloatArray, first_centre: float, pixel: float) -> FloatArray:
    """Return the index of the cell that holds each position, cell 0 being the first of the first pixel."""
    return np.floor((positions - (first_centre - pixel / 2.0)) * (CELLS / pixel))


def _lattice(name: str, values: ArrayLike, pixel: float) -> FloatArray:
    centres = checked_centres(name, values)
    if np.abs(np.diff(centres) - pixel).max(initial=0.0) > 1e-6 * pixel:
        raise InputError(name, "centres", allowed=f"one pixel of {pixel} arcsec apart")
    return centres
