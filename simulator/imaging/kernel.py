"""Pixel-integrated images of a point source between the pixels: exact for what the pixels sample well enough.

An image of a telescope holds no spatial frequency beyond D/lambda. Pixels of at most lambda/2D therefore sample it
completely, and Fourier interpolation of the pixel values is exact but for the cut at the edge of the stamp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["centred_offsets", "open_pixels", "placed", "shifted", "unpixelled"]

FloatArray = NDArray[np.float64]
MARGIN_PIXELS = 32
"""Rim around a stamp, in which it fades out before it is shifted."""


def centred_offsets(n_pixels: int) -> FloatArray:
    """Offsets of pixel centres from the centre pixel ``n // 2``, in pixels."""
    return np.arange(n_pixels, dtype=np.float64) - n_pixels // 2


def unpixelled(kernel: FloatArray, offsets_pixels: FloatArray) -> FloatArray:
    """Intensity, as energy per pixel area, of the image that was integrated over pixels.

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
    """Kernel moved by at most half a pixel per axis, on the same stamp.

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


def placed(kernel: FloatArray, y_pixels: float, x_pixels: float) -> FloatArray:
    """Kernel with its centre at an offset from the centre pixel, on a stamp of the same size.

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
    centre, width = centred_offsets(n_pixels), half_width_arcsec / pixel_arcsec
    part = 1.0 - np.clip(np.minimum(centre + 0.5, width) - np.maximum(centre - 0.5, -width), 0.0, 1.0)
    return np.outer(part, part)
