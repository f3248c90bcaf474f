"""Samples of the focal plane, for the open part of every pixel and pointing jitter, and images between pixels.

An interval of the detector behind the mask sees the image averaged over the interval and over the pointing, that is
with the density of the interval convolved with a Gaussian. A Gauss rule for this density (Golub & Welsch 1969) has
positive weights, stays local, and makes the incoherent sum over the jitter free. Without jitter it is Gauss-Legendre.

An image of a telescope holds no spatial frequency beyond D/lambda. Pixels of at most lambda/2D therefore sample it
completely, and Fourier interpolation of the pixel values is exact but for the cut at the edge of the stamp.
"""

import functools

import numpy as np

from cpic_core import FloatArray, NDArray, Record
from simulator.passbands import gauss_rule

BOX_POINTS, GAUSS_POINTS = 24, 24  # of the discrete measure behind a rule: exact for its first moments


class PixelAxis(Record, eq=False):
    """Quadrature along one detector axis: nodes only where the focal-plane mask is open.

    Attributes
    ----------
    nodes_arcsec : ndarray, shape (k,)
        Positions relative to the star, pixel after pixel.
    weights : ndarray, shape (k,)
        Fractions of a pixel; those of a wholly open pixel sum to one.
    pixels : ndarray of int, shape (p,)
        Indices of pixels that are at least partly open.
    starts : ndarray of int, shape (p,)
        First node of each of these pixels.
    n_pixels : int
        Length of the axis.
    """

    nodes_arcsec: FloatArray
    weights: FloatArray
    pixels: NDArray[np.intp]
    starts: NDArray[np.intp]
    n_pixels: int

    @property
    def owners(self) -> NDArray[np.intp]:
        """Pixel of every node, ascending, shape (k,)."""
        return np.repeat(self.pixels, np.diff(self.starts, append=self.nodes_arcsec.size))

    @property
    def open_fraction(self) -> FloatArray:
        """Open part of every pixel, shape (n_pixels,)."""
        fraction = np.zeros(self.n_pixels)
        if self.pixels.size:
            fraction[self.pixels] = np.add.reduceat(self.weights, self.starts)
        return fraction


@functools.lru_cache(maxsize=256)
def box_gauss_rule(n_nodes: int, width: float, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss rule for a box of ``width`` convolved with a normal density of standard deviation ``sigma``.

    Parameters
    ----------
    n_nodes : int
        Nodes of the quadrature.
    width : float
        Width of the box.
    sigma : float
        Standard deviation of the normal density; 0 for none.

    Returns
    -------
    nodes, weights : ndarray, shape (n_nodes,), read-only
        Symmetric about 0; weights sum to 1. Exact for polynomials up to degree ``2 n_nodes - 1``.
    """
    points, masses = np.polynomial.legendre.leggauss(BOX_POINTS)
    points, masses = 0.5 * width * points, 0.5 * masses
    if sigma > 0:
        normal, normal_masses = np.polynomial.hermite_e.hermegauss(GAUSS_POINTS)
        points = np.add.outer(points, sigma * normal).ravel()
        masses = np.multiply.outer(masses, normal_masses / normal_masses.sum()).ravel()
    nodes, weights = gauss_rule(points, masses, n_nodes)
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


def pixel_axis(
    centres_arcsec: FloatArray, pixel_arcsec: float, n_nodes: int, bar_arcsec: float = 0.0, jitter_arcsec: float = 0.0
) -> PixelAxis:
    """Return the nodes of an axis with a hard bar ``|x| < bar_arcsec`` in front of it.

    A pixel that the edge of the bar cuts gets the nodes of its open part, so the area behind the bar is exact to
    rounding and the quadrature error is that of an uncut pixel. With jitter the nodes reach a little beyond the
    pixel, also behind the bar: it is the star that moves.

    Parameters
    ----------
    centres_arcsec : ndarray, shape (n,)
        Ascending pixel centres relative to the star.
    pixel_arcsec : float
        Pixel size.
    n_nodes : int
        Nodes per open interval.
    bar_arcsec : float
        Half width of the bar, 0 for none.
    jitter_arcsec : float
        Standard deviation of the pointing along this axis.
    """
    low, high = centres_arcsec - pixel_arcsec / 2, centres_arcsec + pixel_arcsec / 2
    if bar_arcsec > 0:
        left = np.stack([low, np.minimum(high, -bar_arcsec)], axis=1)
        right = np.stack([np.maximum(low, bar_arcsec), high], axis=1)
        intervals = np.stack([left, right], axis=1).reshape(-1, 2)
        owner = np.repeat(np.arange(low.size), 2)
    else:
        intervals, owner = np.stack([low, high], axis=1), np.arange(low.size)
    length = intervals[:, 1] - intervals[:, 0]
    keep = length > 1e-9 * pixel_arcsec
    intervals, owner, length = intervals[keep], owner[keep], length[keep]
    distinct, kind = np.unique(np.round(length / pixel_arcsec, 9), return_inverse=True)
    rules = [box_gauss_rule(n_nodes, part * pixel_arcsec, jitter_arcsec) for part in distinct]
    offsets, shares = (np.array([rule[i] for rule in rules]).reshape(-1, n_nodes) for i in (0, 1))
    nodes = intervals.mean(axis=1)[:, None] + offsets[kind]
    weights = length[:, None] / pixel_arcsec * shares[kind]
    pixels, first = np.unique(owner, return_index=True)
    return PixelAxis(nodes.ravel(), weights.ravel(), pixels, first * n_nodes, low.size)


def integrate_pixels(intensity: FloatArray, y: PixelAxis, x: PixelAxis) -> FloatArray:
    """Return the mean intensity of every pixel, closed parts counting as zero.

    Parameters
    ----------
    intensity : ndarray, shape (..., k_y, k_x)
        Values at the nodes.

    Returns
    -------
    ndarray, shape (..., n_y, n_x)
    """
    image = np.zeros((*intensity.shape[:-2], y.n_pixels, x.n_pixels))
    if y.pixels.size and x.pixels.size:
        rows = np.add.reduceat(intensity * y.weights[:, None], y.starts, axis=-2)
        sums = np.add.reduceat(rows * x.weights, x.starts, axis=-1)
        image[..., y.pixels[:, None], x.pixels[None, :]] = sums
    return image


MARGIN_PIXELS = 32
"""Rim around a stamp, in which it fades out before it is shifted."""


def centred_axis(n_pixels: int, pixel_arcsec: float = 1.0, centre: float | None = None) -> FloatArray:
    """Return the pixel centres in arcsec from the star, which sits on pixel ``centre`` (``n_pixels // 2`` if None).

    Parameters
    ----------
    n_pixels : int
        Pixels a side.
    pixel_arcsec : float
        Side of a pixel, arcsec; by default offsets are in pixels.
    centre : float, optional
        Pixel of the star; ``n_pixels // 2`` by default.
    """
    star = n_pixels // 2 if centre is None else centre
    return np.asarray((np.arange(n_pixels) - star) * pixel_arcsec, dtype=np.float64)


def overlap(middle: int, half: int, length: int) -> tuple[slice, slice]:
    """Return the pixels of an axis that a stamp around one of them reaches, and the part of the stamp that lies there.

    Parameters
    ----------
    middle : int
        Pixel of the axis on which the centre of the stamp lies; it may lie beyond the axis.
    half : int
        Pixels of the stamp to either side of its centre.
    length : int
        Pixels of the axis.
    """
    low, high = max(middle - half, 0), min(middle + half + 1, length)
    return slice(low, high), slice(low - middle + half, high - middle + half)


def separations(n_pixels: int, pixel_arcsec: float) -> FloatArray:
    """Return the distance of every pixel of a square stamp from its centre pixel, shape (n_pixels, n_pixels).

    Parameters
    ----------
    n_pixels : int
        Pixels a side.
    pixel_arcsec : float
        Side of a pixel, arcsec.
    """
    offset = centred_axis(n_pixels, pixel_arcsec)
    return np.hypot(offset[:, None], offset)


def unpixelled(kernel: FloatArray, offsets_pixels: FloatArray) -> FloatArray:
    """Return the intensity, as energy per pixel area, of the image that was integrated over pixels.

    The trigonometric polynomial through the pixels, divided by the response of a pixel; 0 beyond the stamp.

    Parameters
    ----------
    kernel : ndarray, shape (n, n), n odd
    offsets_pixels : ndarray, shape (k,)
        Offsets from the centre pixel along both axes.

    Returns
    -------
    ndarray, shape (k, k)
    """
    n = len(kernel)
    frequency = np.fft.fftfreq(n)
    waves = np.exp(2j * np.pi * np.outer(offsets_pixels + n // 2, frequency)) / (n * np.sinc(frequency))
    inside = np.abs(offsets_pixels) <= n / 2
    return np.asarray((waves @ np.fft.fft2(kernel) @ waves.T).real * np.outer(inside, inside))


def shifted(kernel: FloatArray, dy_pixels: float, dx_pixels: float) -> FloatArray:
    """Return the kernel moved by at most half a pixel per axis, on the same stamp.

    The stamp is continued by its mirror image, which fades out over 32 pixels: cut off sharply it would ring by a
    tenth of its edge value.

    Parameters
    ----------
    kernel : ndarray, shape (n, n), n odd
    dy_pixels, dx_pixels : float
        Where its centre goes.
    """
    if dy_pixels == 0 and dx_pixels == 0:
        return kernel
    rim = MARGIN_PIXELS
    padded = np.pad(kernel, rim, mode="symmetric")
    fade = 0.5 - 0.5 * np.cos(np.pi * (np.arange(rim) + 0.5) / rim)
    window = np.concatenate([fade, np.ones(len(kernel)), fade[::-1]])
    padded *= np.outer(window, window)
    n = len(padded)
    phase_y = np.exp(-2j * np.pi * np.fft.fftfreq(n) * dy_pixels)
    phase_x = np.exp(-2j * np.pi * np.fft.rfftfreq(n) * dx_pixels)
    spectrum = np.fft.rfft2(padded) * phase_y[:, None] * phase_x
    return np.asarray(np.fft.irfft2(spectrum, s=padded.shape)[rim:-rim, rim:-rim])


def displaced(kernel: FloatArray, y_pixels: float, x_pixels: float) -> FloatArray:
    """Return the kernel with its centre at an offset from the centre pixel, on a stamp of the same size.

    Whole pixels are moved as they are; the rest is a Fourier shift. Light beyond the kernel's own stamp is 0, and so
    is what rounding makes negative.

    Parameters
    ----------
    kernel : ndarray, shape (n, n), n odd
    y_pixels, x_pixels : float
        Offset, may lie outside the stamp.
    """
    n = len(kernel)
    whole = [round(y_pixels), round(x_pixels)]
    answer = np.zeros_like(kernel)
    if max(abs(step) for step in whole) >= n:
        return answer
    moved = shifted(kernel, y_pixels - whole[0], x_pixels - whole[1])
    to = tuple(slice(max(step, 0), n + min(step, 0)) for step in whole)
    source = tuple(slice(max(-step, 0), n + min(-step, 0)) for step in whole)
    answer[to] = np.maximum(moved[source], 0.0)
    return answer


def open_pixels(n_pixels: int, pixel_arcsec: float, half_width_arcsec: float) -> FloatArray:
    """Open part of every pixel of a star-centred stamp behind the cross ``|x| < w or |y| < w``, shape (n, n).

    Parameters
    ----------
    n_pixels : int
        Pixels a side.
    pixel_arcsec : float
        Side of a pixel, arcsec.
    half_width_arcsec : float
        Half width of the mask's arms, arcsec.
    """
    centre, width = centred_axis(n_pixels), half_width_arcsec / pixel_arcsec
    part = 1.0 - np.clip(np.minimum(centre + 0.5, width) - np.maximum(centre - 0.5, -width), 0.0, 1.0)
    return np.outer(part, part)


def bilinear(table: FloatArray, row: FloatArray, column: FloatArray) -> FloatArray:
    """Return a table between its nodes, linear along both axes; beyond them as its last cells go on.

    Parameters
    ----------
    table : ndarray, shape (n, m)
    row, column : ndarray
        Fractional indices; they broadcast.
    """
    row, column = np.broadcast_arrays(row, column)
    i = np.clip(row.astype(int), 0, table.shape[0] - 2)
    j = np.clip(column.astype(int), 0, table.shape[1] - 2)
    p, q = row - i, column - j
    left = table[i, j] * (1 - p) * (1 - q) + table[i + 1, j] * p * (1 - q)
    value: FloatArray = left + table[i, j + 1] * (1 - p) * q + table[i + 1, j + 1] * p * q
    return value
